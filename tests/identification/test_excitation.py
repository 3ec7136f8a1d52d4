"""Exciting motions: within the limits, at rest at both ends, and better than random ones."""

from pathlib import Path

import numpy as np
import pytest

import twolink as tl
from twolink.errors import QueryError
from twolink.identification import exciting_motion, identify


@pytest.mark.parametrize("name", ["arm", pytest.param("kinova", marks=pytest.mark.slow)])
def test_it_keeps_the_limits_and_is_better_than_random_motions(name: str) -> None:
    robot = tl.load_robot(name)
    motion = exciting_motion(robot, 6.0, samples=1000, steps=4)
    assert motion.condition < 0.8 * motion.first
    model = robot.model
    for joint in robot.joints:
        assert np.abs(motion.v[:, joint.v]).max() <= model.velocityLimit[joint.v.start]
        if joint.kind == "vector":
            assert motion.q[:, joint.q].max() <= model.upperPositionLimit[joint.q.start]
            assert motion.q[:, joint.q].min() >= model.lowerPositionLimit[joint.q.start]
    found = identify(robot, motion.t, motion.q, motion.v, robot.inverse_dynamics(motion.q, motion.v, motion.a),
                     a=motion.a)  # fmt: skip
    assert found.condition == pytest.approx(motion.condition, rel=0.1)


def test_it_starts_and_ends_at_rest_and_its_rates_are_its_own(tmp_path: Path) -> None:
    robot = tl.load_robot("kinova")
    motion = exciting_motion(robot, 6.0, samples=2000, steps=0)
    ends = [0, -1]
    for values in (motion.v[ends], motion.a[ends], robot.difference(*motion.q[ends])):
        np.testing.assert_allclose(values, 0, atol=1e-12)
    step = motion.t[1]
    moved = robot.difference(motion.q[:-2], motion.q[2:]) / (2 * step)
    near = 1e-3 * np.abs(motion.a).max()
    np.testing.assert_allclose(moved, motion.v[1:-1], atol=near)
    np.testing.assert_allclose((motion.v[2:] - motion.v[:-2]) / (2 * step), motion.a[1:-1], atol=near)
    motion.save(tmp_path / "motion.npz")
    columns = np.load(tmp_path / "motion.npz")
    assert np.array_equal(columns[f"v.{robot.joint_names[0]}"], motion.v[:, 0])


def test_what_cannot_be_driven_is_refused() -> None:
    with pytest.raises(QueryError, match="load the robot with a fixed root") as caught:
        exciting_motion(tl.load_robot("anymal", root="free"), 5.0)
    assert caught.value.code == "floating-base"
    with pytest.raises(QueryError, match="duration: expected a number above 0"):
        exciting_motion(tl.load_robot("arm"), 0.0)
    with pytest.raises(QueryError, match="no joint torque depends on") as caught:
        exciting_motion(tl.load_robot("arm"), 5.0, ["forearm.first_moment.y"])
    assert caught.value.code == "nothing-identifiable"
