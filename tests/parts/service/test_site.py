"""The description, the docs, health, metrics, the page; and the command that serves them."""

import re
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest

import twolink as tl
from tests.command import call_process, one_line
from tests.parts.service.serving import TOP, Served, serving
from twolink.parts.service.work.sandbox import protection
from twolink.show.playback import VIEWER

FOLDER = TOP / "twolink" / "parts" / "service" / "page"


def test_nothing_in_the_page_points_outside_or_stands_inline() -> None:
    """The policy would refuse it; here is which file it is in."""
    for path in (*FOLDER.rglob("*"), *VIEWER.iterdir()):
        text = path.read_text("utf-8")
        outside = [url for url in re.findall(r"https?://[^\s\"'<>)]+", text) if url != "http://www.w3.org/2000/svg"]
        assert outside == [], path.name
        assert not re.search(r"\sstyle=|\son\w+=\"|<style|javascript:", text), path.name
    html = (FOLDER / "index.html").read_text("utf-8")
    assert re.findall(r"<script[^>]*>(.*?)</script>", html, re.DOTALL) == [""]
    ids = set(re.findall(r'\bid="([^"]+)"', html)) | {"expected", "in-wrench-frame", "in-wrench"}
    for path in FOLDER.glob("*.js"):
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
