"""What HTTP offers beside the answers: tags, parts, methods, names of hosts; and pages below any path."""

from __future__ import annotations

import re
import signal
import socket
import time
from pathlib import Path

import httpx
import pytest

from tests.parts.service.serving import Served, serving
from twolink.parts.service.http.outgoing import _asked
from twolink.parts.service.problems import Refusal

PAGE = Path(__file__).parents[3] / "twolink" / "parts" / "service" / "page"
RUN = {"scene": "arm-swing", "duration": 0.5, "wait": 30}


@pytest.fixture
def paths(http: httpx.Client) -> list[str]:
    """Answers of each kind: made in one piece, compressed, of a file of the page, and of a result."""
    key = http.post("/v1/simulations", json=RUN).json()["id"]
    return ["/v1/robots", "/v1/scene-schema", "/page/main.js", f"/v1/simulations/{key}/result?format=npz"]


def test_what_the_client_has_is_not_sent_again(http: httpx.Client, paths: list[str]) -> None:
    for path in paths:
        first = http.get(path)
        for known in (first.headers["etag"], f'"other", W/{first.headers["etag"]}', "*"):
            again = http.get(path, headers={"If-None-Match": known})
            assert (again.status_code, again.content, again.headers["etag"]) == (304, b"", first.headers["etag"])
        assert http.get(path, headers={"If-None-Match": '"other"'}).content == first.content


def test_a_part_is_that_of_the_whole(http: httpx.Client, paths: list[str]) -> None:
    for path in paths:
        whole = http.get(path, headers={"Accept-Encoding": "identity"})
        length = len(whole.content)
        for asked, begin, end in (("0-9", 0, 10), ("5-", 5, length), ("-7", length - 7, length), ("3-3", 3, 4)):
            part = http.get(path, headers={"Range": f"bytes={asked}", "Accept-Encoding": "identity"})
            assert (part.status_code, part.content) == (206, whole.content[begin:end])
            assert part.headers["content-range"] == f"bytes {begin}-{end - 1}/{length}"
        beyond = http.get(path, headers={"Range": f"bytes={length}-"})
        assert (beyond.status_code, beyond.json()["where"]) == (416, "header: Range")
        for other in ({"Range": "bytes=0-1,4-5"}, {"Range": "lines=0-1"}, {"Range": "bytes=0-1", "If-Range": '"old"'}):
            assert http.get(path, headers=other).content == whole.content


def test_parts_that_cannot_be() -> None:
    assert [_asked(text, 10) for text in (b"", b"bytes=-", b"bytes=1-0,3-4", b"bytes=a-b")] == [None] * 4
    for text in (b"bytes=10-", b"bytes=5-4", b"bytes=-0"):
        with pytest.raises(Refusal) as refused:
            _asked(text, 10)
        assert refused.value.status == 416


def test_methods_of_a_path(http: httpx.Client) -> None:
    for path, allow in {
        "/v1/robots": "GET, HEAD, OPTIONS, POST", "/v1/robots/two_link": "DELETE, GET, HEAD, OPTIONS",
        "/v1/robots/two_link/bias": "OPTIONS, POST", "/health": "GET, HEAD, OPTIONS",
        "/page/main.js": "GET, HEAD, OPTIONS",
    }.items():  # fmt: skip
        answer = http.options(path)
        assert (answer.status_code, answer.headers["allow"]) == (204, allow)
        refused = http.put(path)
        assert (refused.status_code, refused.headers["allow"], refused.json()["code"]) == (
            405,
            allow,
            "method-not-allowed",
        )
    assert http.get("/v1/robots/two_link/bias").status_code == 405
    assert [http.request(method, "/v1/nowhere").status_code for method in ("GET", "OPTIONS", "PUT")] == [404] * 3


def test_a_misspelt_parameter_is_refused_by_its_name(http: httpx.Client) -> None:
    meant = "did you mean 'limit'?"
    for path, remedy in (("/v1/robots", meant), ("/v1/simulations", meant), ("/v1/queries", "leave it out")):
        answer = http.get(path, params={"lmit": 1})
        problem = answer.json()
        assert (answer.status_code, problem["code"], problem["remedy"]) == (400, "unknown-query-parameter", remedy)
    assert http.get("/v1/robots?limit=1").status_code == 200
    assert http.get("/?robot=panda").status_code == 200


@pytest.mark.parametrize("host", ["evil@localhost", "localhost:80:80", "localhost:", "local host", "[::1", "[::1]x"])
def test_a_host_is_a_name_and_a_port(http: httpx.Client, host: str) -> None:
    assert http.get("/health", headers={"Host": host}).status_code == 421


def test_two_hosts_are_refused(served: Served) -> None:
    with socket.create_connection(("127.0.0.1", int(served.url.rpartition(":")[2])), timeout=60) as connection:
        connection.sendall(b"GET /health HTTP/1.1\r\nHost: localhost\r\nHost: evil.example\r\n\r\n")
        assert connection.recv(1000).startswith(b"HTTP/1.1 400")


def test_pages_have_relative_links(http: httpx.Client) -> None:
    for path in ("/", "/docs"):
        links = re.findall(r'(?:href|src)="([^"#]*)', http.get(path).text)
        assert links
        for link in links:
            assert not link.startswith("/")
            assert http.get(f"/{link}").status_code == 200
    scripts = "".join(path.read_text() for path in PAGE.glob("*.js"))
    assert not re.search(r"""(fetch|import|src =|href =|new URL)\s*\(?["'`]/""", scripts)


@pytest.mark.slow
def test_an_end_without_tasks_is_no_error(tmp_path: Path) -> None:
    with serving(tmp_path / "data") as served:
        address = "127.0.0.1", int(served.url.rpartition(":")[2])
        half = socket.create_connection(address, timeout=60)
        half.sendall(b"POST /v1/robots HTTP/1.1\r\nHost: localhost\r\nContent-Length: 9\r\n\r\n")
        time.sleep(0.5)  # the service has read it
        served.process.send_signal(signal.SIGTERM)
        served.process.wait(60)
        half.close()
    assert "Cancel" not in served.log
