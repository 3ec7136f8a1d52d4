"""Functions of a run for tests of sweeps; each leaves a line in the file that TWOLINK_TEST_LOG names."""

import os
import signal
import time
from pathlib import Path

from twolink.dynamics.threads import thread_count
from twolink.simulation.trajectory import Trajectory


def _record(run: Trajectory) -> float:
    """The elbow's start, which is written down."""
    elbow = float(run.q[0, 1])
    with Path(os.environ["TWOLINK_TEST_LOG"]).open("a") as file:
        file.write(f"{elbow!r}\n")
    return elbow


def reproducible(_run: Trajectory) -> float:
    """1 where runs are computed on one thread."""
    return float(thread_count() == 1)


def start(run: Trajectory) -> float:
    return _record(run)


def slow_start(run: Trajectory) -> float:
    time.sleep(0.15)
    return _record(run)


def kills_once(run: Trajectory) -> float:
    elbow = _record(run)
    mark = Path(os.environ["TWOLINK_TEST_LOG"] + ".killed")
    if elbow == 3.0 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return elbow


def kills(run: Trajectory) -> float:
    if _record(run) == 3.0:
        os.kill(os.getpid(), signal.SIGKILL)
    return float(run.q[0, 1])


def lacks_memory(run: Trajectory) -> float:
    if _record(run) == 3.0:
        raise MemoryError("too large")
    return float(run.q[0, 1])
