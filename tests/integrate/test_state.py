"""Distances of configurations."""

import numpy as np
import pinocchio as pin
import pytest

from tests.integrate.problems import one_joint
from twolink.integrate.motion.state import StateSpace


@pytest.mark.parametrize("kind", ["continuous", "planar"])
@pytest.mark.parametrize("size", [1e-12, 1e-9, 1e-8, 1e-3, 3.0])
def test_small_angles_have_their_distance(kind: str, size: float) -> None:
    """pin.difference gives exactly 0 for some of the small ones, and so would an error bar."""
    robot = one_joint(kind, "0 0 1")
    random = np.random.default_rng(0)
    q = np.array([pin.integrate(robot.model, robot.neutral, random.uniform(-3, 3, robot.nv)) for _ in range(200)])
    turn = np.zeros(robot.nv)
    turn[-1] = size
    other = np.array([pin.integrate(robot.model, row, turn) for row in q])
    np.testing.assert_allclose(StateSpace(robot).distance(q, other), size, rtol=1e-6, atol=1e-15)


def test_large_distances_are_pinocchios() -> None:
    robot = one_joint("planar", "0 0 1")
    random = np.random.default_rng(1)
    q, other = (
        np.array([pin.integrate(robot.model, robot.neutral, random.uniform(-2, 2, 3)) for _ in range(20)])
        for _ in range(2)
    )
    expected = [np.abs(pin.difference(robot.model, a, b)).max() for a, b in zip(q, other, strict=True)]
    np.testing.assert_allclose(StateSpace(robot).distance(q, other), expected, rtol=1e-12)
