"""The defaults of identify: friction at rest, filters, masses that no motion shows, and what is said first."""

import numpy as np
import pytest

import twolink as tl
from tests.parts.identification.motions import FINGERS, motion, noisy
from tests.refusals import refusal
from twolink.errors import QueryError
from twolink.identification import identify
from twolink.parts.identification.base_parameters import regressor
from twolink.parts.identification.filtering import Folds
from twolink.parts.identification.measurements import Measurements

ARM = tl.load_robot("arm")
COULOMB, VISCOUS = np.array([0.5, 0.3]), np.array([0.2, 0.1])


def resting(seed: int) -> tuple[np.ndarray, ...]:
    """A log t, q, v, tau with encoders' noise whose first part is at rest, held there by friction of any size."""
    rng = np.random.default_rng(seed)
    t, q, v, a = motion(ARM, 900, seed=2, duration=9.0)
    ramp = np.clip((t - 3.0) / 2.0, 0.0, 1.0)
    rate = ramp**2 * (3 - 2 * ramp)
    change = 3.0 * ramp * (1 - ramp)
    s = np.concatenate([[0.0], np.cumsum((rate[1:] + rate[:-1]) / 2 * np.diff(t))])
    q, v, a = (np.stack([np.interp(s, t, x) for x in y.T], axis=1) for y in (q, v, a))
    v, a = v * rate[:, None], a * rate[:, None] ** 2 + v * change[:, None]
    held = np.where(t[:, None] < 3.0, rng.uniform(-1, 1, 2), np.sign(v))
    tau = ARM.inverse_dynamics(q, v, a) + VISCOUS * v + COULOMB * held
    return t, noisy(q, 1e-5, seed), noisy(v, 1e-4, seed + 1), noisy(tau, 0.02, seed + 2)


def test_friction_is_right_where_a_third_of_the_samples_is_at_rest() -> None:
    inside = []
    for seed in range(6):
        found = identify(ARM, *resting(10 * seed))
        for joint, truth in zip(ARM.joint_names, COULOMB, strict=True):
            low, high = found.intervals[f"{joint}.friction"]
            assert high - low < 0.4 * truth
            inside.append(low <= truth <= high)
    assert np.mean(inside) > 0.8
    assert not any("stribeck" in error.name for error in found.model_errors)


def test_a_rest_counts_as_one_sample_however_long_it_is() -> None:
    given = {"joint_model": "viscous+coulomb", "half_window": 15}
    long, short = (identify(ARM, *(x[first:] for x in resting(0)), **given) for first in (0, 200))
    assert np.all(np.abs(long.estimate - short.estimate) < np.maximum(long.half_width, short.half_width))


def test_what_the_model_lacks_makes_no_link_heavy() -> None:
    """Friction grows with the load: by the noise alone a link had 24 times its mass."""
    robot = tl.load_robot("panda", lock=FINGERS)
    t, q, v, a = motion(robot, 600)
    tau = robot.inverse_dynamics(q, v, a)
    log = noisy(tau + np.sign(v) * (0.3 + 0.1 * np.abs(tau)), 0.05)
    found = identify(robot, t, q, None, log, joint_model="viscous+coulomb", find=(), half_window=8).found
    masses = [[body.mass for body in list(one.model.inertias)[1:]] for one in (robot, found)]
    assert np.max(np.divide(*masses[::-1])) < 6
    assert 0.7 < found.mass / robot.mass < 1.4


@pytest.mark.parametrize("name", ["arm", "panda", "kinova", "gripper"])
def test_the_regressor_is_the_robots_own(name: str) -> None:
    robot = tl.load_robot(name)
    q, v = robot.random_state(5)
    a = np.cos(v)
    np.testing.assert_allclose(regressor(robot, q, v, a, np.zeros(1)), robot.regressor(q, v, a), rtol=0, atol=1e-10)


