"""Other simulators, as small as they can be: steps of fixed size over Pinocchio's accelerations, and DOP853."""

from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp

import twolink as tl
from twolink.dynamics import Robot

Log = tuple[np.ndarray, np.ndarray, np.ndarray]
Law = Callable[[np.ndarray, np.ndarray], np.ndarray]


def law_of(robot: Robot, damping: float = 0.0, friction: float = 0.0) -> Law:
    """Accelerations under gravity, damping and friction of all joints, without events."""
    return lambda q, v: robot.forward_dynamics(q, v, -damping * v - friction * np.sign(v), engine="pinocchio")


def exact(scene: tl.Scene, law: Law, end: float, dt: float) -> Log:
    nq, times = scene.robot.nq, np.arange(round(end / dt) + 1) * dt
    done = solve_ivp(lambda _, x: np.concatenate([x[nq:], law(x[:nq], x[nq:])]), (0, times[-1]),
                     np.concatenate([scene.q, scene.v]), "DOP853", t_eval=times, rtol=1e-11, atol=1e-11)  # fmt: skip
    return times, done.y[:nq].T, done.y[nq:].T


def stepped(scene: tl.Scene, law: Law, end: float, dt: float, step: float, kind: str = "euler") -> Log:
    """Semi-implicit Euler or RK4, logged every dt."""
    q, v, nq = scene.q.copy(), scene.v.copy(), scene.robot.nq
    rows = [(q, v)]

    def rate(x: np.ndarray) -> np.ndarray:
        return np.concatenate([x[nq:], law(x[:nq], x[nq:])])

    for _ in range(round(end / dt)):
        for _ in range(round(dt / step)):
            if kind == "euler":
                v = v + step * law(q, v)
                q = q + step * v
            else:
                x = np.concatenate([q, v])
                a = rate(x)
                b = rate(x + step / 2 * a)
                c = rate(x + step / 2 * b)
                x = x + step / 6 * (a + 2 * b + 2 * c + rate(x + step * c))
                q, v = x[:nq], x[nq:]
        rows.append((q, v))
    return np.arange(len(rows)) * dt, np.array([q for q, _ in rows]), np.array([v for _, v in rows])
