"""Model predictive control: the arm on its head with limited torques, a bounded least-squares problem at each tick.

The model is the scene's own linearization, sampled with a hold. Over N ticks the sum of x' Q x + u' R u with the cost
x' P x of the infinite rest is minimized for |u| <= limit, and the first u is given (Rawlings, Mayne, Diehl: Model
Predictive Control, 2017, section 1.3). Without limits this is the linear-quadratic regulator.
"""

import numpy as np
from scipy.linalg import block_diag, cholesky, expm, solve_discrete_are
from scipy.optimize import lsq_linear

import twolink as tl

fx = tl.effects
TOP = np.array([np.pi / 2, 0.0])
PERIOD, AHEAD = 0.02, 25
Q, R = np.diag([100.0, 100.0, 1.0, 1.0]), np.diag([0.01, 0.01])
LIMIT = np.array([20.0, 8.0])  # N m


def model() -> tuple[np.ndarray, np.ndarray]:
    """A (4, 4) and B (4, 2) from tick to tick, near the top."""
    inputs = fx.Torque({"shoulder": 0.0, "elbow": 0.0})
    linear = tl.linearize(tl.Scene(tl.load_robot("two_link"), effects=[fx.Gravity(), inputs]), q=TOP)
    whole = expm(PERIOD * np.vstack([np.hstack([linear.A, linear.B]), np.zeros((2, 6))]))
    return whole[:4, :4], whole[:4, 4:]


class Predictive:
    """The problem min |F u + G x|, |u| <= limit, made once; x: what is off."""

    def __init__(self, limit: np.ndarray = LIMIT) -> None:
        a, b = model()
        self.last = solve_discrete_are(a, b, Q, R)
        powers = [np.linalg.matrix_power(a, k) for k in range(AHEAD + 1)]
        states = np.vstack(powers[1:])  # of x_1 ... x_N by x_0, and by u
        by_u = np.block([[powers[i - j] @ b if j <= i else np.zeros((4, 2)) for j in range(AHEAD)]
                         for i in range(AHEAD)])  # fmt: skip
        root = block_diag(*[cholesky(Q)] * (AHEAD - 1), cholesky(self.last))
        self.by_u = np.vstack([root @ by_u, block_diag(*[cholesky(R)] * AHEAD)])
        self.by_x = np.vstack([root @ states, np.zeros((2 * AHEAD, 4))])
        self.bounds = np.tile(limit, AHEAD)

    def __call__(self, _, y, state):
        """The first torques [N m]."""
        x = np.concatenate([y.q - TOP, y.v])
        planned = lsq_linear(self.by_u, -self.by_x @ x, (-self.bounds, self.bounds), tol=1e-12).x
        return planned[:2], state


def scene(start: float = 0.18) -> tl.Scene:
    """The arm beside its top, at rest."""
    control = fx.Controller(Predictive(), period=PERIOD)
    return tl.Scene(tl.load_robot("two_link"), [TOP[0] + start, TOP[1]], effects=[fx.Gravity(), control], duration=3.0,
                    title="Model predictive control")  # fmt: skip


if __name__ == "__main__":
    run = tl.simulate(scene(), accuracy=1e-4)
    print(run)
    print("off at the end:", abs(run.q[-1] - TOP).max(), "rad; largest torques", abs(run.tau).max(axis=0), "N m")
