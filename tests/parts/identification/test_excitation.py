"""Exciting motions: within the limits, at rest at both ends, and better than random ones."""

import re
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import twolink as tl
from tests import urdf_text
from tests.refusals import refusal
from twolink.errors import QueryError
from twolink.identification import exciting_motion, identify
from twolink.robots.collisions import collision_model


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


WIDE = [("revolute", 0.5, 7.0), ("prismatic", 0.0, 8.0), ("revolute", 1.0, 1e30), ("prismatic", -1e30, -2.0)]


@pytest.mark.parametrize(("kind", "lower", "upper"), WIDE)
def test_wide_ranges_and_limits_on_one_side_are_kept(kind: str, lower: float, upper: float) -> None:
    """Such ranges were taken as -pi to pi. 0.9 of a turn is used, as near to 0 as the limits allow."""
    text = urdf_text.robot_of(
        urdf_text.link("body", at="0.1 0.2 0"),
        urdf_text.joint("axis", kind, "ground", "body", lower=lower, upper=upper),
    )
    q = exciting_motion(tl.load_robot(text), 40.0, ["body.mass", "body.origin_inertia.zz"], steps=0).q
    assert lower <= q.min() < q.max() <= upper
    assert np.ptp(q) == pytest.approx(0.9 * 2 * np.pi, rel=0.01)
    nearest = lower if lower > -1e9 else upper
    assert np.abs(q - nearest).min() == pytest.approx(0.1 * np.pi, rel=0.05)


def test_it_starts_and_ends_at_rest_and_its_rates_are_its_own(tmp_path: Path) -> None:
    robot = tl.load_robot("kinova")
    motion = exciting_motion(robot, 3.0, samples=1000, steps=0)
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
    with refusal(QueryError, code="floating-base", match="load the robot with a fixed root"):
        exciting_motion(tl.load_robot("anymal", root="free"), 5.0)
    with pytest.raises(QueryError, match="duration: expected a number above 0"):
        exciting_motion(tl.load_robot("arm"), 0.0)
    with refusal(QueryError, code="nothing-identifiable", match="no joint torque depends on"):
        exciting_motion(tl.load_robot("arm"), 5.0, ["forearm.first_moment.y"])


@pytest.mark.slow
def test_links_do_not_touch_and_torques_keep_their_limits() -> None:
    robot = tl.load_robot("ur5")
    motion = exciting_motion(robot, 40.0, samples=200, steps=0, ramps=True)
    assert 0.5 < motion.share < 1, "only the joints between links that touch move less"
    assert motion.limit
    geometry = collision_model(robot.model, robot.solids)
    links = [k for k, solid in enumerate(robot.solids) if "wrist_3" in solid.link or "upper_arm" in solid.link]
    geometry.addCollisionPair(pin.CollisionPair(*links))
    seen = pin.GeometryData(geometry)
    for q in motion.q[::5]:
        pin.computeDistances(robot.model, robot.data, geometry, seen, q)
        assert seen.distanceResults[0].min_distance > 0
    torques = robot.inverse_dynamics(motion.q, motion.v, motion.a)
    assert np.all(np.abs(torques).max(axis=0) < np.array(robot.model.effortLimit))


def test_the_predicted_intervals_are_those_that_identify_gives() -> None:
    robot = tl.load_robot("arm")
    motion = exciting_motion(robot, 6.0, samples=1000, steps=0)
    tau = robot.inverse_dynamics(motion.q, motion.v, motion.a)
    noisy = tau + 0.05 * np.random.default_rng(0).standard_normal(tau.shape)
    found = identify(robot, motion.t, motion.q, motion.v, noisy, a=motion.a, method="weighted")
    rows = list(motion.intervals(0.05))
    assert tuple(row["parameter"] for row in rows) == found.combinations
    np.testing.assert_allclose([row["+-"] for row in rows], found.half_width, rtol=0.1)


@pytest.mark.slow
def test_a_motion_that_its_torques_do_not_allow_is_refused() -> None:
    text = re.sub(r'effort="[^"]*"', 'effort="0.01"', tl.load_robot("arm").visuals.text)
    with refusal(QueryError, code="no-motion", match="needs"):
        exciting_motion(tl.load_robot(text, gravity=(0, 0, 0)).with_gravity([9.81, 0, 0]), 5.0, steps=0)
