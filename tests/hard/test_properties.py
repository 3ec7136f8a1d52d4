"""Physics that holds for any robot, on random ones: hundreds of examples, thousands with -m slow."""

import os
import time
from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import twolink as tl
from tests.hard.random_scenes import random_effects, random_robot, random_state
from twolink.errors import AccuracyError, SceneError

SEEDS = st.integers(0, 2**32 - 1)
SMALL = ("revolute", "continuous", "prismatic")
HANG = 120.0  # s
Check = Callable[[np.random.Generator], bool | None]
"""Checks one random example; False: the example was refused."""


def identities(random: np.random.Generator) -> None:
    """M is symmetric and positive definite, M a + h = tau, RNEA(ABA(tau)) = tau, T = v M v / 2."""
    robot = random_robot(random)
    q, v = random_state(random, robot)
    tau = random.uniform(-10, 10, robot.nv)
    mass, a = robot.mass_matrix(q), robot.forward_dynamics(q, v, tau)
    assert np.array_equal(mass, mass.T)
    condition = np.linalg.cond(mass)
    assert np.linalg.eigvalsh(mass).min() > 0
    size = np.abs(tau).max() + np.abs(robot.bias(q, v)).max()
    tolerance = 1e-13 * condition * size + 1e-10 * size
    np.testing.assert_allclose(mass @ a + robot.bias(q, v), tau, rtol=0, atol=tolerance)
    np.testing.assert_allclose(robot.inverse_dynamics(q, v, a), tau, rtol=0, atol=tolerance)
    other = robot.forward_dynamics(q, v, tau, method="crba")
    np.testing.assert_allclose(other, a, rtol=0, atol=1e-13 * condition * (np.abs(a).max() + 1))
    kinetic, _ = robot.energy(q, v)
    np.testing.assert_allclose(kinetic, v @ mass @ v / 2, rtol=1e-12)


def energy_rate_is_power(random: np.random.Generator) -> None:
    """dE/dt along the motion that tau makes is v . tau: by a central difference."""
    robot = random_robot(random)
    q, v = random_state(random, robot, lively=1.0)
    tau, h = random.uniform(-5, 5, robot.nv), 1e-5
    a = robot.forward_dynamics(q, v, tau)
    h /= 1.0 + np.abs(a).max() ** 0.5  # light links accelerate much
    around = []
    for s in (h, -h):
        moved = pin.normalize(robot.model, pin.integrate(robot.model, q, s * v + s * s / 2 * a))
        around.append(np.sum(robot.energy(moved, v + s * a)))
    kinetic, potential = robot.energy(q, v)
    rate = (around[0] - around[1]) / (2 * h)
    size = abs(v @ tau) + kinetic + abs(potential) + 1.0
    assert abs(rate - v @ tau) < 1e-4 * size * (1 + np.abs(a).max() * h / 1e-3)


def compiled_is_portable(random: np.random.Generator) -> bool:
    """The compiled motion is SciPy's around Pinocchio, within both error bars; or one of them is refused by name."""
    robot = random_robot(random, max_joints=2, kinds=SMALL)
    q, v = random_state(random, robot)
    scene = tl.Scene(robot, q, v, random_effects(random, robot, q), duration=0.1)
    first, second = (simulated(scene, 1e-6, method, 20) for method in ("rk45", "scipy-dop853"))
    if first is None or second is None:
        return False
    assert first.error is not None
    assert second.error is not None
    for one, two, bar in zip(first.q, second.q, first.error + second.error, strict=True):
        assert np.abs(one - two).max() <= bar + 1e-12  # of cosines and quaternions less than of their angles
    return True


def portable_meets_its_accuracy(random: np.random.Generator) -> bool:
    """Any robot with any effects: finite numbers within the accuracy, or a refusal by name; never NaN, never a hang."""
    robot = random_robot(random, max_joints=3)
    q, v = random_state(random, robot)
    scene = tl.Scene(robot, q, v, random_effects(random, robot, q), duration=0.05)
    run = simulated(scene, 1e-4, "scipy-dop853", 40)
    if run is None:
        return False
    assert np.isfinite(run.energy).all()
    assert run.error is not None
    assert run.error.max() <= 1e-4
    return True


def simulated(scene: tl.Scene, accuracy: float, method: str, samples: float) -> tl.Trajectory | None:
    """The run; None where twolink refuses it by an error that says why."""
    start, run, places = time.process_time(), None, []
    try:
        run = tl.simulate(scene, accuracy=accuracy, method=method, samples_per_second=samples)
    except (AccuracyError, SceneError) as error:
        places = [error.where, error.code]
    assert time.process_time() - start < HANG
    if run is None:
        assert all(places)
        return None
    assert np.isfinite(run.q).all()
    assert np.isfinite(run.v).all()
    return run


FEW = ((identities, 60), (energy_rate_is_power, 40), (compiled_is_portable, 1))
MANY = (
    (identities, 5000),
    (energy_rate_is_power, 3000),
    (portable_meets_its_accuracy, 100),
    (compiled_is_portable, 60),
)
MAX_REFUSED = 0.2  # the share of examples that may be refused


@pytest.fixture(autouse=True)
def _no_cache(monkeypatch: pytest.MonkeyPatch) -> None:
    """Code that is compiled for one example is not used again."""
    monkeypatch.setitem(os.environ, "TWOLINK_CACHE", "off")


@pytest.mark.some(1)
@pytest.mark.parametrize(("check", "examples"), [*FEW, *MANY])
def test_physics_of_random_robots(check: Check, examples: int) -> None:
    """On random examples, few of which may be refused."""
    refused: list[bool] = []

    @settings(max_examples=examples, deadline=None, derandomize=True, database=None,
              suppress_health_check=list(HealthCheck))  # fmt: skip
    @given(SEEDS)
    def run(seed: int) -> None:
        refused.append(check(np.random.default_rng(seed)) is False)

    run()
    assert len(refused) >= examples
    assert sum(refused) <= MAX_REFUSED * len(refused), f"{sum(refused)} of {len(refused)} are refused"
