"""Many worlds: microseconds a world with and without error bars, and beside mujoco.rollout (RK4) at equal error.

    python -m scripts.benchmarks.worlds [--worlds 10000] [--rounds 3] [--quick]

Worlds: the paper's arm, released at rest within 0.3 rad and within 1 rad of the horizontal, 10 s; UR5 and the arm with
dry friction from random starts, 2 s. Accuracy 1e-6. `truth` is solved at a tolerance of 1e-14.
MuJoCo's timestep is halved until nine of ten of its worlds are as exact as nine of ten of ours; it is timed on fewer
worlds, as its time grows with their number. Both use as many threads (TWOLINK_THREADS). Medians over rounds in turn.
Last, a hundredth as many stacks of boxes, without and with estimates, over as many runs of MuJoCo's default of 2 ms.
Needs mujoco for the comparison: pip install twolink[peers].
"""

import argparse
import time
from functools import partial
from importlib.util import find_spec

import numpy as np

import twolink as tl
from scripts.runner import once, options, seconds_of
from twolink import effects
from twolink.dynamics.threads import thread_count
from twolink.hard.peers import peer_module
from twolink.hard.peers.task import Setting, task_of
from twolink.integrate.motion.scene_equations import equations_of
from twolink.integrate.steps.methods import METHODS
from twolink.integrate.steps.step_map import step_map
from twolink.integrate.steps.stepping import integrate_many

ACCURACY, SHARE = 1e-6, 0.9  # of worlds whose error is compared
FEW = 64  # worlds of MuJoCo
STEPS_AT_ONCE = 2000  # of mujoco.rollout, which keeps every state
SHORTEST = 1e-6  # s: timesteps of MuJoCo


def populations(count: int) -> dict[str, tuple[tl.Scene, np.ndarray, np.ndarray, float]]:
    """Scene, starts q and v, and duration, by name."""
    random, arm, ur5 = np.random.default_rng(0), tl.load_scene("arm-swing"), tl.load_robot("ur5")
    rubbing = effects.DryFriction(kinetic={"shoulder": 1.0, "elbow": 0.5})
    few = max(1, count // 100)
    return {
        "arm, 0.3 rad": (arm, random.uniform(-0.3, 0.3, (count, 2)), np.zeros((count, 2)), 10.0),
        "arm, 1 rad": (arm, random.uniform(-1, 1, (count, 2)), np.zeros((count, 2)), 10.0),
        "UR5": (tl.Scene(ur5, effects=[effects.Gravity()]), *random.uniform(-1, 1, (2, count, 6)), 2.0),
        "arm, dry friction": (tl.Scene(arm.base, effects=[*arm.effects, rubbing]), random.uniform(-1, 1, (few, 2)),
                              np.zeros((few, 2)), 2.0),
    }  # fmt: skip


def measure(
    name: str, scene: tl.Scene, q: np.ndarray, v: np.ndarray, duration: float, given: argparse.Namespace
) -> None:
    """The lines of one population."""
    verified = partial(tl.simulate_many, scene, duration, accuracy=ACCURACY, q=q, v=v)
    taken = seconds_of(partial(verified, verify=False), verified, rounds=given.rounds)
    plain, us = (1e6 * seconds / len(q) for seconds in taken)
    worlds = verified()
    kept = 0.0 if worlds.within_accuracy is None else float(worlds.within_accuracy.mean())
    print(f"{name:18} {len(q):6} worlds: {plain:8.1f} us plain, {us:8.1f} us verified (x {us / plain:.1f}), "
          f"{kept:.1%} within {ACCURACY:g}", flush=True)  # fmt: skip
    smooth = equations_of(scene).switching is None
    if smooth and find_spec("mujoco") and not (given.quick and name == "arm, 1 rad"):
        beside_mujoco(scene, q[:FEW], v[:FEW], duration, worlds.q[:FEW], us)


def beside_mujoco(scene: tl.Scene, q: np.ndarray, v: np.ndarray, duration: float, ours: np.ndarray, us: float) -> None:
    """Print MuJoCo's time a world at our error, and the ratio. us: our time a world."""
    steps_by = step_map(equations_of(scene), METHODS["dop853"])
    truth = integrate_many(steps_by, np.concatenate([q.T, v.T]), np.array([0.0, duration]), 1e-14)[0][-1, : q.shape[1]]

    def error(found: np.ndarray) -> float:
        return float(np.quantile(np.abs(found - truth.T).max(axis=1), SHARE))

    wanted, step, reached = error(ours), 0.008, np.inf
    while reached > wanted and step >= SHORTEST:
        step /= 2
        found, seconds = rolled_out(scene, q, v, duration, step)
        reached = error(found)
    theirs = 1e6 * seconds / len(q)
    print(f"{'':18} error {wanted:.1e}; mujoco.rollout at {step:.2e} s: error {reached:.1e}, {theirs:,.0f} us a world: "
          f"{theirs / us:,.0f} x", flush=True)  # fmt: skip


def rolled_out(scene: tl.Scene, q: np.ndarray, v: np.ndarray, duration: float, step: float) -> tuple[np.ndarray, float]:
    """(q at the end, seconds) by mujoco.rollout with RK4. Joints with one coordinate, in the order of the robot's."""
    import mujoco
    from mujoco.rollout import Rollout

    from scripts.mujoco_world import MujocoWorld

    total = round(duration / step)
    model = MujocoWorld(scene, duration / total, "RK4").model
    state = np.concatenate([np.zeros((len(q), 1)), q, v], axis=1)
    with Rollout(nthread=thread_count()) as rollout:
        data = [mujoco.MjData(model) for _ in range(thread_count())]

        def run() -> np.ndarray:
            now = state
            for done in range(0, total, STEPS_AT_ONCE):
                now = rollout.rollout(model, data, now, nstep=min(STEPS_AT_ONCE, total - done))[0][:, -1]
            return now[:, 1 : 1 + q.shape[1]]

        seconds, ends = once(run)
    return ends, seconds


def stacks(count: int, rounds: int) -> None:
    """Print the time of worlds with stepped contacts over that of runs of MuJoCo."""
    scene = tl.load_scene("box-stack")
    many = partial(tl.simulate_many, scene, q=np.tile(scene.q, (count, 1)))
    task, mujoco = task_of(scene, np.array([0.0, scene.duration])), peer_module("mujoco")
    run = mujoco.prepare(task, Setting("Euler", "", step=2e-3))
    plain, verified, theirs = seconds_of(partial(many, verify=False), many, lambda: [run() for _ in range(count)],
                                         rounds=rounds, clock=time.process_time)  # fmt: skip
    print(f"{count} stacks of boxes: {plain:.2f} s plain, {verified:.2f} s with estimates; MuJoCo {theirs:.2f} s: "
          f"{plain / theirs:.1f} and {verified / theirs:.1f} times its time", flush=True)  # fmt: skip


def main() -> None:
    given = options(__doc__, worlds=10_000, rounds=3, quick=False)
    if given.quick:
        given.worlds, given.rounds = 1000, 1
    for name, population in populations(given.worlds).items():
        measure(name, *population, given)
    if find_spec("mujoco"):
        stacks(given.worlds // 100, given.rounds)


if __name__ == "__main__":
    main()
