"""What the native library costs beside its peers: runs from an empty cache on, batches of states, and single steps.

    python -m scripts.benchmarks.machine [--rounds 7] [--quick]

Processor seconds on one thread, minima after warm-up, all in turns.

Runs: gravity acts for 2 s. first: of a new process with an empty cache; eighth: the minimum of runs 8 on,
verified to the accuracy. SciPy: the cheapest of its methods on `pin.aba` whose true error is not larger than ours, or
its tightest; both errors are against a run of 1e-12. alone: one run of ours without its error bar. Batches: forward
dynamics over a loop of `pin.aba` and over `pin.abaInParallel`. Steps: `Simulation.step` of 1 ms over `mj_step`.
--quick: fewer robots.
"""

import functools
import sys
import time

import mujoco
import numpy as np
import pinocchio as pin

import twolink as tl
from scripts.benchmarks.queries import mujoco_model
from scripts.runner import Bars, Table, many, options, print_bars, seconds_of
from scripts.tasks import alone, by_scipy, robot_of, runs_anew, scene_of

ACCURACIES, EIGHTH = (1e-3, 1e-6, 1e-9), 8
BATCHES = (2, 10, 100, 1_000, 10_000, 100_000)
BARS = {"arm": (3.0, (20, 30, 40)), "ur5": (2.0, (8, 10, 12)), "panda": (2.0, (6, 8, 8))}  # eighth; alone by accuracy
least = functools.partial(seconds_of, clock=time.process_time, pick=min)


def runs(names: list[str], rounds: int) -> Bars:
    """The table of runs, and its bars."""
    table = Table("robot <8 | accuracy >8.0e | first s >8.2f | again ms >9.2f | alone ms >9.2f | SciPy ms >9.2f "
                  "| method <14 | eighth >7.2f | alone over >10.1f | verified over alone >8.2f")  # fmt: skip
    bars = []
    for name in names:
        scene = scene_of(f"bent {name}")
        exact = tl.simulate(scene, accuracy=1e-12)
        for accuracy, wanted in zip(ACCURACIES, BARS[name][1], strict=True):
            (first,) = runs_anew(f"bent {name}", accuracy)
            ours = tl.simulate(scene, accuracy=accuracy)
            call, method = by_scipy(scene, exact, float(np.abs(ours.q - exact.q).max()))
            calls = functools.partial(tl.simulate, scene, accuracy=accuracy), alone(scene, accuracy, ours), call
            again, bare, theirs = least(*calls, rounds=rounds, warm_up=EIGHTH - 1)
            eighth, over = theirs / again, theirs / bare
            table.add(name, accuracy, first, 1e3 * again, 1e3 * bare, 1e3 * theirs, method, eighth, over, again / bare)
            bars += [(eighth >= BARS[name][0], f"{name}, {accuracy:g}: the eighth verified run is {eighth:.2f} times "
                                               f"faster than SciPy (bar: {BARS[name][0]:g})"),
                     (over >= wanted, f"{name}, {accuracy:g}: alone {over:.1f} (bar: {wanted})")]  # fmt: skip
    table.save("machine-runs")
    return bars


def one_by_one(model: pin.Model, data: pin.Data, *states: np.ndarray) -> None:
    """A loop of `pin.aba`."""
    for q, v, tau in zip(*states, strict=True):
        pin.aba(model, data, q, v, tau)


def batches(names: list[str], rounds: int) -> Bars:
    """The table of batches, and its bars."""
    table = Table("robot <8 | states >7 | ns a state >10.0f | over the loop >8.1f | over abaInParallel >8.1f")
    bars = []
    for name in names:
        robot, worst = robot_of(name), np.inf
        model, data, pool = robot.model, robot.model.createData(), pin.ModelPool(robot.model, 1)
        for count in BATCHES:
            q, v = robot.random_state(count, seed=1)
            tau, few = np.random.default_rng(1).uniform(-1, 1, v.shape), min(count, 1000)
            columns, out = [np.asfortranarray(x.T) for x in (q, v, tau)], np.empty((robot.nv, count), order="F")
            ours, single, parallel = least(
                functools.partial(robot.forward_dynamics, q, v, tau),
                functools.partial(one_by_one, model, data, q[:few], v[:few], tau[:few]),
                functools.partial(pin.abaInParallel, 1, pool, *columns, out),
                rounds=max(rounds, min(200, 20_000 // count)), warm_up=3,
            )  # fmt: skip
            ratios = single * count / few / ours, parallel / ours
            worst = min(worst, *ratios)
            table.add(name, count, 1e9 * ours / count, *ratios)
        bars.append((worst >= 1.0, f"{name}: never slower than Pinocchio: {worst:.2f} times as fast at least (bar: 1)"))
    table.save("machine-batches")
    return bars


def steps(rounds: int) -> Bars:
    """Single steps of a Panda, and their bars."""
    robot = robot_of("panda")
    scene, model, tau = tl.Scene(robot, effects=[tl.effects.Gravity()]), mujoco_model(robot), np.zeros(robot.nv)
    model.opt.timestep = 1e-3
    plain, verified = (tl.Simulation(scene, verify=verify) for verify in (False, True))
    calls = (lambda: plain.step(1e-3, tau), lambda: verified.step(1e-3, tau),
             functools.partial(mujoco.mj_step, model, mujoco.MjData(model)))  # fmt: skip
    alone, full, theirs = (1e4 * taken for taken in least(*(many(one, 100) for one in calls), rounds=5 * rounds))
    print(f"step of 1 ms, Panda: {alone:.1f} us, verified {full:.1f}, mj_step {theirs:.1f}")
    return [(alone <= 3 * theirs, f"over mj_step: {alone / theirs:.1f} (bar: 3)"),
            (full <= 7 * theirs, f"verified: {full / theirs:.1f} (bar: 7)")]  # fmt: skip


def main() -> int:
    given = options(__doc__, rounds=7, quick=False)
    few = ["arm", "ur5"] if given.quick else [*BARS]
    every = few if given.quick else [*BARS, "chain30", "talos"]
    return not print_bars([*runs(few, given.rounds), *batches(every, given.rounds), *steps(given.rounds)])


if __name__ == "__main__":
    sys.exit(main())
