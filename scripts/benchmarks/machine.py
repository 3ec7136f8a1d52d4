"""What the native library costs beside its peers: runs from an empty cache on, batches of states, and single steps.

    python -m scripts.benchmarks.machine [--rounds 7] [--quick]

Processor seconds on one thread, minima after warm-up, all in turns.

Runs: gravity acts for 2 s. first: of a new process with an empty cache, wall clock; eighth: the minimum of runs 8 on,
verified to the accuracy. SciPy: the cheapest of its methods on `pin.aba` whose true error is not larger than ours, or
its tightest; both errors are against a run of 1e-12. alone: one run of ours without its error bar. Batches: forward
dynamics over a loop of `pin.aba` and over `pin.abaInParallel`. Steps: `Simulation.step` of 1 ms over `mj_step`.
--quick: fewer robots.
"""

import functools
import sys
import time
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
from scipy.integrate import DOP853, LSODA, RK45

import twolink as tl
from scripts.benchmarks.queries import chain, mujoco_model
from scripts.runner import FINGERS, Table, new_process, options, print_bars, seconds_of

DURATION, ACCURACIES, EIGHTH = 2.0, (1e-3, 1e-6, 1e-9), 8
FACTORS = 10.0, 3.0, 1.0, 0.3, 0.1, 0.03, 0.01, 1e-3  # of the error: tolerances
BATCHES = (2, 10, 100, 1_000, 10_000, 100_000)
BARS = {"arm": (3.0, (20, 30, 40)), "ur5": (2.0, (8, 10, 12)), "panda": (2.0, (6, 8, 8))}  # eighth; alone by accuracy
FIRST = """
import sys, time, numpy as np, twolink as tl
from scripts.benchmarks.machine import scene_of
scene = scene_of(sys.argv[1])
start = time.perf_counter()
tl.simulate(scene, accuracy=float(sys.argv[2]))
print(time.perf_counter() - start)
"""
ROBOTS: dict[str, Callable[[], tl.Robot]] = {
    "arm": lambda: tl.load_robot("arm"),
    "ur5": lambda: tl.load_robot("ur5"),
    "panda": lambda: tl.load_robot("panda", lock=FINGERS),
    "chain30": lambda: chain(30),
    "talos": lambda: tl.load_robot("talos", root="free"),
}


def scene_of(name: str) -> tl.Scene:
    """The robot under gravity, released from a bent posture."""
    robot = ROBOTS[name]()
    return tl.Scene(robot, np.linspace(0.3, 0.9, robot.nq), effects=[tl.effects.Gravity()], duration=DURATION)


def by_scipy(scene: tl.Scene, truth: np.ndarray, times: np.ndarray, error: float) -> tuple[Callable[[], Any], str]:
    """The cheapest of SciPy's methods on `pin.aba` with at most this true error, as a call, and its name."""
    model, data, zero = scene.robot.model, scene.robot.model.createData(), np.zeros(scene.robot.nv)
    nq, found = scene.robot.nq, list[tuple[bool, float, Callable[[], Any], str]]()

    def rate(_: float, x: np.ndarray) -> np.ndarray:
        return np.concatenate([x[nq:], pin.aba(model, data, x[:nq], x[nq:], zero)])

    start = np.concatenate([scene.q, scene.v])

    def solve(method: Any, tolerance: float) -> np.ndarray:
        solver, out, done = method(rate, 0.0, start, DURATION, rtol=tolerance, atol=tolerance), [start], 1
        while solver.status == "running":
            solver.step()
            ready = int(np.searchsorted(times, solver.t, side="right"))
            if ready > done:
                out.extend(solver.dense_output()(times[done:ready]).T)
                done = ready
        return np.array(out)

    for method in (DOP853, RK45, LSODA):
        for factor in FACTORS:
            tolerance = max(error * factor, 1e-13)
            call = functools.partial(solve, method, tolerance)
            reached = float(np.abs(call()[:, :nq] - truth).max()) <= error
            if reached or factor == FACTORS[-1]:
                (taken,) = seconds_of(call, rounds=3, warm_up=0, clock=time.process_time, pick=min)
                found.append((not reached, taken, call, f"{method.__name__} {tolerance:.0e}"))
                break
    missed, _, call, name = min(found, key=lambda one: one[:2])
    return call, f"{name} (less exact)" if missed else name


