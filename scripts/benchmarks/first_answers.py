"""Seconds to the first answer of a scene in a new process, import of the package excluded, beside SciPy over Pinocchio.

    python -m scripts.benchmarks.first_answers [SCENE ...] [--rounds 3] [--quick]

Columns: cold, with an empty cache; cached, in a new process with the cache that the first left; again, a second run in
that process; SciPy: the cheapest of DOP853, RK45 and LSODA on Pinocchio's rates that comes within the accuracy,
imported before, nothing to compile. Ours are with the error bar, SciPy is without one. Medians of rounds. Writes
out/first_answers.csv. --quick: the first two scenes, one round.
"""

import importlib
import statistics
import tempfile

import numpy as np

import twolink as tl
from scripts.runner import Table, new_process, once, options
from twolink.errors import TwolinkError

SCENES = ("arm-swing", "panda-hold", "crankshaft", "squeezer", "pitch")
ACCURACY = 1e-6
TOLERANCES = (1e-7, 1e-8, 1e-9, 1e-10)
TOO_LONG = 5.0  # s: after a run of SciPy that took longer, no smaller tolerance is tried
RUNS = f"""
import sys, time, twolink as tl
scene = tl.load_scene(sys.argv[1])
for _ in range(2):
    start = time.perf_counter()
    run = tl.simulate(scene, accuracy={ACCURACY})
    print(time.perf_counter() - start, run.cost.compiled or "-")
"""


def seconds(scene: str) -> tuple[float, float, float, str]:
    """Cold, cached and again; and what was compiled."""
    with tempfile.TemporaryDirectory() as cache:
        done = [new_process(RUNS, scene, cache=cache) for _ in range(2)]
    if any(one.returncode for one in done):
        return np.nan, np.nan, np.nan, done[0].stderr.strip().splitlines()[-1][:60]
    (cold, _), (cached, again) = ([line.split() for line in one.stdout.splitlines()] for one in done)
    return float(cold[0]), float(cached[0]), float(again[0]), cold[1]


def by_scipy(name: str) -> tuple[float, str]:
    """Seconds of the cheapest run by SciPy that comes within the accuracy, and its method; NaN where there is none."""
    importlib.import_module("scipy.integrate")
    scene, found = tl.load_scene(name), list[tuple[float, str]]()
    truth = tl.simulate(scene, accuracy=ACCURACY / 100)
    for method in ("scipy-dop853", "scipy-rk45", "scipy-lsoda"):
        for tolerance in TOLERANCES:
            try:
                taken, run = once(lambda m=method, e=tolerance: tl.simulate(scene, accuracy=ACCURACY, method=m,
                                                                            tolerance=e, verify=False))  # fmt: skip
            except TwolinkError:
                break
            close = np.abs(scene.robot.difference(truth.q, run.q)).max() < ACCURACY
            found += [(taken, method.removeprefix("scipy-"))] if close else []
            if close or taken > TOO_LONG:
                break
    return min(found, default=(np.nan, "none"))


def main() -> None:
    given = options(__doc__, rest=SCENES, rounds=3, quick=False)
    table = Table("scene <14 | cold >8.3f | cached >8.3f | again >8.3f | scipy >8.3f | compiled <8 | SciPy's method <8")
    for scene in given.rest[:2] if given.quick else given.rest:
        rows = [seconds(scene) for _ in range(1 if given.quick else given.rounds)]
        peer, method = by_scipy(scene)
        table.add(scene, *(statistics.median(row[i] for row in rows) for i in range(3)), peer, rows[0][3], method)  # type: ignore[type-var]
    table.save("first_answers")


if __name__ == "__main__":
    main()
