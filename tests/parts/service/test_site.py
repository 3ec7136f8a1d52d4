"""The description, the docs, health, metrics, the page; and the command that serves them."""

from __future__ import annotations

import json
import re
import socket
import subprocess
import sys
from pathlib import Path

import httpx
import msgspec
import pytest

import twolink as tl
from tests.parts.service.serving import TOP, Served, serving
from twolink.parts.service.work.query_requests import QUERIES
from twolink.parts.service.work.sandbox import protection


def test_the_description_covers_what_there_is(http: httpx.Client) -> None:
    document = http.get("/openapi.json").json()
    assert document["openapi"].startswith("3.1")
    for name in QUERIES:
        assert "post" in document["paths"][f"/v1/robots/{{robot}}/{name}"]
    for path in ("/v1/robots", "/v1/scenes/explain", "/v1/simulations/{job}/events", "/v1/studies/{job}/figure"):
        assert path in document["paths"]
    text = json.dumps(document)
    for name in re.findall(r'"#/components/schemas/([^"]+)"', text):
        assert name in document["components"]["schemas"], name
    for operations in document["paths"].values():
        for operation in operations.values():
            assert "application/problem+json" in operation["responses"]["4XX"]["content"]


def test_no_page_names_another_site(http: httpx.Client) -> None:
    for path in ("/docs", "/"):
        answer = http.get(path)
        assert answer.status_code == 200
        assert not re.findall(r"(?:src|href)=[\"'](?:https?:)?//", answer.text)
    assert "forward-dynamics" in http.get("/docs").text
    assert len(http.get("/page/meshcat.js").content) > 100_000


def test_nothing_outside_the_page_is_served(http: httpx.Client) -> None:
    for path in (
        "/page/../app.py",
        "/page/%2e%2e/app.py",
        "/page//etc/passwd",
        "/page/..%2fapp.py",
        "/page/nothing.js",
    ):
        assert http.get(path).status_code == 404


def test_health_and_metrics(http: httpx.Client) -> None:
    health = http.get("/health").json()
    assert health["status"] == "ok"
    assert health["sandbox"] == msgspec.to_builtins(protection())
    http.post("/v1/robots/two_link/bias", json={"q": [0, 0]})
    text = http.get("/metrics").text
    assert re.search(r'twolink_requests_total\{route="bias",status="200"\} \d+', text)
    assert "twolink_states_total" in text


def test_import_loads_no_web_library() -> None:
    code = "import sys, twolink, twolink.cli.app; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=TOP, check=True)
    loaded = set(done.stdout.split())
    own = {"sqlite3"} if "coverage" in loaded else set()  # measuring coverage loads it
    assert not {"litestar", "uvicorn", "prometheus_client", "sqlite3"} & (loaded - own)


@pytest.mark.parametrize("part", ["http.app", "work.robot_tasks", "work.task_table"])
def test_service_and_workers_start_without_what_few_tasks_need(part: str) -> None:
    """Each worker that is started imports its tasks first, and a client waits for it."""
    code = f"import sys, twolink.parts.service.{part}; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=TOP, check=True)
    assert "twolink.parts.service.work.robot_tasks" in done.stdout.split()
    assert not {"trimesh", "networkx", "scipy.linalg", "scipy.optimize"} & set(done.stdout.split())


def test_a_taken_port_is_an_error_of_one_line(served: Served, tmp_path: Path) -> None:
    port = served.url.rpartition(":")[2]
    command = [sys.executable, "-m", "twolink", "serve", "--port", port, "--data", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=TOP, timeout=60)
    assert (done.returncode, done.stderr.count("\n")) == (1, 1)
    assert "--port" in done.stderr


def test_clients_that_leave_in_the_middle_do_no_harm(served: Served, http: httpx.Client) -> None:
    host, port = served.url.removeprefix("http://").split(":")
    for part in (b"", b"POST / HTTP", b"POST /v1/robots HTTP/1.1\r\nHost: localhost\r\nContent-Length: 99\r\n\r\n{"):
        with socket.create_connection((host, int(port))) as connection:
            connection.sendall(part)
    assert http.get("/health").status_code == 200
    assert "Traceback" not in served.log


@pytest.mark.slow
def test_it_may_be_below_a_path(tmp_path: Path) -> None:
    with serving(tmp_path / "data", "--root-path", "/lab/twolink") as served, served.client() as http:
        assert (http.get("/lab/twolink").status_code, http.get("/lab/twolink").headers["location"]) == (
            308, "/lab/twolink/",
        )  # fmt: skip
        assert http.get("/lab/twolink/").text == http.get("/").text
        body = {"scene": "arm-swing", "duration": 0.5, "wait": 0}
        begun = http.post("/lab/twolink/v1/simulations", json=body)
        assert begun.headers["location"].startswith("/lab/twolink/v1/simulations/")
        assert http.get(begun.headers["location"]).json()["id"] == begun.json()["id"]
        assert http.post("/v1/simulations", json=body).headers["location"].startswith("/v1/simulations/")
        assert http.get("/lab/twolinkx/health").status_code == 404
        here = tl.connect(f"{served.url}/lab/twolink").robot("two_link")
        assert here.mass_matrix([0.1, 0.2]).shape == (2, 2)
