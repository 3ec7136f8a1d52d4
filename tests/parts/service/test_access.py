"""Who may call: hosts, origins, tokens, sizes; and what every answer carries."""

from __future__ import annotations

import socket
from pathlib import Path

import httpx
import pytest

from tests.parts.service.serving import Served, serving
from twolink.errors import TwolinkError
from twolink.parts.service.settings import Quotas, is_loopback, read_quotas

BODY = {"q": [0, 0]}
PATH = "/v1/robots/two_link/bias"


@pytest.mark.parametrize(("host", "status"), [
    ("localhost", 200), ("127.0.0.1:1234", 200), ("[::1]:80", 200), ("evil.example", 421),
    ("localhost.evil.example", 421), ("", 421), ("[", 421), ("127.0.0.1.evil.example", 421),
])  # fmt: skip
def test_only_known_hosts(http: httpx.Client, host: str, status: int) -> None:
    for answer in (http.get("/health", headers={"Host": host}), http.post(PATH, json=BODY, headers={"Host": host})):
        assert answer.status_code == status


def test_pages_of_other_sites_may_not_call(served: Served, http: httpx.Client) -> None:
    for origin in ("https://evil.example", "null", "http://localhost:1"):
        assert http.post(PATH, json=BODY, headers={"Origin": origin}).status_code == 403
        answer = http.options(PATH, headers={"Origin": origin, "Access-Control-Request-Method": "POST"})
        assert answer.status_code == 403
        assert "access-control-allow-origin" not in answer.headers
    assert http.post(PATH, json=BODY, headers={"Origin": served.url}).status_code == 200


def test_every_answer_carries_the_security_headers(http: httpx.Client) -> None:
    answers = [http.get(path) for path in ("/", "/health", "/docs", "/nowhere", "/v1/robots")]
    answers += [http.post(PATH, json=BODY), http.post(PATH, content=b"{")]
    for answer in answers:
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert "default-src 'none'" in answer.headers["content-security-policy"]
        assert "server" not in answer.headers


def test_tokens_allowed_hosts_and_origins(tmp_path: Path) -> None:
    options = ["--token", "first", "--allow-host", "lab.example", "--allow-origin", "https://lab.example"]
    with (
        serving(tmp_path / "data", *options, environment={"TWOLINK_TOKEN": "second"}) as served,
        served.client() as http,
    ):
        for token in ("first", "second"):
            assert http.post(PATH, json=BODY, headers={"Authorization": f"Bearer {token}"}).status_code == 200
        for authorization in ("Bearer third", "Bearer", "first", "Basic first", "Bearer first second"):
            answer = http.post(PATH, json=BODY, headers={"Authorization": authorization})
            assert (answer.status_code, answer.headers["www-authenticate"]) == (401, "Bearer")
        for path in ("/v1/robots", "/metrics", "/openapi.json", "/v1/simulations"):
            assert http.get(path).status_code == 401
        assert [http.get(path).status_code for path in ("/", "/health", "/docs")] == [200] * 3
        assert http.get("/health", headers={"Host": "lab.example"}).status_code == 200
        headers = {"Origin": "https://lab.example", "Authorization": "Bearer first"}
        answer = http.post(PATH, json=BODY, headers=headers)
        assert answer.headers["access-control-allow-origin"] == "https://lab.example"
        assert http.options(PATH, headers={"Origin": "https://lab.example"}).status_code == 204


@pytest.mark.slow
def test_requests_too_large_or_too_slow_are_ended(tmp_path: Path) -> None:
    with serving(tmp_path / "data", "--quota", "body_mb=0.01", "--quota", "body_seconds=1") as served:
        with served.client() as http:
            for path in (PATH, "/v1/robots", "/v1/simulations"):
                assert http.post(path, content=bytes(20_000)).status_code == 413
                chunks = (bytes(1000) for _ in range(20))  # of no stated length
                assert http.post(path, content=chunks).status_code == 413
        for part in (b"", b"POST / HTTP", b"POST /v1/robots HTTP/1.1\r\nHost: localhost\r\nContent-Length: 9\r\n\r\n{"):
            with socket.create_connection(("127.0.0.1", int(served.url.rpartition(":")[2])), timeout=60) as slow:
                slow.sendall(part)
                assert slow.recv(1) == b""  # the service has closed it


def test_settings() -> None:
    assert read_quotas(["jobs=4", "disk_mb=1500.5"]) == Quotas(jobs=4, disk_mb=1500.5)
    for wrong in ("jobs", "jbos=1", "jobs=x", "jobs=0", "disk_mb=-1", "jobs=1.5"):
        with pytest.raises(TwolinkError):
            read_quotas([wrong])
    assert [is_loopback(host) for host in ("127.0.0.1", "localhost", "::1", "0.0.0.0", "lab")] == [True] * 3 + [
        False
    ] * 2
