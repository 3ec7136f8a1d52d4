"""Workers and services that are killed or end: nothing that was done is lost, and no process is left."""

import asyncio
import contextlib
import json
import os
import re
import signal
import sqlite3
import threading
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tests.command import call_process, one_line
from tests.parts.service.serving import Served, pendulum, serving, wait_until
from tests.parts.service.test_jobs import SLOW, SWING, ended, started
from tests.robots.test_bad_urdf import joint, link, robot
from twolink.parts.service.settings import Quotas
from twolink.parts.service.store.store import Store
from twolink.parts.service.work.job_views import Running
from twolink.parts.service.work.jobs import beat


def large_robot(count: int, name: str) -> str:
    """A robot whose reading takes a while."""
    parts = [link("l0")]
    for i in range(1, count):
        parts += [link(f"l{i}"), joint(f"j{i}", f"l{(i - 1) // 2}", f"l{i}", "fixed")]
    return robot(*parts).replace('"r"', f'"{name}"', 1)


@pytest.mark.slow
def test_a_killed_worker_is_a_problem_and_the_service_goes_on(tmp_path: Path) -> None:
    with serving(tmp_path / "data") as http:
        deadline, answers = time.monotonic() + 60, []
        while not any(answer.status_code == 422 for answer in answers) and time.monotonic() < deadline:
            text = large_robot(3000, f"r{len(answers)}")
            request = threading.Thread(target=lambda text=text: answers.append(http.post("/v1/robots", content=text)))
            request.start()
            staging = tmp_path / "data" / "staging"
            wait_until(lambda: any(staging.iterdir()) or not request.is_alive())  # noqa: B023
            kill_workers(http)
            request.join()
        died = next(answer for answer in answers if answer.status_code == 422)
        assert died.json()["type"] == "urn:twolink:worker-died"
        http.ask("/v1/robots", pendulum())
        assert http.ask("/health")["status"] == "ok"
        assert "twolink_worker_deaths_total" in http.get("/metrics").text


def kill_workers(served: Served) -> None:
    for process in served.workers():
        os.kill(process, signal.SIGKILL)


def test_jobs_that_an_earlier_version_has_queued_are_run_or_say_what_they_lack(tmp_path: Path) -> None:
    """Theirs have `samples` where this version has `samples_per_second`."""
    folder, ids = tmp_path / "data", [f"simulation-{k:020x}" for k in range(2)]
    old = {"scene": "arm-swing", "duration": 1.5, "samples": 50.0}, {"scene": "arm-swing", "colour": "red"}
    store = Store(folder, Quotas())
    for key, request in zip(ids, old, strict=True):
        store.new_job(key, "simulation", json.dumps(request).encode())
    store.close()
    with serving(folder) as http:
        done, failed = (ended(http, f"/v1/simulations/{key}") for key in ids)
        assert done["state"] == "done"
        assert len(http.ask(f"/v1/simulations/{ids[0]}/result")["columns"]["t"]) == 76
        assert (failed["state"], failed["problem"]["code"]) == ("failed", "other-version")
        assert "colour" in failed["problem"]["detail"]


def test_a_killed_service_loses_nothing_that_was_done(tmp_path: Path) -> None:
    folder = tmp_path / "data"
    with serving(folder, "--quota", "jobs=1") as http:
        done = http.ask("/v1/simulations", SWING)
        assert done["state"] == "done"
        path = http.begin(SLOW)
        started(http, path)
        waiting = http.begin({**SWING, "duration": 1.5, "wait": 0})
        left = http.workers()
        http.kill()
    with serving(folder) as http:
        job = http.ask(path)
        assert (job["state"], job["problem"]["code"]) == ("interrupted", "interrupted")
        assert f"interrupted by the end of an earlier run: simulation {job['id']}" in http.log
        assert http.ask(waiting)["state"] in ("queued", "running", "done")
        kept = http.ask(f"/v1/simulations/{done['id']}")
        assert kept["result"] == done["result"]
        assert len(http.ask(f"/v1/simulations/{done['id']}/result")["columns"]["t"]) == 201
        assert http.ask(f"{path}/run", {})["state"] in ("queued", "running")
        http.post(f"{path}/cancel")
        assert ended(http, path)["state"] == "cancelled"
    assert_gone(left)


def assert_gone(processes: list[int]) -> None:
    """Orphaned workers end by themselves."""
    wait_until(lambda: not any(Path(f"/proc/{process}").exists() for process in processes))


@pytest.mark.slow
def test_a_service_that_ends_leaves_its_job_to_the_next_and_no_process(tmp_path: Path) -> None:
    folder = tmp_path / "data"
    with serving(folder) as http:
        path = http.begin(SLOW)
        started(http, path)
        left = http.workers()
    assert http.process.returncode == 0
    assert "Traceback" not in http.log
    assert_gone(left)
    with serving(folder) as http:
        started(http, path)
        assert "interrupted" not in http.log


