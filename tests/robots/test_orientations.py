"""Orientations of origins: quaternions (URDF 1.1) mean what Pinocchio's own parser reads."""

import numpy as np
import pinocchio as pin
import pytest

import twolink as tl
from twolink.errors import RobotError
from twolink.robots.urdf import roll_pitch_yaw


def robot_text(joint: str, inertial: str, visual: str = 'xyz="0 0 0"') -> str:
    return f"""<robot name="r" version="1.1"><link name="a"/><link name="b"><inertial><origin {inertial}/>
      <mass value="2"/><inertia ixx="0.2" iyy="0.25" izz="0.3" ixy="0.01" ixz="0" iyz="0"/></inertial>
      <visual><origin {visual}/><geometry><box size="1 2 3"/></geometry></visual></link>
      <joint name="j" type="continuous"><origin {joint}/><parent link="a"/><child link="b"/><axis xyz="0 1 0"/></joint>
      </robot>"""


UPRIGHT = np.sqrt(0.5)
QUATERNIONS = {
    "identity": (0, 0, 0, 1),
    "a third of a turn": (0.5, 0.5, 0.5, 0.5),
    "pitch 90 degrees": (0, UPRIGHT, 0, UPRIGHT),
    "pitch -90 degrees, yaw": (0.5, -0.5, 0.5, 0.5),
    "half a turn": (0, 0, -1, 0),
    "any": tuple(np.array([0.1, -0.2, 0.3, 0.9]) / np.sqrt(0.95)),
}


@pytest.mark.parametrize("case", QUATERNIONS)
def test_quaternions_are_read_as_pinocchio_reads_them(case: str) -> None:
    numbers = " ".join(repr(float(x)) for x in QUATERNIONS[case])
    turned = f'xyz="1 2 3" quat_xyzw="{numbers}"'
    text = robot_text(turned, turned, turned)
    robot, model = tl.load_robot(text), pin.buildModelFromXML(text)
    placement, expected = robot.model.jointPlacements[1], model.jointPlacements[1]
    np.testing.assert_allclose(placement.homogeneous, expected.homogeneous, rtol=0, atol=1e-15)
    np.testing.assert_allclose(robot.model.inertias[1].inertia, model.inertias[1].inertia, rtol=0, atol=1e-15)
    drawn = robot.visual_model().geometryObjects[0].placement.rotation
    matrix = pin.Quaternion(np.array(QUATERNIONS[case], dtype=float)).matrix()
    np.testing.assert_allclose(drawn, matrix, rtol=0, atol=1e-15)


def test_angles_of_a_quaternion_give_its_matrix_near_and_at_every_singular_pitch() -> None:
    rng = np.random.default_rng(3)
    for off in (0.0, 1e-15, 1e-10, 1e-5, 1.0):
        for _ in range(50):
            roll, yaw = rng.uniform(-np.pi, np.pi, 2)
            quaternion = pin.Quaternion(pin.rpy.rpyToMatrix(roll, np.pi / 2 - off, yaw)).coeffs()
            matrix = pin.rpy.rpyToMatrix(*roll_pitch_yaw(quaternion))
            np.testing.assert_allclose(matrix, pin.Quaternion(quaternion).matrix(), rtol=0, atol=2e-15)


@pytest.mark.parametrize(
    ("origin", "part"),
    [
        ('rpy="0 0 0" quat_xyzw="0 0 0 1"', "both rpy and quat_xyzw"),
        ('quat_xyzw="1 1 1 1"', "has length 2, expected 1"),
        ('quat_xyzw="0 0 0 0"', "has length 0, expected 1"),
        ('quat_xyzw="0 0 1"', "expected 4 numbers, got 3"),
        ('quat_xyzw="0 0 0 nan"', "not finite"),
    ],
)
def test_quaternions_that_are_no_orientation_are_refused(origin: str, part: str) -> None:
    for text in (robot_text(origin, ""), robot_text("", origin), robot_text("", "", origin)):
        with pytest.raises(RobotError, match=part) as caught:
            tl.load_robot(text)
        assert "URDF text:" in caught.value.where


def test_a_quaternion_of_few_digits_is_normalised() -> None:
    robot = tl.load_robot(robot_text('quat_xyzw="0 0 0.7071 0.7071"', ""))
    turn = robot.model.jointPlacements[1].rotation
    np.testing.assert_allclose(turn, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], rtol=0, atol=1e-15)