def test_parts_that_are_left_out_are_predicted_as_by_least_squares() -> None:
    rng = np.random.default_rng(0)
    columns, y = rng.standard_normal((90, 1, 4)), rng.standard_normal((90, 1))
    left = 0.0
    for rows in np.split(np.arange(90), [30, 60]):
        rest = np.delete(np.arange(90), rows)
        theta = np.linalg.lstsq(columns[rest, 0][:, [0, 2]], y[rest, 0], rcond=None)[0]
        left += np.sum((y[rows, 0] - columns[rows, 0][:, [0, 2]] @ theta) ** 2)
    np.testing.assert_allclose(Folds(columns, y, [30, 60, 90]).left_out([0, 2]), left / 90, rtol=1e-9)


def test_blocks_of_runs_end_where_their_means_do() -> None:
    """What is left of a run behind its last whole block is not of the next run."""
    x = np.arange(14.0)[:, None]
    data = Measurements(x[:, 0], x, x, x, x, ends=(7, 14), block=2)
    assert data.block_ends == [3, 6]
    np.testing.assert_array_equal(data.averaged(x)[[2, 3], 0], [4.5, 7.5])


def test_a_filter_passes_what_bodies_do_also_where_friction_is_not_looked_for() -> None:
    """An arm with friction and a ripple of 300 Hz in its torques, at 2 kHz."""
    t, q, v, a = motion(ARM, 8000, duration=4.0)
    tau = ARM.inverse_dynamics(q, v, a) + np.sign(v) + 0.1 * np.sin(600 * np.pi * t)[:, None]
    found = identify(ARM, t, noisy(q, 1e-5), None, noisy(tau, 0.05), joint_model="none")
    assert found.filter is not None
    assert 2.0 < found.filter.cutoff < 105.0


def test_bodies_are_the_urdfs_where_the_motion_shows_nothing() -> None:
    """Torques of a Panda with drives: masses within a factor of the truth, though most of them no motion shows."""
    robot = tl.load_robot("panda", lock=FINGERS)
    t, q, v, a = motion(robot, 600, duration=10.0)
    tau = robot.inverse_dynamics(q, v, a) + 0.3 * v + 0.4 * np.sign(v)
    found = identify(robot, t, q, v, noisy(tau, 0.3), a=a)
    for before, after in zip(list(robot.model.inertias)[1:], list(found.found.model.inertias)[1:], strict=True):
        assert 0.3 * before.mass < after.mass < 3 * before.mass
    assert found.consistency.consistent
    text = str(found)
    assert max(map(len, text.splitlines())) < 250
    assert "panda_link1.origin_inertia.zz and " in text


def test_without_torques_only_ratios_are_told_and_all_parameters_are_refused() -> None:
    run = tl.simulate(tl.Scene(ARM, [0.3, -0.5], effects=[tl.effects.Gravity()]), 2.0)
    zeros = np.zeros_like(run.v)
    for velocities, accelerations in ((None, None), (run.v, run.acceleration)):
        with refusal(QueryError, code="no-torques", match=r"all torques are 0, .* only ratios") as caught:
            identify(ARM, run.t, run.q, velocities, zeros, a=accelerations)
        assert 'parameters=["forearm.mass"]' in caught.value.remedy
    run = [{"t": run.t, "q": run.q, "v": run.v, "tau": zeros}]
    found = identify(ARM, run, parameters=["forearm.mass"], validate=run)
    assert found.values["forearm.mass"] == pytest.approx(ARM.mass - ARM.parameter_values[0], rel=1e-3)
    assert found.warnings == ["shoulder, elbow: all measured torques are 0: there is nothing to explain"]
    assert "% of its torques" not in str(found)
    assert found.to_dict()["explained"] == {"shoulder": None, "elbow": None}
    assert found.to_dict()["validation"]["elbow"]["share"] is None


def test_a_joint_that_nothing_explains_is_the_first_line() -> None:
    t, q, v, a = motion(ARM)
    tau = ARM.inverse_dynamics(q, v, a)
    tau[:, 1] = np.random.default_rng(0).standard_normal(len(t))
    found = identify(ARM, t, q, v, tau, a=a)
    assert str(found).splitlines()[0].startswith("elbow: ")
    assert found.explained[1] < 0.2
    assert found.explained[0] > 0.8
    assert found.to_dict()["explained"]["elbow"] == pytest.approx(found.explained[1])
