"""Identification on simulated data: do the stated intervals hold, and what a plain least-squares fit says instead.

    python scripts/bench_identify.py [--repetitions 300] [--robots arm,panda] [--noise 0,1e-5] [--methods weighted]

1. Coverage: motions that are known exactly, torques with noise. In how many of the repetitions are the true base
   parameters inside their 95 % intervals? (Also with noisy positions alone, filtered and differentiated.)
2. What can be told: rank and null space of the base parameters, against Pinocchio's regressor on other states.
3. A plain fit (numpy.linalg.lstsq, scipy.optimize.least_squares) of each link's parameters from the same data: their
   values for what no torque depends on, or only a sum, without a warning; beside ours.

Writes out/bench_identify.csv.
"""

import argparse
import csv
import os
import time
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # its threads wait for each other on busy machines

import numpy as np
import pinocchio as pin
from scipy.optimize import least_squares

import twolink as tl
from twolink.identification import Identification, base_parameters

OUT = Path(__file__).parents[1] / "out"
FINGERS = {"panda_finger_joint1": 0.0, "panda_finger_joint2": 0.0}
NOISE = {"arm": 0.05, "panda": 0.1}  # N m


def robot_of(name: str) -> tl.Robot:
    return tl.load_robot(name, lock=FINGERS if name == "panda" else None)


def motion(robot: tl.Robot, n: int, duration: float) -> tuple[np.ndarray, ...]:
    """t, q, v, a of a Fourier series of five harmonics."""
    rng = np.random.default_rng(0)
    t = np.linspace(0, duration, n)
    k = 2 * np.pi / duration * np.arange(1, 6)[:, None]
    sines, cosines = rng.uniform(-0.5, 0.5, (2, 5, robot.nv))
    q = np.sin(k * t).T @ (sines / k) - np.cos(k * t).T @ (cosines / k)
    v = np.cos(k * t).T @ sines + np.sin(k * t).T @ cosines
    return t, q, v, -np.sin(k * t).T @ (sines * k) + np.cos(k * t).T @ (cosines * k)


def coverage(name: str, repetitions: int, shake: float, method: str) -> dict[str, object]:
    """How often the true base parameters are inside their intervals; the worst and the best parameter too."""
    robot = robot_of(name)
    t, q, v, a = motion(robot, 400, 10.0)
    tau = robot.inverse_dynamics(q, v, a)
    inside: list[np.ndarray] = []
    start = time.process_time()
    for seed in range(repetitions):
        rng = np.random.default_rng(seed)
        noisy = tau + NOISE[name] * rng.standard_normal(tau.shape)
        if shake:
            shaken = q + shake * rng.standard_normal(q.shape)
            found = tl.identify(robot, t, shaken, None, noisy, method=method)
        else:
            found = tl.identify(robot, t, q, v, noisy, a=a, method=method)
        truth = found.matrix @ found.selection.nominal
        inside.append(np.abs(found.estimate - truth) <= found.half_width)
    table = np.array(inside)
    each = table.mean(axis=0)
    data = f"positions, noise {shake:g} rad" if shake else "q, v, a"
    return {
        "robot": name, "data": data, "method": method, "repetitions": repetitions,
        "parameters": table.shape[1], "inside": float(table.mean()), "worst": float(each.min()),
        "best": float(each.max()), "cpu_s_each": (time.process_time() - start) / repetitions,
    }  # fmt: skip


def against_pinocchio(name: str) -> str:
    """Rank and null space of ours, on states that the base parameters were not computed from."""
    robot = robot_of(name)
    base = base_parameters(robot)
    q, v = robot.random_state(200, seed=99)
    a = np.random.default_rng(99).uniform(-3, 3, v.shape)
    rows = [np.reshape(pin.computeJointTorqueRegressor(robot.model, robot.data, *s), (robot.nv, -1))
            for s in zip(q, v, a, strict=True)]  # fmt: skip
    stacked = np.vstack(rows)
    lengths = np.linalg.norm(stacked, axis=0)
    seen = lengths > 1e-12 * lengths.max()
    singular = np.linalg.svd(stacked[:, seen] / lengths[seen], compute_uv=False)
    rank = int(np.sum(singular > 1e-8))
    theirs = np.linalg.svd(stacked)[2][rank:].T
    angle = np.linalg.norm(theirs - base.null_space @ (base.null_space.T @ theirs), 2)
    return (
        f"{name}: {len(base.names)} parameters, rank {len(base.matrix)} (Pinocchio's regressor {rank}); null spaces "
        f"{base.null_space.shape[1]} and {theirs.shape[1]}, sine of the largest angle between them {angle:.1e}"
    )


def beside_a_plain_fit() -> str:
    """The masses of the arm: no torque depends on one, the other only acts in sums."""
    robot = robot_of("arm")
    t, q, v, a = motion(robot, 400, 10.0)
    tau = robot.inverse_dynamics(q, v, a) + 0.05 * np.random.default_rng(1).standard_normal(v.shape)
    names, true = robot.parameter_names[:20], robot.parameter_values
    matrix = robot.regressor(q, v, a)[..., :20].reshape(-1, 20)
    plain = np.linalg.lstsq(matrix, tau.ravel(), rcond=None)[0]
    fitted = least_squares(lambda x: matrix @ x - tau.ravel(), np.ones(20), method="trf")
    ours = tl.identify(robot, t, q, v, tau, a=a)
    lines = [f"{'':28}{'true':>10}{'lstsq':>10}{'least_squares':>15}   (status {fitted.status}: success)  twolink"]
    for k in (0, 7, 10, 14, 16):
        told = _told(ours, names[k])
        lines.append(f"{names[k]:28}{true[k]:10.4f}{plain[k]:10.4f}{fitted.x[k]:15.4f}   {told}")
    return "\n".join(lines)


def _told(found: Identification, name: str) -> str:
    if name in found.values:
        low, high = found.intervals[name]
        return f"{low:.4f} to {high:.4f}"
    return next(text for text in found.not_identifiable if name in text)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repetitions", type=int, default=300)
    parser.add_argument("--robots", default="arm,panda")
    parser.add_argument("--methods", default="weighted")
    parser.add_argument("--noise", default="0,1e-5", help="of positions, rad (1e-5: an encoder of 19 bits); 0: exact")
    options = parser.parse_args()
    names = options.robots.split(",")
    rows = []
    for name in names:
        for shake in map(float, options.noise.split(",")):
            for method in options.methods.split(","):
                rows.append(coverage(name, options.repetitions, shake, method))
                print(*(f"{k} {v:.4g}" if isinstance(v, float) else f"{k} {v}" for k, v in rows[-1].items()), sep="  ")
    for name in names:
        print(against_pinocchio(name))
    print(beside_a_plain_fit())
    OUT.mkdir(exist_ok=True)
    with (OUT / "bench_identify.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)


if __name__ == "__main__":
    main()