def runs(names: list[str], rounds: int) -> list[tuple[bool, str]]:
    """The table of runs, and its bars."""
    table = Table("robot <8 | accuracy >8.0e | first s >8.2f | again ms >9.2f | alone ms >9.2f | SciPy ms >9.2f "
                  "| method <14 | eighth >7.2f | alone over >10.1f | verified over alone >8.2f")  # fmt: skip
    bars = []
    for name in names:
        scene = scene_of(name)
        exact = tl.simulate(scene, accuracy=1e-12)
        for accuracy, wanted in zip(ACCURACIES, BARS[name][1], strict=True):
            first = float(new_process(FIRST, name, str(accuracy)).stdout or "nan")
            ours = tl.simulate(scene, accuracy=accuracy)
            error = float(np.abs(ours.q - exact.q).max())
            call, method = by_scipy(scene, exact.q, exact.t, error)
            how = {"method": ours.cost.method, "tolerance": ours.cost.tolerance, "verify": False}
            again, alone, theirs = seconds_of(
                functools.partial(tl.simulate, scene, accuracy=accuracy), functools.partial(tl.simulate, scene, **how),
                call,
                rounds=rounds, warm_up=EIGHTH - 1, clock=time.process_time, pick=min,
            )  # fmt: skip
            table.add(name, accuracy, first, 1e3 * again, 1e3 * alone, 1e3 * theirs, method, theirs / again,
                      theirs / alone, again / alone)  # fmt: skip
            least = BARS[name][0]
            bars.append((theirs / again >= least, f"{name}, {accuracy:g}: the eighth verified run is "
                         f"{theirs / again:.2f} times faster than SciPy (bar: {least:g})"))  # fmt: skip
            bars.append((theirs / alone >= wanted, f"{name}, {accuracy:g}: alone {theirs / alone:.1f} (bar: {wanted})"))
    table.save("machine-runs")
    return bars


def one_by_one(model: pin.Model, data: pin.Data, *states: np.ndarray) -> None:
    """A loop of `pin.aba`."""
    for q, v, tau in zip(*states, strict=True):
        pin.aba(model, data, q, v, tau)


def batches(names: list[str], rounds: int) -> list[tuple[bool, str]]:
    """The table of batches, and its bars."""
    table = Table("robot <8 | states >7 | ns a state >10.0f | over the loop >8.1f | over abaInParallel >8.1f")
    bars = []
    for name in names:
        robot = ROBOTS[name]()
        model, data, pool = robot.model, robot.model.createData(), pin.ModelPool(robot.model, 1)
        worst = np.inf
        for count in BATCHES:
            q, v = robot.random_state(count, seed=1)
            tau = np.random.default_rng(1).uniform(-1, 1, v.shape)
            few, turned = min(count, 1000), [np.asfortranarray(x.T) for x in (q, v, tau)]
            out = np.empty((robot.nv, count), order="F")

            ours, single, parallel = seconds_of(
                functools.partial(robot.forward_dynamics, q, v, tau),
                functools.partial(one_by_one, model, data, q[:few], v[:few], tau[:few]),
                functools.partial(pin.abaInParallel, 1, pool, *turned, out),
                rounds=max(rounds, min(200, 20_000 // count)), warm_up=3, clock=time.process_time, pick=min,
            )  # fmt: skip
            ratios = single * count / few / ours, parallel / ours
            worst = min(worst, *ratios)
            table.add(name, count, 1e9 * ours / count, *ratios)
        bars.append((worst >= 1.0, f"{name}: never slower than Pinocchio: {worst:.2f} times as fast at least (bar: 1)"))
    table.save("machine-batches")
    return bars


def steps(rounds: int) -> list[tuple[bool, str]]:
    """The table of single steps of a Panda, and its bars."""
    robot, taken = ROBOTS["panda"](), list[float]()
    scene, tau = tl.Scene(robot, effects=[tl.effects.Gravity()]), np.zeros(robot.nv)
    model = mujoco_model(robot)
    model.opt.timestep = 1e-3
    data = mujoco.MjData(model)
    for verify in (False, True):
        sim = tl.Simulation(scene, verify=verify)

        def ours(sim: tl.Simulation = sim) -> None:
            for _ in range(100):
                sim.step(1e-3, tau)

        def theirs() -> None:
            for _ in range(100):
                mujoco.mj_step(model, data)

        taken += seconds_of(ours, theirs, rounds=5 * rounds, clock=time.process_time, pick=min)
    alone, verified = taken[0] / taken[1], taken[2] / taken[3]
    print(f"step of 1 ms, Panda: {1e4 * taken[0]:.1f} us, verified {1e4 * taken[2]:.1f}, mj_step {1e4 * taken[1]:.1f}")
    return [(alone <= 3, f"over mj_step: {alone:.1f} (bar: 3)"), (verified <= 7, f"verified: {verified:.1f} (bar: 7)")]


def main() -> int:
    given = options(__doc__, rounds=7, quick=False)
    few = ["arm", "ur5"] if given.quick else [*BARS]
    bars = runs(few, given.rounds)
    print()
    bars += batches(few if given.quick else [*ROBOTS], given.rounds)
    print()
    bars += steps(given.rounds)
    return 0 if print_bars(bars) else 1


if __name__ == "__main__":
    sys.exit(main())
