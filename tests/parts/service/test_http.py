"""What HTTP offers beside the answers: tags, parts, methods, names of hosts; and pages below any path."""

import re
import signal
import time
from pathlib import Path

import pytest

from tests.parts.service.serving import TOP, Served, serving

PAGE = TOP / "twolink" / "parts" / "service" / "page"
RUN = {"scene": "arm-swing", "duration": 0.5, "wait": 30}


@pytest.fixture
def paths(http: Served) -> list[str]:
    """Answers of each kind: made in one piece, compressed, of a file of the page, and of a result."""
    key = http.ask("/v1/simulations", RUN)["id"]
    return ["/v1/robots", "/v1/scene-schema", "/page/main.js", f"/v1/simulations/{key}/result?format=npz"]


def test_what_the_client_has_is_not_sent_again(http: Served, paths: list[str]) -> None:
    for path in paths:
        first = http.get(path)
        for known in (first.headers["etag"], f'"other", W/{first.headers["etag"]}', "*"):
            again = http.get(path, headers={"If-None-Match": known})
            assert (again.status_code, again.content, again.headers["etag"]) == (304, b"", first.headers["etag"])
        assert http.get(path, headers={"If-None-Match": '"other"'}).content == first.content


def test_a_part_is_that_of_the_whole(http: Served, paths: list[str]) -> None:
    for path in paths:
        whole = http.get(path, headers={"Accept-Encoding": "identity"})
        length = len(whole.content)
        for asked, begin, end in (("0-9", 0, 10), ("5-", 5, length), ("-7", length - 7, length), ("3-3", 3, 4)):
            part = http.get(path, headers={"Range": f"bytes={asked}", "Accept-Encoding": "identity"})
            assert (part.status_code, part.content) == (206, whole.content[begin:end])
            assert part.headers["content-range"] == f"bytes {begin}-{end - 1}/{length}"
        for beyond in (f"{length}-", "5-4", "-0"):
            assert http.ask(path, status=416, headers={"Range": f"bytes={beyond}"})["where"] == "header: Range"
        for other in ("bytes=0-1,4-5", "lines=0-1", "", "bytes=-", "bytes=1-0,3-4", "bytes=a-b"):
            assert http.get(path, headers={"Range": other}).content == whole.content
        assert http.get(path, headers={"Range": "bytes=0-1", "If-Range": '"old"'}).content == whole.content


def test_methods_of_a_path(http: Served) -> None:
    for path, allow in {
        "/v1/robots": "GET, HEAD, OPTIONS, POST", "/v1/robots/two_link": "DELETE, GET, HEAD, OPTIONS",
        "/v1/robots/two_link/bias": "OPTIONS, POST", "/health": "GET, HEAD, OPTIONS",
        "/page/main.js": "GET, HEAD, OPTIONS",
    }.items():  # fmt: skip
        answer = http.options(path)
        assert (answer.status_code, answer.headers["allow"]) == (204, allow)
        refused = http.put(path)
        assert (refused.status_code, refused.headers["allow"]) == (405, allow)
        assert refused.json()["code"] == "method-not-allowed"
    http.ask("/v1/robots/two_link/bias", status=405)
    assert [http.request(method, "/v1/nowhere").status_code for method in ("GET", "OPTIONS", "PUT")] == [404] * 3


def test_a_misspelt_parameter_is_refused_by_its_name(http: Served) -> None:
    meant = "did you mean 'limit'?"
    for path, remedy in (("/v1/robots", meant), ("/v1/simulations", meant), ("/v1/queries", "leave it out")):
        problem = http.ask(f"{path}?lmit=1", status=400)
        assert (problem["code"], problem["remedy"]) == ("unknown-query-parameter", remedy)
    http.ask("/v1/robots?limit=1")
    http.ask("/?robot=panda")


def test_two_hosts_are_refused(served: Served) -> None:
    with served.connect() as connection:
        connection.sendall(b"GET /health HTTP/1.1\r\nHost: localhost\r\nHost: evil.example\r\n\r\n")
        assert connection.recv(1000).startswith(b"HTTP/1.1 400")


def test_pages_have_relative_links(http: Served) -> None:
    for path in ("/", "/docs"):
        links = re.findall(r'(?:href|src)="([^"#]*)', http.get(path).text)
        assert links
        for link in links:
            assert not link.startswith("/")
            http.ask(f"/{link}")  # and so none names another site
    assert "forward-dynamics" in http.get("/docs").text
    assert len(http.get("/page/meshcat.js").content) > 100_000
    scripts = "".join(path.read_text() for path in PAGE.glob("*.js"))
    assert not re.search(r"""(fetch|import|src =|href =|new URL)\s*\(?["'`]/""", scripts)


@pytest.mark.slow
def test_an_end_without_tasks_is_no_error(tmp_path: Path) -> None:
    with serving(tmp_path / "data") as served:
        half = served.connect()
        half.sendall(b"POST /v1/robots HTTP/1.1\r\nHost: localhost\r\nContent-Length: 9\r\n\r\n")
        time.sleep(0.5)  # the service has read it
        served.process.send_signal(signal.SIGTERM)
        served.process.wait(60)
        half.close()
    assert "Cancel" not in served.log
