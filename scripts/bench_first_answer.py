"""Seconds to the first answer of a scene in a new process, import of the package excluded, beside SciPy over Pinocchio.

    python scripts/bench_first_answer.py [SCENE ...] [--rounds 3]

Columns: cold, with an empty cache; cached, in a new process with the cache that the first left; again, a second run in
that process; SciPy's DOP853 on Pinocchio's rates with nothing to compile, at a tolerance a tenth of the accuracy. The
first two are with the error bar, the last is without one. Medians of rounds. With --parts it measures what steps in
parts cost (EVALUATION and WORLD in twolink/integrate/first_steps.py).
"""

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time

import numpy as np

import twolink as tl
from twolink.integrate.methods import METHODS
from twolink.integrate.scene_equations import equations_of
from twolink.integrate.step_control import initial_state
from twolink.integrate.step_map import step_map

SCENES = ("arm-swing", "panda-hold", "crankshaft", "squeezer", "pitch")
ACCURACY = 1e-6
RUNS = f"""
import sys, time, twolink as tl
scene, options = tl.load_scene(sys.argv[1]), {{}}
if sys.argv[2] == "scipy":
    options = dict(method="scipy-dop853", tolerance={ACCURACY / 10}, verify=False)
for _ in range(2):
    start = time.perf_counter()
    run = tl.simulate(scene, accuracy={ACCURACY}, **options)
    print(time.perf_counter() - start, run.cost.compiled or "-")
"""


def seconds(scene: str, kind: str, cache: str) -> list[tuple[float, str]]:
    """Two runs of a scene in a new process: seconds, and what was compiled."""
    environment = {**os.environ, "TWOLINK_CACHE": cache}
    done = subprocess.run([sys.executable, "-c", RUNS, scene, kind], env=environment, capture_output=True, text=True)
    if done.returncode:
        return [(float("nan"), done.stderr.strip().splitlines()[-1][:60])] * 2
    return [(float(line.split()[0]), line.split()[1]) for line in done.stdout.splitlines()]


def table(scenes: list[str], rounds: int) -> None:
    """Print the seconds of each scene."""
    print(f"{'scene':<14}{'cold':>9}{'cached':>9}{'again':>9}{'SciPy':>9}  compiled")
    for scene in scenes:
        rows = []
        for _ in range(rounds):
            with tempfile.TemporaryDirectory() as cache:
                cold, cached = seconds(scene, "own", cache), seconds(scene, "own", cache)
                rows.append((cold[0][0], cached[0][0], cached[1][0], seconds(scene, "scipy", cache)[0][0], cold[0][1]))
        medians = [statistics.median(row[i] for row in rows) for i in range(4)]
        print(f"{scene:<14}" + "".join(f"{m:>9.3f}" for m in medians) + f"  {rows[0][4]}", flush=True)


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
    parser.add_argument("--parts", action="store_true", help="the cost of steps in parts")
    options = parser.parse_args()
    parts() if options.parts else table(options.scenes, options.rounds)


if __name__ == "__main__":
    main()
