"""Who may call: hosts, origins, tokens, sizes; and what every answer carries."""

import json
import os
from pathlib import Path

import pytest

from tests.parts.service.serving import Served, serving
from twolink.errors import TwolinkError
from twolink.parts.service.problems import Refusal
from twolink.parts.service.settings import Quotas, Settings, Tokens, is_loopback, read_quotas

BODY = {"q": [0, 0]}
PATH = "/v1/robots/two_link/bias"


@pytest.mark.parametrize(("host", "status"), [
    ("localhost", 200), ("127.0.0.1:1234", 200), ("[::1]:80", 200), ("evil.example", 421),
    ("localhost.evil.example", 421), ("", 421), ("[", 421), ("127.0.0.1.evil.example", 421),
    ("evil@localhost", 421), ("localhost:80:80", 421), ("localhost:", 421), ("local host", 421), ("[::1", 421),
    ("[::1]x", 421),
])  # fmt: skip
def test_only_known_hosts(http: Served, host: str, status: int) -> None:
    for path, body in (("/health", None), (PATH, BODY)):
        http.ask(path, body, status, headers={"Host": host})


def test_pages_of_other_sites_may_not_call(http: Served) -> None:
    for origin in ("https://evil.example", "null", "http://localhost:1", "http://["):
        http.ask(PATH, BODY, 403, headers={"Origin": origin})
        answer = http.options(PATH, headers={"Origin": origin, "Access-Control-Request-Method": "POST"})
        assert answer.status_code == 403
        assert "access-control-allow-origin" not in answer.headers
    http.ask(PATH, BODY, headers={"Origin": http.url})


def test_every_answer_carries_the_security_headers(http: Served) -> None:
    answers = [http.get(path) for path in ("/", "/health", "/docs", "/nowhere", "/v1/robots")]
    answers += [http.post(PATH, json=BODY), http.post(PATH, content=b"{")]
    for answer in answers:
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert "default-src 'none'" in answer.headers["content-security-policy"]
        assert "server" not in answer.headers


def test_tokens_allowed_hosts_and_origins(tmp_path: Path) -> None:
    options = ["--token", "first", "--allow-host", "lab.example", "--allow-origin", "https://lab.example"]
    with serving(tmp_path / "data", *options, environment={"TWOLINK_TOKEN": "second"}) as http:
        for token in ("first", "second"):
            http.ask(PATH, BODY, headers={"Authorization": f"Bearer {token}"})
        for authorization in ("Bearer third", "Bearer", "first", "Basic first", "Bearer first second"):
            answer = http.post(PATH, json=BODY, headers={"Authorization": authorization})
            assert (answer.status_code, answer.headers["www-authenticate"]) == (401, "Bearer")
        for path in ("/v1/robots", "/metrics", "/openapi.json", "/v1/simulations"):
            http.ask(path, status=401)
        http.ask("/health", headers={"Host": "lab.example"})
        headers = {"Origin": "https://lab.example", "Authorization": "Bearer first"}
        answer = http.post(PATH, json=BODY, headers=headers)
        assert answer.headers["access-control-allow-origin"] == "https://lab.example"
        assert http.options(PATH, headers={"Origin": "https://lab.example"}).status_code == 204


def test_tokens_of_a_file_are_read_again_and_expire(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("twolink.parts.service.settings._LOOK", -1.0)
    file = tmp_path / "tokens"
    file.write_text("ann:one 2999-01-31\n\nbob:two 2020-01-31  # has left\nthree\n")
    who = Tokens(Settings(data="x", tokens=("cid:four",), token_file=str(file)))
    assert [who.owner(f"Bearer {text}".encode()) for text in ("one", "three", "four")] == ["ann", "", "cid"]
    with pytest.raises(Refusal, match="expired"):
        who.owner(b"Bearer two")
    file.write_text("dan:five")
    os.utime(file, (1e9, 1e9))
    assert who.owner(b"Bearer five") == "dan"
    with pytest.raises(Refusal, match="not one of"):
        who.owner(b"Bearer one")
    for text in ("a b", "ann:six tomorrow", "ann:six 2999-01-31 more"):
        file.write_text(text)
        with pytest.raises(TwolinkError, match="tokens cannot be used: line 1"):
            Tokens(Settings(data="x", token_file=str(file)))
    who.owner(b"Bearer five")  # while the file cannot be read, the tokens stay


@pytest.mark.slow
def test_a_file_of_settings_a_proxy_and_owners_in_the_log(tmp_path: Path) -> None:
    settings = tmp_path / "settings.toml"
    (tmp_path / "tokens").write_text("ann:one")
    settings.write_text(f'log = "json"\ntrust-proxy = ["127.0.0.1"]\ntoken-file = "{tmp_path}/tokens"\n')
    by_file = {"TWOLINK_SERVE_SETTINGS": str(settings)}
    with (
        serving(tmp_path / "data", environment=by_file) as served,
        served.client(headers={"Authorization": "Bearer one"}) as http,
    ):
        http.post(PATH, json=BODY, headers={"X-Forwarded-For": "203.0.113.9, 127.0.0.1"})
        http.post(PATH, json=BODY)
        http.get("/v1/robots", headers={"X-Forwarded-For": "203.0.113.9, 198.51.100.7"})
    lines = [json.loads(line) for line in served.log.splitlines() if '"owner"' in line]
    assert [(line["client"], line["owner"]) for line in lines] == [
        ("203.0.113.9", "ann"), ("127.0.0.1", "ann"), ("198.51.100.7", "ann"),
    ]  # fmt: skip


@pytest.mark.slow
def test_requests_too_large_or_too_slow_are_ended(tmp_path: Path) -> None:
    with serving(tmp_path / "data", "--quota", "body_mb=0.01", "--quota", "body_seconds=1") as http:
        for path in (PATH, "/v1/robots", "/v1/simulations"):
            http.ask(path, bytes(20_000), 413)
            chunks = (bytes(1000) for _ in range(20))  # of no stated length
            assert http.post(path, content=chunks).status_code == 413
        for part in (b"", b"POST / HTTP", b"POST /v1/robots HTTP/1.1\r\nHost: localhost\r\nContent-Length: 9\r\n\r\n{"):
            with http.connect() as slow:
                slow.sendall(part)
                assert slow.recv(1) == b""  # the service has closed it


def test_settings() -> None:
    assert read_quotas(["jobs=4", "disk_mb=1500.5"]) == Quotas(jobs=4, disk_mb=1500.5)
    for wrong in ("jobs", "jbos=1", "jobs=x", "jobs=0", "disk_mb=-1", "jobs=1.5"):
        with pytest.raises(TwolinkError):
            read_quotas([wrong])
    assert all(map(is_loopback, ("127.0.0.1", "localhost", "::1")))
    assert not any(map(is_loopback, ("0.0.0.0", "lab")))
