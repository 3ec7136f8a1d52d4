"""Hostile bodies and attacks: each is refused with a problem; none ends the service, stalls it or shows a file."""

import os
import subprocess
import sys
import time
from pathlib import Path

import httpx
import pytest

from tests.parts.service.hostile import Case, cases
from tests.parts.service.serving import Served, wait_until
from tests.parts.service.under_attack import attack


def sent(http: Served, case: Case) -> httpx.Response:
    return http.post(case.path, content=case.body, headers={"Content-Type": case.media})


@pytest.mark.slow
def test_each_is_refused_and_the_service_goes_on(http: Served) -> None:
    corpus = cases()
    assert len(corpus) >= 200
    wrong = []
    for case in corpus:
        answer = sent(http, case)
        if answer.status_code == 202:
            answer = http.get(f"{answer.headers['location']}/events")  # jobs say it at their end
            if '"state":"failed"' not in answer.text:
                wrong.append((case.name, answer.text[-200:]))
        elif not 400 <= answer.status_code < 500:
            wrong.append((case.name, f"{answer.status_code} {answer.text[:200]}"))
        elif answer.headers["content-type"] != "application/problem+json" or not answer.json()["detail"]:
            wrong.append((case.name, answer.text[:200]))
        if "root:" in answer.text or "Traceback" in answer.text:
            wrong.append((case.name, answer.text[:200]))
    assert not wrong, "\n".join(f"{name}: {what}" for name, what in wrong)
    assert http.process.poll() is None
    assert "unexpected" not in http.log
    http.ask("/v1/robots/two_link/bias", {"q": [0, 0]})
    states = [job["state"] for job in http.ask("/v1/simulations")]
    assert "running" not in states


def test_slow_clients_do_not_starve_others(http: Served) -> None:
    slow = [http.connect() for _ in range(300)]
    try:
        for k, connection in enumerate(slow):
            part = b"POST /v1/robots/two_link/bias HTTP/1.1\r\nHost: localhost\r\nContent-Length: 1000\r\n"
            connection.sendall(part[: k % 90] if k % 2 else part + b"\r\n{")
        start = time.monotonic()
        for _ in range(50):
            http.ask("/v1/robots/two_link/bias", {"q": [0, 0]})
        assert time.monotonic() - start < 60  # they would be starved for longer
    finally:
        for connection in slow:
            connection.close()
    http.ask("/health")
    assert "Traceback" not in http.log  # when they go in the middle


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [6.0, 60.0])
def test_the_service_stays_up_under_attack(seconds: float) -> None:
    figures = attack(seconds)
    bars = figures.bars(busy="PYTEST_XDIST_WORKER" in os.environ)  # beside other tests
    assert all(met for met, _ in bars), f"{bars}\n{figures.summary()}\n{figures.outcomes}"


def test_workers_yield_unless_a_client_waits_for_a_query(served: Served) -> None:
    def niceness() -> dict[bool, set[int]]:
        """Of the workers that answer queries, and of the others."""
        found: dict[bool, set[int]] = {True: set(), False: set()}
        for process in served.workers():
            answers_queries = b"robot_tasks" in Path(f"/proc/{process}/cmdline").read_bytes()
            found[answers_queries].add(os.getpriority(os.PRIO_PROCESS, process))
        return found

    own = os.getpriority(os.PRIO_PROCESS, served.process.pid)
    wait_until(lambda: niceness() == {True: {own}, False: {min(19, own + 10)}})


def test_connections_leave_files_for_the_service() -> None:
    code = """
import resource
resource.setrlimit(resource.RLIMIT_NOFILE, (300, 500))
from twolink.parts.service.http.server import uvicorn_options
from twolink.parts.service.settings import Settings
print(uvicorn_options(Settings(data="."))["http"].args[0].limit)
"""
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert float(answer.stdout) == 300
