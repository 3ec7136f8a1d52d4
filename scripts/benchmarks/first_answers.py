"""Seconds to the first answer of a scene in a new process, import of the package excluded, beside SciPy over Pinocchio.

    python scripts/bench_first_answer.py [SCENE ...] [--rounds 3] [--quick]

Columns: cold, with an empty cache; cached, in a new process with the cache that the first left; again, a second run in
that process; SciPy: the cheapest of DOP853, RK45 and LSODA on Pinocchio's rates that comes within the accuracy,
imported before, nothing to compile. Ours are with the error bar, SciPy is without one. Medians of rounds. Writes
out/bench_first_answer.csv. With --parts it measures what steps in parts cost (EVALUATION and WORLD in
twolink/integrate/first_steps.py).
"""

import argparse
import importlib
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import twolink as tl
from twolink.errors import TwolinkError
from twolink.integrate.methods import METHODS
from twolink.integrate.scene_equations import equations_of
from twolink.integrate.step_control import initial_state
from twolink.integrate.step_map import step_map
from twolink.io.tables import write_table

OUT = Path(__file__).parents[1] / "out" / "bench_first_answer.csv"
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


def seconds(scene: str, cache: str) -> list[tuple[float, str]]:
    """Two runs of a scene in a new process: seconds, and what was compiled."""
    environment = {**os.environ, "TWOLINK_CACHE": cache}
    done = subprocess.run([sys.executable, "-c", RUNS, scene], env=environment, capture_output=True, text=True)
    if done.returncode:
        return [(float("nan"), done.stderr.strip().splitlines()[-1][:60])] * 2
    return [(float(line.split()[0]), line.split()[1]) for line in done.stdout.splitlines()]


def by_scipy(name: str) -> tuple[float, str]:
    """Seconds of the cheapest run by SciPy that comes within the accuracy, and its method; NaN where there is none."""
    importlib.import_module("scipy.integrate")
    scene = tl.load_scene(name)
    truth, found = tl.simulate(scene, accuracy=ACCURACY / 100), [(float("nan"), "none")]
    for method in ("scipy-dop853", "scipy-rk45", "scipy-lsoda"):
        for tolerance in TOLERANCES:
            start = time.perf_counter()
            try:
                run = tl.simulate(scene, accuracy=ACCURACY, method=method, tolerance=tolerance, verify=False)
            except TwolinkError:
                break
            taken = time.perf_counter() - start
            close = np.abs(scene.robot.difference(truth.q, run.q)).max() < ACCURACY
            if close:
                found.append((taken, method.removeprefix("scipy-")))
            if close or taken > TOO_LONG:
                break
    return min(found[1:], default=found[0])


def table(scenes: list[str], rounds: int) -> None:
    """Print the seconds of each scene."""
    columns: dict[str, list[float | str]] = {name: [] for name in ("scene", "cold", "cached", "again", "scipy")}
    print(f"{'scene':<14}{'cold':>9}{'cached':>9}{'again':>9}{'SciPy':>9}  compiled, SciPy's method")
    for scene in scenes:
        rows = []
        for _ in range(rounds):
            with tempfile.TemporaryDirectory() as cache:
                cold, cached = seconds(scene, cache), seconds(scene, cache)
                rows.append((cold[0][0], cached[0][0], cached[1][0]))
        peer, method = by_scipy(scene)
        medians = [*(statistics.median(row[i] for row in rows) for i in range(3)), peer]
        print(f"{scene:<14}" + "".join(f"{m:>9.3f}" for m in medians) + f"  {cold[0][1]}, {method}", flush=True)
        for values, value in zip(columns.values(), (scene, *medians), strict=True):
            values.append(value)
    print(f"wrote {write_table(OUT, {name: np.array(values) for name, values in columns.items()}, {})}")


def parts() -> None:
    """Print the seconds of an evaluation within a step in parts, and of a world in it."""
    method = METHODS["dop853"]
    for name in ("panda-hold", "squeezer"):
        equations = equations_of(tl.load_scene(name))
        steps = step_map(equations, method)
        if steps.compiled != "parts":
            print(f"{name}: whole steps are compiled at once, or at hand: try TWOLINK_CACHE=off")
            continue
        taken = []
        for worlds in (1, 1000):
            x = np.repeat(equations.start[:, None], worlds, axis=1)
            state = initial_state(x, 0.0, 1e-3, 1.0, np.inf)
            out, rounds = np.empty_like(state), []
            for _ in range(20):
                start = time.perf_counter()
                steps(state, out)
                rounds.append((time.perf_counter() - start) / method.evaluations)
            taken.append(statistics.median(rounds))
        print(f"{name}: an evaluation {taken[0]:.1e} s, a world more {(taken[1] - taken[0]) / 999:.1e} s")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", default=list(SCENES), help=f"bundled scenes ({' '.join(SCENES)})")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--quick", action="store_true", help="the first two scenes, one round")
    parser.add_argument("--parts", action="store_true", help="the cost of steps in parts")
    options = parser.parse_args()
    scenes, rounds = (options.scenes[:2], 1) if options.quick else (options.scenes, options.rounds)
    parts() if options.parts else table(scenes, rounds)


if __name__ == "__main__":
    main()
