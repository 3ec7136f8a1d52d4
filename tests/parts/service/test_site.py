"""What is beside the API's answers: the page, health, the command; and tags, parts, methods and hosts of HTTP."""

import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import msgspec
import pytest

import twolink as tl
from tests.command import call_process, one_line
from tests.parts.service.serving import TOP, Served, serving
from twolink.parts.service.work.sandbox import protection
from twolink.show.playback import VIEWER

PAGE = TOP / "twolink" / "parts" / "service" / "page"


def test_nothing_in_the_page_points_outside_or_stands_inline() -> None:
    """The policy would refuse it; here is which file it is in."""
    for path in (*PAGE.rglob("*"), *VIEWER.iterdir()):
        text = path.read_text("utf-8")
        outside = [url for url in re.findall(r"https?://[^\s\"'<>)]+", text) if url != "http://www.w3.org/2000/svg"]
        assert outside == [], path.name
        assert not re.search(r"\sstyle=|\son\w+=\"|<style|javascript:", text), path.name
    html = (PAGE / "index.html").read_text("utf-8")
    assert re.findall(r"<script[^>]*>(.*?)</script>", html, re.DOTALL) == [""]
    ids = set(re.findall(r'\bid="([^"]+)"', html)) | {"expected", "in-wrench-frame", "in-wrench"}
    for path in PAGE.glob("*.js"):
        assert set(re.findall(r'byId\("([^"]+)"\)', path.read_text("utf-8"))) <= ids, path.name


def test_nothing_outside_the_page_is_served(http: Served) -> None:
    for path in ("../app.py", "%2e%2e/app.py", "/etc/passwd", "..%2fapp.py", "nothing.js"):
        http.ask(f"/page/{path}", status=404)


def test_health(http: Served) -> None:
    health = http.ask("/health")
    assert health["status"] == "ok"
    assert health["sandbox"] == msgspec.to_builtins(protection())


WEB, SELDOM = {"litestar", "uvicorn", "prometheus_client"}, {"trimesh", "networkx", "scipy.linalg", "scipy.optimize"}


@pytest.mark.parametrize(("part", "without"), [
    ("cli.app", WEB | {"sqlite3"}), ("parts.service.http.app", SELDOM), ("parts.service.work.robot_tasks", SELDOM),
    ("parts.service.work.task_table", SELDOM),
])  # fmt: skip
def test_nothing_is_imported_that_few_need(part: str, without: set[str]) -> None:
    """Each worker that is started imports its tasks first, and a client waits for it."""
    code = f"import sys, twolink.{part}; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=TOP, check=True)
    loaded = set(done.stdout.split())
    assert f"twolink.{part}" in loaded
    assert not without & (loaded - ({"sqlite3"} if "coverage" in loaded else set()))  # measuring coverage loads it


def test_a_taken_port_is_an_error_of_one_line(served: Served, tmp_path: Path) -> None:
    port = served.url.rpartition(":")[2]
    one_line(call_process("serve", "--port", port, "--data", str(tmp_path)), 1, "--port")


@pytest.mark.slow
def test_it_may_be_below_a_path(tmp_path: Path) -> None:
    with serving(tmp_path / "data", "--root-path", "/lab/twolink") as http:
        moved = http.get("/lab/twolink")
        assert (moved.status_code, moved.headers["location"]) == (308, "/lab/twolink/")
        assert http.get("/lab/twolink/").text == http.get("/").text
        body = {"scene": "arm-swing", "duration": 0.5, "wait": 0}
        begun = http.post("/lab/twolink/v1/simulations", json=body)
        assert begun.headers["location"].startswith("/lab/twolink/v1/simulations/")
        assert http.ask(begun.headers["location"])["id"] == begun.json()["id"]
        assert http.post("/v1/simulations", json=body).headers["location"].startswith("/v1/simulations/")
        http.ask("/lab/twolinkx/health", status=404)
        here = tl.connect(f"{http.url}/lab/twolink").robot("two_link")
        assert here.mass_matrix([0.1, 0.2]).shape == (2, 2)


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


def test_the_page_asks_for_its_files_where_they_never_change(http: Served) -> None:
    page = http.get("/").text
    asked = set(re.findall(r'"(page/[^"]+)"', page))
    (digest,) = {path.split("/")[1] for path in asked}
    assert {f"page/{digest}/{name}" for name in ("main.js", "style.css", "meshcat.js")} <= asked
    for path in asked:
        kept, plain = http.get(f"/{path}"), http.get(f"/{path.replace(f'{digest}/', '')}")
        assert kept.content == plain.content
        assert (kept.headers["cache-control"], plain.headers["cache-control"]) == (
            "max-age=31536000, immutable",
            "no-cache",
        )
    http.ask(f"/page/{'0' * len(digest)}/main.js", status=404)


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


def test_a_misspelt_query_is_refused_with_the_one_that_is_meant(http: Served) -> None:
    for name in ("foward-dynamics", "forward_dynamics"):
        problem = http.ask(f"/v1/robots/two_link/{name}", {"q": [0, 0]}, status=404)
        assert problem["detail"] == f"there is no query '{name}'"
        assert problem["remedy"].startswith("did you mean 'forward-dynamics'?")
    assert http.ask("/v1/nowhere", status=404)["detail"] == "Not Found"


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
