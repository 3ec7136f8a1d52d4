"""The hand-derived arm: its energy, batches, kinds of numbers and refusals.

Its entries are Pinocchio's and SymPy's (`test_check`, `test_derive`): with that they are symmetric, positive definite,
and the gradients and Christoffel symbols of one energy.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from twolink.errors import QueryError
from twolink.lagrange import TwoLink, two_link

STEP = 1e-200  # complex step: the derivative is exact to round-off


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)


def random_arm(rng: np.random.Generator, n: int, **kwargs: Any) -> TwoLink:
    l1, l2 = rng.uniform(0.2, 2, (2, n))
    m1, m2 = rng.uniform(0.2, 5, (2, n))
    return two_link((l1, l2), (m1, m2), rng.uniform(0, 20, n), **kwargs)


def states(rng: np.random.Generator, n: int) -> tuple[np.ndarray, ...]:
    theta, dtheta, torque = rng.uniform(-3, 3, (3, n, 2))
    return theta, dtheta, torque


def energy_rate(arm: TwoLink, theta: np.ndarray, dtheta: np.ndarray, torque: np.ndarray) -> np.ndarray:
    """dE/dt along the motion, by complex step in both angles and speeds."""
    ddtheta = arm.forward_dynamics(theta, dtheta, torque)
    kinetic, potential = arm.energy(theta + 1j * STEP * dtheta, dtheta + 1j * STEP * ddtheta)
    return np.imag(kinetic + potential) / STEP


def test_power_is_the_rate_of_energy(rng: np.random.Generator) -> None:
    arm, (theta, dtheta, torque) = random_arm(rng, 200), states(rng, 200)
    power = (torque * dtheta).sum(axis=-1)
    assert_allclose(energy_rate(arm, theta, dtheta, torque), power, rtol=1e-10, atol=1e-9)


def test_the_printed_arm_makes_energy_at_the_rate_its_docstring_states(rng: np.random.Generator) -> None:
    arm, (theta, dtheta, _) = random_arm(rng, 200, variant="printed"), states(rng, 200)
    (l1, l2), (_, m2), (w1, w2) = arm.lengths, arm.masses, dtheta.T
    made = m2 * l1 * l2 * np.sin(theta[:, 1]) * w2 * (w1**2 - w2**2) / 2
    assert_allclose(energy_rate(arm, theta, dtheta, np.zeros(2)), made, rtol=1e-10, atol=1e-9)
    assert np.abs(made).max() > 1


@pytest.mark.parametrize("variant", ["corrected", "printed"])
def test_forward_and_inverse_dynamics_undo_each_other(rng: np.random.Generator, variant: Any) -> None:
    arm, (theta, dtheta, torque) = random_arm(rng, 300, variant=variant), states(rng, 300)
    ddtheta = arm.forward_dynamics(theta, dtheta, torque)
    assert_allclose(arm.inverse_dynamics(theta, dtheta, ddtheta), torque, atol=1e-11)


def test_a_batch_is_a_loop_and_parameters_broadcast(rng: np.random.Generator) -> None:
    arm, (theta, dtheta, torque) = random_arm(rng, 6), states(rng, 6)
    (l1, l2), (m1, m2) = arm.lengths, arm.masses
    batch = arm.forward_dynamics(theta, dtheta, torque)
    for i in range(6):
        one = two_link((l1[i], l2[i]), (m1[i], m2[i]), arm.g[i])
        assert_allclose(batch[i], one.forward_dynamics(theta[i], dtheta[i], torque[i]), rtol=1e-14)
    assert arm.mass_matrix([0, 1]).shape == (6, 2, 2)
    grid = two_link((l1[:, None], 1), (3, m2[None, :]))
    assert grid.batch == (6, 6)
    assert grid.gravity_torque([0, 1]).shape == (6, 6, 2)
    assert two_link((1, 1), (3, 1)).velocity_squares(theta.reshape(2, 3, 2)).shape == (2, 3, 2, 2)
    kinetic, potential = two_link((1, 1), (3, 1)).energy([0, 1], np.zeros((4, 2)))
    assert kinetic.shape == potential.shape == (4,)


def test_long_double_is_kept() -> None:
    theta = np.array([0.3, 0.4], dtype=np.longdouble)
    assert two_link((1, 1), (3, 1)).gravity_torque(theta).dtype == np.longdouble
    assert two_link((1, 1), (3, 1)).gravity_torque(theta.astype(np.float32)).dtype == np.float64


@pytest.mark.parametrize(("given", "message"), [
    ({"lengths": (1, -1)}, r"l2: expected a positive number, got -1"),
    ({"lengths": (0, 1)}, r"l1: expected a positive number, got 0"),
    ({"masses": (3, [1, np.nan])}, r"m2: expected finite numbers, got nan at index \(1,\)"),
    ({"g": np.inf}, r"g: expected finite numbers, got inf"),
    ({"masses": (3, "heavy")}, r"m2: expected numbers, got .*'heavy'"),
    ({"lengths": 1}, r"lengths: expected the pair \(l1, l2\), got 1"),
    ({"lengths": ([1, 2], [1, 2, 3])}, r"batch shapes do not broadcast: l1 \(2,\), l2 \(3,\)"),
    ({"variant": "prnted"}, r"variant: .* got 'prnted'; did you mean 'printed'\?"),
])  # fmt: skip
def test_bad_arms_are_refused_by_name(given: dict[str, Any], message: str) -> None:
    with pytest.raises(QueryError, match=message):
        two_link(**{"lengths": (1, 1), "masses": (3, 1), **given})


@pytest.mark.parametrize(("theta", "dtheta", "message"), [
    ([0, 0, 0], [0, 0], r"theta: expected shape \(..., 2\), got \(3,\); the last axis is"),
    (0.0, [0, 0], r"theta: expected shape \(..., 2\), got \(\)"),
    ([0, 0], [0, np.inf], r"dtheta: expected finite numbers, got inf at index \(1,\)"),
    ([[0, 0]] * 3, [[0, 0]] * 2, r"dtheta: batch shapes do not broadcast: .*theta \(3,\), dtheta \(2,\)"),
    ([[0], [0, 1]], [0, 0], r"theta: expected a rectangular array"),
])  # fmt: skip
def test_bad_states_are_refused_by_name(theta: Any, dtheta: Any, message: str) -> None:
    with pytest.raises(QueryError, match=message):
        two_link((1, 1), (3, 1)).bias(theta, dtheta)
