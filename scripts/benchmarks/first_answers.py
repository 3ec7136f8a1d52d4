"""Seconds of the first and the eighth answer of each bundled scene and of 22 robots, beside SciPy over Pinocchio.

    python -m scripts.benchmarks.first_answers [SCENE|ROBOT ...] [--runs 8] [--limit 60] [--quick]

Robots fall for 2 s under gravity, with joints damped by 0.1 N m s/rad or N s/m. first: of a new process with an empty
cache, without the import of the package; cached: the first of a new process with the cache that the one before left;
last: the minimum of the last three of its runs. Processor time, with the error bar. SciPy: the cheapest of DOP853, RK45
and LSODA on Pinocchio's rates that comes within the accuracy, without an error bar; none for scenes with events. A bar
is that the first takes at most 2 times the last and 0.2 s. Writes out/first_answers.csv. --limit: s, of the runs of one
process. --quick: the first two scenes.
"""

import functools
import importlib
import itertools
import subprocess
import sys
import tempfile
import time

import numpy as np

import twolink as tl
from scripts.runner import Table, new_process, once, options, print_bars
from twolink.errors import TwolinkError

ACCURACY, DURATION, DAMPING = 1e-6, 2.0, 0.1
TOLERANCES = (1e-7, 1e-8, 1e-9, 1e-10)
EVERY = 4  # robots of the catalogue, of which one is taken
RUNS = f"""
import sys, time, twolink as tl
from scripts.benchmarks.first_answers import scene_of
scene = scene_of(sys.argv[1])
for _ in range(int(sys.argv[2])):
    start = time.process_time()
    run = tl.simulate(scene, accuracy={ACCURACY})
    print(time.process_time() - start, flush=True)
"""


def scene_of(name: str) -> tl.Scene:
    """A bundled scene, or a robot that falls."""
    if name in (one["name"] for one in tl.scenes().to_records()):
        return tl.load_scene(name)
    robot = tl.load_robot(name)
    damped = {joint.name: DAMPING for joint in robot.joints if joint.kind != "free-flyer"}
    q, v = robot.random_state(1, seed=0)
    effects = [tl.effects.Gravity(), *([tl.effects.JointDamping(damped)] if damped else [])]
    return tl.Scene(robot, q[0], v[0], effects=effects, duration=DURATION)


def names() -> list[str]:
    """All bundled scenes, and one of EVERY robots."""
    robots = [one["name"] for one in tl.robots().to_records() if not one["refused"]]
    return [*(one["name"] for one in tl.scenes().to_records()), *robots[::EVERY]]


def seconds(name: str, runs: int, limit: float) -> tuple[float, float, float, str]:
    """First, cached and last; and what went wrong."""
    with tempfile.TemporaryDirectory() as cache:
        try:
            done = [new_process(RUNS, name, str(n), cache=cache, timeout=limit) for n in (1, runs)]
        except subprocess.TimeoutExpired:
            return np.nan, np.nan, np.nan, f"more than {limit:g} s"
    if any(one.returncode for one in done):
        return np.nan, np.nan, np.nan, next(one for one in done if one.returncode).stderr.strip().splitlines()[-1][:90]
    (first,), every = ([float(line) for line in one.stdout.splitlines()] for one in done)
    return first, every[0], min(every[-3:]), ""


def by_scipy(name: str) -> tuple[float, str]:
    """Seconds of the cheapest run by SciPy that comes within the accuracy, and its method; NaN where there is none."""
    importlib.import_module("scipy.integrate")
    scene, found = scene_of(name), list[tuple[float, str]]()
    try:
        truth = tl.simulate(scene, accuracy=ACCURACY / 100)
    except TwolinkError:
        return np.nan, "no truth"
    for method, tolerance in itertools.product(("scipy-dop853", "scipy-rk45", "scipy-lsoda"), TOLERANCES):
        run = functools.partial(tl.simulate, scene, accuracy=ACCURACY, method=method, tolerance=tolerance, verify=False)
        try:
            taken, answer = once(run, time.process_time)
        except TwolinkError:
            continue
        if np.abs(scene.robot.difference(truth.q, answer.q)).max() < ACCURACY:
            found.append((taken, method.removeprefix("scipy-")))
    return min(found, default=(np.nan, "none"))


def peer(name: str, limit: float) -> tuple[float, str]:
    """`by_scipy` in a process of its own."""
    try:
        done = new_process(f"from scripts.benchmarks.first_answers import by_scipy\nprint(*by_scipy({name!r}))",
                           timeout=limit)  # fmt: skip
    except subprocess.TimeoutExpired:
        return np.nan, "too long"
    seconds, method = done.stdout.split(maxsplit=1)
    return float(seconds), method.strip()


def main() -> int:
    given = options(__doc__, rest=(), runs=8, limit=60.0, quick=False)
    table = Table("scene <18 | first >8.3f | cached >8.3f | last >8.3f | scipy >8.3f | method <8 | why none <40")
    chosen, slow, answered = given.rest or names(), 0, 0
    for name in chosen[:2] if given.quick else chosen:
        first, cached, last, wrong = seconds(name, given.runs, given.limit)
        table.add(name, first, cached, last, *(peer(name, given.limit) if not wrong else (np.nan, "")), wrong)
        answered, slow = answered + (not wrong), slow + (first > 2.0 * last + 0.2)
    table.save("first_answers")
    at_once = f"{answered - slow} of {answered} first answers take at most 2 later ones and 0.2 s"
    in_time = f"{answered} of {len(table.rows)} answer in time"
    return not print_bars([(slow == 0, at_once), (answered == len(table.rows), in_time)])


if __name__ == "__main__":
    sys.exit(main())