@pytest.mark.slow
def test_what_is_damaged_on_the_disk_is_no_fault_of_the_request(tmp_path: Path) -> None:
    """It was called the client's: "the body is not JSON". Deleted and sent again, it is whole."""
    folder = tmp_path / "data"
    with serving(folder) as http:
        robot = http.ask("/v1/robots", pendulum())["id"]
        request = {"scene": {"robot": robot, "effects": [{"type": "gravity"}]}, "duration": 0.5, "wait": 30}
        job = http.ask("/v1/simulations", request)["id"]
    for path, content in (("robots/*/robot.urdf", b"<robot"), ("results/*/result.npz", b"\0"),
                          ("robots/*/options.json", b"{")):  # fmt: skip
        (damaged,) = folder.glob(path)
        damaged.write_bytes(content)
        with serving(folder) as http:
            asked = {"robots": (f"/v1/robots/{robot}/mass-matrix", {"q": [0.0]}),
                     "results": (f"/v1/simulations/{job}/motion", None)}  # fmt: skip
            url, body = asked[path.partition("/")[0]]
            problem = http.ask(url, body, 500)
            assert problem["code"] == "damaged-storage"
            assert str(tmp_path) not in str(problem)
            assert "Traceback" in http.log
            http.delete(url.rpartition("/")[0]).raise_for_status()
            assert http.ask("/v1/robots", pendulum())["id"] == robot
            job = http.ask("/v1/simulations", request)["id"]
            http.ask(url, body)


def test_a_drawing_that_is_damaged_on_the_disk_is_made_again(tmp_path: Path) -> None:
    """It was sent as it was."""
    folder = tmp_path / "data"
    with serving(folder) as http:
        job = f"/v1/simulations/{http.ask('/v1/simulations', SWING | {'wait': 30})['id']}"
        paths = ["/v1/robots/two_link/visuals", f"{job}/figure", f"{job}/playback", f"{job}/result?format=csv"]
        whole = [undated(http.get(path).content) for path in paths]
        made = [*folder.glob("visuals/*.json.gz"), *folder.glob("results/*/*.svg"), *folder.glob("results/*/*.html"),
                *folder.glob("results/*/*.csv")]  # fmt: skip
        for path, content, file in zip(paths, whole, made, strict=True):
            for damaged in (b"", file.read_bytes()[:-20], b"<svg/>"):
                file.write_bytes(damaged)
                assert undated(http.get(path).content) == content
            assert f"{file.name} is damaged on the disk" in http.log


def undated(drawing: bytes) -> bytes:
    return re.sub(rb"<dc:date>.*?</dc:date>", b"", drawing)


def test_a_folder_in_use_is_refused(tmp_path: Path) -> None:
    """Two services on one folder would each take the other's jobs for interrupted."""
    with serving(tmp_path / "data") as http:
        http.post("/v1/simulations", json=SWING)
        one_line(call_process("serve", "--port", "0", "--data", str(tmp_path / "data")), 1, "--data")
        assert http.ask("/health")["status"] == "ok"


@pytest.mark.slow
def test_jobs_of_version_1_can_be_run_again(tmp_path: Path) -> None:
    folder = tmp_path / "data"
    folder.mkdir()
    with contextlib.closing(sqlite3.connect(folder / "twolink.sqlite")) as database:
        database.executescript(f"""
            CREATE TABLE robots (id TEXT PRIMARY KEY, created REAL, used REAL, bytes INTEGER, description TEXT)
                WITHOUT ROWID;
            CREATE TABLE jobs (
                id TEXT PRIMARY KEY, kind TEXT, request TEXT, state TEXT, owner TEXT, created REAL, started REAL,
                ended REAL, used REAL, progress TEXT, problem TEXT, result TEXT, bytes INTEGER DEFAULT 0,
                cancel INTEGER DEFAULT 0
            ) WITHOUT ROWID;
            CREATE INDEX jobs_by_state ON jobs (state);
            INSERT INTO jobs VALUES ('s-1', 'simulation', '{json.dumps(SWING)}', 'done', 'x', 1.0, 1.0, 2.0, 2.0,
                NULL, NULL, '{{"events": ["t = 1 s: impact"]}}', 10, 0);
            PRAGMA user_version = 1;
        """)
    with serving(folder) as http:
        assert [(job["id"], job["state"]) for job in http.ask("/v1/simulations")] == [("s-1", "interrupted")]
        http.post("/v1/simulations/s-1/run")
        assert ended(http, "/v1/simulations/s-1")["result"]["samples"] == 201


def test_a_job_whose_result_is_stored_is_alive() -> None:
    """Else another process takes it up after some seconds, though it is done."""
    beaten: list[str] = []

    async def run(method: Any, *arguments: Any) -> Any:
        return method(*arguments)

    leases = SimpleNamespace(waiting=lambda _: set(), beat=lambda key, _: beaten.append(key))
    running = Running("simulation", None, claimed=True, ending=True)
    jobs: Any = SimpleNamespace(running={"simulation-1": running})
    store: Any = SimpleNamespace(leases=leases, run=run)
    asyncio.run(beat(store, jobs))
    assert beaten == ["simulation-1"]
    assert not running.lost  # though the lease is: it is too late to end it
