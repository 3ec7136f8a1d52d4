"""Differences, steps and random configurations on every kind of joint."""

import mpmath
import numpy as np
import pytest

import twolink as tl
from tests.dynamics.robots import of_every_kind
from tests.dynamics.states import close
from twolink.errors import QueryError

ROBOTS = of_every_kind()


@pytest.fixture(scope="module", params=ROBOTS)
def robot(request: pytest.FixtureRequest) -> tl.Robot:
    return ROBOTS[request.param]


def test_difference_and_integrate_are_inverses(robot: tl.Robot) -> None:
    q0, v = robot.random_state(50, seed=1)
    q1, _ = robot.random_state(50, seed=2)
    close(robot.difference(q0, robot.integrate(q0, 1.5 * v)), 1.5 * v, 1e-12)
    reached = robot.integrate(q0, robot.difference(q0, q1))
    for joint in robot.joints:  # q and -q are the same rotation
        if joint.kind in ("quaternion", "free-flyer"):
            part = joint.normalized
            reached[:, part] *= np.sign(np.sum(reached[:, part] * q1[:, part], axis=1))[:, None]
    close(reached, q1, 1e-12)


@pytest.mark.parametrize("size", [1e-6, 1e-9, 1e-12])
def test_small_differences_keep_their_digits(robot: tl.Robot, size: float) -> None:
    """The rounding of q is 1e-16; an arc cosine of the angle would be off by 1e-8."""
    q, v = robot.random_state(200, seed=5)
    np.testing.assert_allclose(robot.difference(q, robot.integrate(q, size * v)), size * v, rtol=0, atol=2e-15)


def test_angle_of_a_continuous_joint_against_exact_arithmetic() -> None:
    robot = ROBOTS["chain"]
    angles = np.array([0.3, 2.9, -3.1, 1.0, -1.5707, 0.0])
    near = angles + np.array([1e-9, -3e-10, 2e-8, 5e-12, -1e-13, 1e-15])
    q0, q1 = (np.stack([np.cos(x), np.sin(x)], axis=-1).ravel() for x in (angles, near))
    with mpmath.workdps(40):
        pairs = zip(q0.reshape(-1, 2).tolist(), q1.reshape(-1, 2).tolist(), strict=True)
        exact = [float(mpmath.atan2(a[0] * b[1] - a[1] * b[0], a[0] * b[0] + a[1] * b[1]))
                 for a, b in (([mpmath.mpf(x) for x in a], [mpmath.mpf(x) for x in b]) for a, b in pairs)]  # fmt: skip
    np.testing.assert_allclose(robot.difference(q0, q1), exact, rtol=0, atol=2e-16)


def test_a_straight_line_of_a_planar_joint() -> None:
    """Without turning, a planar base moves along its own axes; a quarter turn follows a circle."""
    robot = ROBOTS["planar"]
    start = robot.neutral
    moved = robot.integrate(start, [0.3, -0.2, 0.0, 0.0, 0.0])
    close(moved[:4], np.array([0.3, -0.2, 1.0, 0.0]))
    quarter = robot.integrate(start, [np.pi / 2, 0.0, np.pi / 2, 0.0, 0.0])  # radius 1 to the left
    close(quarter[:4], np.array([1.0, 1.0, 0.0, 1.0]))
    close(robot.difference(start, quarter)[:3], np.array([np.pi / 2, 0.0, np.pi / 2]))


def test_a_planar_step_with_little_turning_keeps_its_digits() -> None:
    """(1 - cos w) / w is w / 2 for a small w; evaluated as it stands it is off by 1e-16 / w."""
    robot = ROBOTS["planar"]
    moved = robot.integrate(robot.neutral, [1.0, 0.5, 1e-9, 0.0, 0.0])
    np.testing.assert_allclose(moved[:2], [1.0 - 0.25e-9, 0.5 + 0.5e-9], rtol=0, atol=2e-16)


def test_batches_broadcast(robot: tl.Robot) -> None:
    q, v = robot.random_state(6)
    assert robot.integrate(q[0], v.reshape(2, 3, -1)).shape == (2, 3, robot.nq)
    assert np.array_equal(robot.difference(q[0], q)[3], robot.difference(q[0], q[3]))
    assert robot.difference(q[:0], q[:0]).shape == (0, robot.nv)


def test_random_states_are_within_limits_and_repeat(robot: tl.Robot) -> None:
    q, v = robot.random_state(300, seed=7)
    assert q.shape == (300, robot.nq)
    assert v.shape == (300, robot.nv)
    assert np.array_equal(q, robot.random_state(300, seed=7)[0])
    assert not np.array_equal(q, robot.random_state(300, seed=8)[0])
    assert np.abs(v).max() <= 1
    close(robot.normalize(q), q)
    for joint in robot.joints:
        if joint.kind == "vector":
            low, high = robot.model.lowerPositionLimit[joint.q], robot.model.upperPositionLimit[joint.q]
            assert (q[:, joint.q] >= low).all()
            assert (q[:, joint.q] <= high).all()
            assert np.ptp(q[:, joint.q]) > 0.8 * min(high - low, 2 * np.pi)
        elif joint.kind == "cos-sin":  # uniform: the mean of the pair vanishes
            assert np.abs(q[:, joint.q].mean(axis=0)).max() < 0.2


def test_wrong_arguments_are_refused() -> None:
    robot = ROBOTS["chain"]
    with pytest.raises(QueryError, match=r"q1: .*expected length 1"):
        robot.difference(robot.neutral, 1.1 * robot.neutral)
    with pytest.raises(QueryError, match="dv: expected shape"):
        robot.integrate(robot.neutral, np.zeros(3))
    for n in (-1, 2.5, True, "3"):
        with pytest.raises(QueryError, match="n: expected a whole number"):
            robot.random_state(n)


def test_the_error_of_a_length_names_the_joints_with_several_entries() -> None:
    of_base = r"with \(position, quaternion x y z w\) of 'root_joint'$"
    for name, root, words in (
        ("kinova", "fixed", r"with \(cos, sin\) of 'j2s6s200_joint_1'"),
        ("solo12", "free", of_base),
    ):
        robot = tl.load_robot(name, root=root)
        with pytest.raises(tl.errors.QueryError, match=words):
            robot.mass_matrix(np.zeros(robot.nv))


def test_limits_of_0_to_0_are_none() -> None:
    """As files have that must have limits: random states and inverse kinematics took such joints as locked."""
    robot = tl.load_robot("double_pendulum")
    assert [(joint.lower, joint.upper) for joint in robot.joints] == [((-np.inf,), (np.inf,))] * 2
    q, _ = robot.random_state(50)
    assert np.ptp(q, axis=0).min() > np.pi
    for one in q[:5]:
        position = robot.frame_pose(one, "link2")[1]
        again = robot.inverse_kinematics("link2", position)
        np.testing.assert_allclose(robot.frame_pose(again, "link2")[1], position, rtol=0, atol=1e-9)
    assert tl.load_robot("double_pendulum", lock={"joint2": 0.3}).report.suspicious == ()
