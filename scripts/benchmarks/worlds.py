"""Many worlds: microseconds a world with and without error bars, and beside mujoco.rollout (RK4) at equal error.

    python scripts/bench_worlds.py [--worlds 10000] [--rounds 3] [--quick] [--json FILE]

Worlds: the paper's arm, released at rest within 0.3 rad and within 1 rad of the horizontal, 10 s; UR5 and the arm with
dry friction from random starts, 2 s. Accuracy 1e-6. `truth` is solved at a tolerance of 1e-14.
MuJoCo's timestep is halved until nine of ten of its worlds are as exact as nine of ten of ours; it is timed on fewer
worlds, as its time grows with their number. Both use as many threads (TWOLINK_THREADS). Medians over rounds in turn.
Needs mujoco for the comparison: pip install twolink[peers].
"""

import argparse
import json
import statistics
import time
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

import numpy as np

import twolink as tl
from twolink import effects
from twolink.dynamics.threads import thread_count
from twolink.integrate.many_worlds import integrate_many
from twolink.integrate.methods import METHODS
from twolink.integrate.scene_equations import equations_of
from twolink.integrate.step_map import step_map

ACCURACY, SHARE = 1e-6, 0.9  # of worlds whose error is compared
FEW = 64  # worlds of MuJoCo
STEPS_AT_ONCE = 2000  # of mujoco.rollout, which keeps every state
SHORTEST = 1e-6  # s: timesteps of MuJoCo


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", type=int, default=10_000)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--quick", action="store_true", help="1000 worlds, one round, no chaotic ones beside MuJoCo")
    parser.add_argument("--json", type=Path, help="write the rows there too")
    options = parser.parse_args()
    if options.quick:
        options.worlds, options.rounds = 1000, 1
    rows = [measured(name, *some, options) for name, some in populations(options.worlds).items()]
    if options.json:
        options.json.write_text(json.dumps(rows, indent=1))


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


def measured(
    name: str, scene: tl.Scene, q: np.ndarray, v: np.ndarray, duration: float, options: argparse.Namespace
) -> dict[str, float | str]:
    """One row: printed, and returned."""
    ways: dict[str, Callable[[], tl.Worlds]] = {
        "plain": lambda: tl.simulate_many(scene, q, v, duration=duration, accuracy=ACCURACY, verify=False),
        "verified": lambda: tl.simulate_many(scene, q, v, duration=duration, accuracy=ACCURACY),
    }
    worlds = {way: run() for way, run in ways.items()}
    seconds: dict[str, list[float]] = {way: [] for way in ways}
    for _ in range(options.rounds):
        for way, run in ways.items():
            begin = time.perf_counter()
            run()
            seconds[way].append(time.perf_counter() - begin)
    plain, verified = (1e6 * statistics.median(seconds[way]) / len(q) for way in ways)
    kept = worlds["verified"].kept
    row: dict[str, float | str] = {
        "worlds": name, "number": len(q), "plain_us": plain, "verified_us": verified, "ratio": verified / plain,
        "kept": 0.0 if kept is None else float(kept.mean()),
    }  # fmt: skip
    print(f"{name:18} {len(q):6} worlds: {plain:8.1f} us plain, {verified:8.1f} us verified (x {row['ratio']:.1f}), "
          f"{row['kept']:.1%} within {ACCURACY:g}", flush=True)  # fmt: skip
    smooth = equations_of(scene).switching is None
    if smooth and find_spec("mujoco") and not (options.quick and name == "arm, 1 rad"):
        row |= beside_mujoco(scene, q[:FEW], v[:FEW], duration, worlds["verified"].q[:FEW], verified)
    return row


def beside_mujoco(
    scene: tl.Scene, q: np.ndarray, v: np.ndarray, duration: float, ours: np.ndarray, us: float
) -> dict[str, float]:
    """MuJoCo's time a world at our error, printed with the ratio. us: our time a world."""
    steps_by = step_map(equations_of(scene), METHODS["dop853"], whole=True)
    truth = integrate_many(steps_by, np.concatenate([q.T, v.T]), np.array([0.0, duration]), 1e-14)[0][-1, : q.shape[1]]

    def error(found: np.ndarray) -> float:
        return float(np.quantile(np.abs(found - truth.T).max(axis=1), SHARE))

    wanted, step = error(ours), 0.004
    while True:
        found, seconds = rolled_out(scene, q, v, duration, step)
        reached = error(found)
        if reached <= wanted or step < SHORTEST:
            break
        step /= 2
    theirs = 1e6 * seconds / len(q)
    print(f"{'':18} error {wanted:.1e}; mujoco.rollout at {step:.2e} s: error {reached:.1e}, {theirs:,.0f} us a world: "
          f"{theirs / us:,.0f} x", flush=True)  # fmt: skip
    return {"error": wanted, "mujoco_error": reached, "mujoco_step": step, "mujoco_us": theirs, "times": theirs / us}


def rolled_out(scene: tl.Scene, q: np.ndarray, v: np.ndarray, duration: float, step: float) -> tuple[np.ndarray, float]:
    """(q at the end, seconds) by mujoco.rollout with RK4. Joints with one coordinate, in the order of the robot's."""
    import mujoco
    from mujoco.rollout import Rollout

    from twolink.hard.peers.mujoco_peer import build
    from twolink.hard.peers.task import task_of

    model = build(task_of(scene, np.array([0.0, duration])))
    total = round(duration / step)
    model.opt.timestep, model.opt.integrator = duration / total, mujoco.mjtIntegrator.mjINT_RK4
    state = np.concatenate([np.zeros((len(q), 1)), q, v], axis=1)
    with Rollout(nthread=thread_count()) as rollout:
        data = [mujoco.MjData(model) for _ in range(thread_count())]
        begin = time.perf_counter()
        while total:
            now = min(total, STEPS_AT_ONCE)
            state = rollout.rollout(model, data, state, nstep=now)[0][:, -1]
            total -= now
        return state[:, 1 : 1 + q.shape[1]], time.perf_counter() - begin


if __name__ == "__main__":
    main()
