"""Random states of any robot, and closeness relative to the largest entry."""

import numpy as np
import pinocchio as pin

import twolink as tl


def states(robot: tl.Robot, n: int, seed: int = 0) -> tuple[np.ndarray, ...]:
    """q (n, nq) on its manifold, v and a third vector (n, nv)."""
    rng = np.random.default_rng(seed)
    q = np.array([pin.integrate(robot.model, robot.neutral, rng.uniform(-2, 2, robot.nv)) for _ in range(n)])
    return robot.normalize(q), rng.uniform(-3, 3, (n, robot.nv)), rng.uniform(-20, 20, (n, robot.nv))


def close(a: np.ndarray, b: np.ndarray, tolerance: float = 1e-12) -> None:
    """Shapes are equal, and no entry differs by more than the tolerance times the largest (1 at least)."""
    assert np.shape(a) == np.shape(b)
    np.testing.assert_allclose(a, b, rtol=0, atol=tolerance * max(1.0, float(np.abs(b).max(initial=0.0))))
