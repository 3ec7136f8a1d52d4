"""Seconds of the first and the eighth answer of each bundled scene and of 22 robots, beside SciPy over Pinocchio.

    python -m scripts.benchmarks.first_answers [SCENE|ROBOT ...] [--runs 8] [--limit 60] [--quick]

Robots fall for 2 s under gravity, with joints damped by 0.1 N m s/rad or N s/m. first: of a new process with an empty
cache, without the import of the package; cached: the first of a new process with the cache that the one before left;
last: the minimum of the last three of its runs. Processor time, with the error bar. SciPy: the cheapest of DOP853, RK45
and LSODA on `pin.aba` that comes within the accuracy, without an error bar; none for scenes of more than smooth joints.
A bar is that the first takes at most 2 times the last and 0.2 s. Writes out/first_answers.csv. --limit: s, of the runs
of one process. --quick: the first two scenes.
"""

import subprocess
import sys
import tempfile
import time

import numpy as np

import twolink as tl
from scripts.runner import Table, new_process, once, options, print_bars
from scripts.tasks import by_scipy, loaded, runs_anew, scene_of
from twolink.errors import TwolinkError
from twolink.hard.peers.task import UnsupportedError

ACCURACY = 1e-6
EVERY = 4  # robots of the catalogue, of which one is taken


def seconds(name: str, runs: int, limit: float) -> tuple[float, float, float, str]:
    """First, cached and last; and what went wrong."""
    with tempfile.TemporaryDirectory() as cache:
        try:
            (first,), every = (runs_anew(name, ACCURACY, n, cache=cache, timeout=limit) for n in (1, runs))
        except (subprocess.TimeoutExpired, RuntimeError) as error:
            return np.nan, np.nan, np.nan, str(error)[-90:]
    return first, every[0], min(every[-3:]), ""


def scipys(name: str) -> tuple[float, str]:
    """Seconds of SciPy's cheapest run, and its method."""
    try:
        scene = scene_of(name)
        call, method = by_scipy(scene, tl.simulate(scene, accuracy=ACCURACY / 100), ACCURACY)
    except (TwolinkError, UnsupportedError) as error:
        return np.nan, type(error).__name__
    return once(call, time.process_time)[0], method


def peer(name: str, limit: float) -> tuple[float, str]:
    """`scipys` in a process of its own."""
    code = f"from scripts.benchmarks.first_answers import scipys\nprint(*scipys({name!r}))"
    try:
        seconds, method = new_process(code, timeout=limit).stdout.split(maxsplit=1)
    except subprocess.TimeoutExpired:
        return np.nan, "too long"
    return float(seconds), method.strip()


def main() -> int:
    given = options(__doc__, rest=(), runs=8, limit=60.0, quick=False)
    table = Table("scene <18 | first >8.3f | cached >8.3f | last >8.3f | scipy >8.3f | method <16 | why none <40")
    chosen = given.rest or [*loaded(tl.scenes), *loaded(tl.robots)[::EVERY]]
    for name in chosen[:2] if given.quick else chosen:
        *times, wrong = seconds(name, given.runs, given.limit)
        table.add(name, *times, *(peer(name, given.limit) if not wrong else (np.nan, "")), wrong)
    table.save("first_answers")
    answered = [row for row in table.rows if not row[-1]]
    slow = sum(row[1] > 2.0 * row[3] + 0.2 for row in answered)
    return not print_bars([
        (not slow, f"{len(answered) - slow} of {len(answered)} first answers take at most 2 later ones and 0.2 s"),
        (len(answered) == len(table.rows), f"{len(answered)} of {len(table.rows)} answer in time"),
    ])  # fmt: skip


if __name__ == "__main__":
    sys.exit(main())
