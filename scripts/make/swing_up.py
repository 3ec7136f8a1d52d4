"""Make the scene swing-up: a torque at the shoulder brings an arm upright whose elbow has no motor; then a regulator.

    python -m scripts.make.swing_up SCENE.toml

The shoulder follows a path from hanging to upright with a few free numbers, which Newton's method, from random guesses,
chooses so that the elbow arrives upright and at rest too:

    M22 q2'' = -d2 q2' - h2 - M21 q1'',   u = M11 q1'' + M12 q2'' + h1 + d1 q1'

The path that needs the smallest torque is kept.
"""

import re
from pathlib import Path

import numpy as np

import twolink as tl
from scripts.runner import options

E = tl.effects
UP = np.array([np.pi / 2, 0.0])
TIME, STEPS, KNOTS = 2.0, 160, 80  # s; steps of Runge and Kutta's method; intervals of the table of torques
GUESSES, ROUNDS, STRIDE = 200, 12, 0.15  # rad: the longest change of a path in one round
SIZES = np.array([0.8, 0.4, 0.2, 0.1])  # rad, of random paths
DAMPING = {"shoulder": 0.1, "elbow": 0.05}
HEAD = """# The elbow has no motor. For two seconds the shoulder's torque follows a table that
# scripts/make/swing_up.py planned; then a linear-quadratic regulator takes over. At 4 s the tip is
# pushed sideways with 1 N for 0.2 s.
"""
ARM = tl.Scene(tl.load_robot("two_link"), effects=[E.Gravity()]).robot


def path(t: float, a: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """q1 and its derivatives (n,): half a turn with rest at both ends, and sum_k a_k (1 - cos(2 pi k t / T))."""
    s, k = t / TIME, 2 * np.pi * np.arange(1, a.shape[1] + 1) / TIME
    rest = np.polynomial.Polynomial([-0.5, 0.0, 0.0, 10.0, -15.0, 6.0])
    q, v, acceleration = (np.pi * rest.deriv(n)(s) / TIME**n if n else np.pi * rest(s) for n in range(3))
    return (q + a @ (1 - np.cos(k * t)), v + a @ (k * np.sin(k * t)), acceleration + a @ (k * k * np.cos(k * t)))


def forces(t: float, a: np.ndarray, q2: np.ndarray, v2: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(q2'', u) (n,)."""
    q1, v1, a1 = path(t, a)
    q, v = np.stack([q1, q2], axis=1), np.stack([v1, v2], axis=1)
    mass, h = ARM.mass_matrix(q), ARM.bias(q, v)
    a2 = (-DAMPING["elbow"] * v2 - h[:, 1] - mass[:, 1, 0] * a1) / mass[:, 1, 1]
    return a2, mass[:, 0, 0] * a1 + mass[:, 0, 1] * a2 + h[:, 0] + DAMPING["shoulder"] * v1


def shoot(a: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(q2, q2') (n, 2) at the end of paths (n, k), and u (STEPS + 1, n) on the way."""
    h, q, v, torques = TIME / STEPS, np.zeros(len(a)), np.zeros(len(a)), []
    for t in h * np.arange(STEPS):
        k1, u = forces(t, a, q, v)
        torques.append(u)
        k2, _ = forces(t + h / 2, a, q + h / 2 * v, v + h / 2 * k1)
        k3, _ = forces(t + h / 2, a, q + h / 2 * v + h * h / 4 * k1, v + h / 2 * k2)
        k4, _ = forces(t + h, a, q + h * v + h * h / 2 * k2, v + h * k3)
        q, v = q + h * v + h * h / 6 * (k1 + k2 + k3), v + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return np.stack([q, v], axis=1), np.array([*torques, forces(TIME, a, q, v)[1]])


def planned() -> np.ndarray:
    """The torque (STEPS + 1,) of the path that needs the least."""
    a = SIZES * np.random.default_rng(0).uniform(-1, 1, (GUESSES, len(SIZES)))
    for _ in range(ROUNDS):
        off, _ = shoot(a)
        slope = np.stack([(shoot(a + 1e-6 * unit)[0] - off) / 1e-6 for unit in np.eye(len(SIZES))], axis=2)
        step = -np.einsum("nij,nj->ni", np.linalg.pinv(slope), off)
        a += step * np.minimum(1.0, STRIDE / np.abs(step).max(axis=1, keepdims=True))
    off, torques = shoot(a)
    peaks = np.where(np.abs(off).max(axis=1) < 1e-6, np.abs(torques).max(axis=0), np.inf)
    print(f"{np.isfinite(peaks).sum()} of {GUESSES} paths end upright; the least torque is {peaks.min():.3g} N m")
    return np.asarray(torques[:, int(np.argmin(peaks))])


def main() -> None:
    """Write the scene."""
    target = Path(options(__doc__, rest=()).rest[0])
    every = STEPS // KNOTS
    times, torques = np.linspace(0.0, TIME, STEPS + 1)[::every], planned()[::every]
    table = E.Sampled(tuple(times.round(9).tolist()), tuple(torques.round(6).tolist()), interpolation="cubic",
                      beyond="zero")  # fmt: skip
    robot, always = tl.load_robot("two_link"), [E.Gravity(), E.JointDamping(DAMPING)]
    regulator = tl.lqr(tl.Scene(robot, effects=always), [10.0, 10.0, 1.0, 1.0], 0.1, UP, inputs=["shoulder"],
                       effort={"shoulder": 60.0})  # fmt: skip
    push = E.Sampled((TIME + 2.0, TIME + 2.2), (1.0, 0.0), interpolation="hold", beyond="zero")
    effects = [*always, E.Torque({"shoulder": table}), E.Engage(regulator, at=TIME),
               E.FrameWrench("tip", force=(push, 0.0, 0.0))]  # fmt: skip
    title = "Swing-up: a torque at the shoulder brings the arm upright, a regulator holds it there against a push"
    scene = tl.Scene(robot, [-np.pi / 2, 0.0], effects=effects, duration=8.0, title=title)
    text = scene.save(target).read_text("utf-8")
    flat = re.sub(r"\[([^\[\]{}]*)\]", lambda m: "[" + ", ".join(m[1].replace(",", " ").split()) + "]", text)
    target.write_text(re.sub(r"\[\[ ?effects ?\]\]", "[[effects]]", HEAD + flat), "utf-8")
    tl.load_scene(target)


if __name__ == "__main__":
    main()
