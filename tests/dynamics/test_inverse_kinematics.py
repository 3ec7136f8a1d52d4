"""Inverse kinematics: against the law of cosines, and against the frame's pose at the solution."""

import numpy as np
import pytest

import twolink as tl
from tests.refusals import refusal
from tests.urdf_text import joint, link, robot_of
from twolink.errors import QueryError

FREE = robot_of(joint("j", "floating", "ground", "box"), link("box"))


def test_two_links_reach_where_the_law_of_cosines_says() -> None:
    robot = tl.load_robot("two_link")
    elbow, tip = (robot.frame_pose(robot.neutral, frame)[1] for frame in ("forearm", "tip"))
    shoulder = robot.frame_pose(robot.neutral, "upper_arm")[1]
    a, b = float(np.linalg.norm(elbow - shoulder)), float(np.linalg.norm(tip - elbow))
    direction = (tip - shoulder) / (a + b)
    for distance in np.linspace(1.02 * abs(a - b), 0.98 * (a + b), 7):
        q = robot.inverse_kinematics("tip", shoulder + distance * direction, q0=[0.3, 0.9])
        assert np.cos(q[1]) == pytest.approx((distance**2 - a**2 - b**2) / (2 * a * b), abs=1e-9)
    with pytest.raises(QueryError) as caught:
        robot.inverse_kinematics("tip", shoulder + 1.5 * (a + b) * direction)
    assert caught.value.code == "unreachable"
    assert caught.value.data["distance"] == pytest.approx(0.5 * (a + b), rel=1e-6)
    assert robot.frame_pose(caught.value.data["closest"], "tip")[1] == pytest.approx(tip, abs=1e-4)


@pytest.mark.parametrize(
    ("name", "frame"), [("panda", "panda_hand"), ("ur5", "tool0"), ("talos", "gripper_left_base_link")]
)
def test_a_frame_comes_where_it_was_before(name: str, frame: str) -> None:
    robot = tl.load_robot(name)
    wanted, _ = robot.random_state(6, seed=3)
    rotation, position = robot.frame_pose(wanted, frame)
    q = robot.inverse_kinematics(frame, position, rotation)
    at_rotation, at_position = robot.frame_pose(q, frame)
    assert np.abs(at_position - position).max() <= 1e-10
    assert np.abs(at_rotation - rotation).max() <= 2e-10
    for places in (one.q for one in robot.joints if one.kind == "vector"):
        assert (q[:, places] >= robot.model.lowerPositionLimit[places]).all()
        assert (q[:, places] <= robot.model.upperPositionLimit[places]).all()


def test_a_path_of_targets_gives_a_path_of_the_robot() -> None:
    robot = tl.load_robot("panda")
    start = np.array([0.0, -0.5, 0.0, -2.2, 0.0, 1.8, 0.7, *robot.neutral[7:]])
    rotation, centre = robot.frame_pose(start, "panda_hand")
    angle = np.linspace(0.0, 2 * np.pi, 60)
    circle = centre + 0.1 * np.stack([np.cos(angle) - 1.0, np.sin(angle), 0.0 * angle], axis=-1)
    q = robot.inverse_kinematics("panda_hand", circle, rotation, q0=start)
    assert np.abs(np.diff(q, axis=0)).max() < 0.1
    assert q[0] == pytest.approx(start, abs=1e-8)


def test_a_free_body_is_put_anywhere() -> None:
    robot = tl.load_robot(FREE)
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    q = robot.inverse_kinematics("box", [1.0, 2.0, 3.0], turn @ turn)  # half a turn
    assert q == pytest.approx(np.array([1.0, 2.0, 3.0, 0.0, 0.0, np.sign(q[5]), 0.0]), abs=1e-9)


@pytest.mark.parametrize(("given", "part"), [
    ({}, "got neither"),
    ({"position": [0.0, 0.0]}, "(..., 3)"),
    ({"position": [0.0, np.nan, 0.0]}, "finite"),
    ({"rotation": 2 * np.eye(3)}, "R R^T"),
    ({"rotation": -np.eye(3)}, "det"),
    ({"rotation": np.eye(2)}, "(..., 3, 3)"),
    ({"position": np.zeros((2, 3)), "rotation": np.zeros((3, 3, 3)) + np.eye(3)}, "broadcast"),
    ({"position": np.zeros(3), "q0": np.zeros((2, 2))}, "one configuration"),
])  # fmt: skip
def test_what_cannot_be_a_target_is_refused(given: dict[str, object], part: str) -> None:
    robot = tl.load_robot("two_link")
    with refusal(QueryError, part):
        robot.inverse_kinematics("tip", **given)


def test_an_unknown_frame_is_named() -> None:
    with refusal(QueryError, code="unknown-frame"):
        tl.load_robot("two_link").inverse_kinematics("hand", [0.0, 0.0, 0.0])
