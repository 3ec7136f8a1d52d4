"""The service answers /health at once and keeps to its memory while all that may be asked of it is asked at once."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.parts.service.serving import Served, wait_until
from tests.parts.service.under_attack import attack


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
print(uvicorn_options(Settings(data="."))["http"].args[0].connections.limit)
"""
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert float(answer.stdout) == 300
