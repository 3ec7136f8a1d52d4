"""The versions 1.0 to 1.2 of the format as urdfdom 6 defines them, with quaternions: read rightly, or refused."""

import math

import numpy as np
import pinocchio as pin
import pytest

import twolink as tl
from tests.refusals import refusal
from twolink.errors import RobotError
from twolink.robots.urdf import roll_pitch_yaw

FULL = 'lower="-1" upper="1" effort="3" velocity="4"'
RATES = 'acceleration="5" deceleration="6" jerk="7"'
CAPSULE = '<visual><geometry><capsule radius="0.1" length="0.5"/></geometry></visual>'


def text_of(version: str | None, limit: str = FULL, kind: str = "revolute", extra: str = "") -> str:
    declared = "" if version is None else f' version="{version}"'
    return f"""<robot name="r"{declared}><link name="a"/><link name="b"><inertial><mass value="1"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>{extra}</link><joint name="j" type="{kind}">
    <parent link="a"/><child link="b"/><axis xyz="0 0 1"/><limit {limit}/></joint></robot>"""


@pytest.mark.parametrize("version", [None, "1.0", "1.1", "1.2"])
def test_limits_of_known_versions(version: str | None) -> None:
    model = tl.load_robot(text_of(version)).model
    expected = pin.buildModelFromXML(text_of(version))
    assert model == expected
    assert (model.lowerPositionLimit[0], model.upperPositionLimit[0], model.velocityLimit[0]) == (-1, 1, 4)


@pytest.mark.parametrize("version", ["1.3", "2.0", "0.9", "1", "1.2.0", "", "one", " 1.0"])
def test_unknown_versions_are_refused(version: str) -> None:
    with pytest.raises(RobotError, match=r"known are 1\.0, 1\.1, 1\.2"):
        tl.load_robot(text_of(version))


@pytest.mark.parametrize("missing", ["effort", "velocity"])
def test_effort_and_velocity_may_be_left_out_in_version_1_2(missing: str) -> None:
    limit = " ".join(part for part in FULL.split() if missing not in part)
    for version in (None, "1.1"):
        with pytest.raises(RobotError, match=f"<limit> has no {missing}"):
            tl.load_robot(text_of(version, limit))
    model = tl.load_robot(text_of("1.2", limit)).model
    value = model.velocityLimit[0] if missing == "velocity" else model.upperEffortLimit[0]
    assert value == math.inf


@pytest.mark.parametrize("missing", ["lower", "upper"])
def test_position_limits_may_not_be_left_out_in_version_1_2(missing: str) -> None:
    limit = " ".join(part for part in FULL.split() if missing not in part)
    assert "taken as 0: j" in str(tl.load_robot(text_of("1.1", limit)).report)
    with pytest.raises(RobotError, match=f"<limit> has no {missing}"):
        tl.load_robot(text_of("1.2", limit))
    assert tl.load_robot(text_of("1.2", limit, "continuous")).nv == 1


@pytest.mark.parametrize("version", ["1.0", "1.2"])
def test_limits_of_acceleration_and_jerk_are_checked_and_reported(
    version: str, capfd: pytest.CaptureFixture[str]
) -> None:
    robot = tl.load_robot(text_of(version, f"{FULL} {RATES}"))
    assert any("acceleration, deceleration and jerk" in str(f) and "j" in f.names for f in robot.report.ignored)
    assert capfd.readouterr().err == ""  # Pinocchio's parser has nothing to complain about
    for bad, part in (("-5", "negative"), ("x", "not a number"), ("nan", "not finite")):
        with pytest.raises(RobotError, match=part):
            tl.load_robot(text_of(version, f'{FULL} acceleration="{bad}"'))


@pytest.mark.parametrize("version", [None, "1.0"])
def test_quaternions_are_refused_where_the_version_has_none(version: str | None) -> None:
    """urdfdom ignores them there, so that other programs see another robot."""
    turned = '<visual><origin quat_xyzw="1 0 0 0"/><geometry><sphere radius="1"/></geometry></visual>'
    for text in (
        text_of(version, extra=turned),
        text_of(version).replace("<axis", '<origin quat_xyzw="1 0 0 0"/><axis'),
    ):
        with pytest.raises(RobotError, match=r'came with URDF 1\.1.*write <robot version="1\.1">'):
            tl.load_robot(text)


@pytest.mark.parametrize("version", [None, "1.1", "1.2"])
def test_capsules_are_drawn_and_read_by_the_second_reader(version: str | None) -> None:
    from twolink.robots.checks import compare

    robot = tl.load_robot(text_of(version, extra=CAPSULE))
    (shape,) = robot.visual_model().geometryObjects
    assert (shape.geometry.radius, 2 * shape.geometry.halfLength) == (0.1, 0.5)
    assert compare(robot)["agree"]
    np.testing.assert_array_equal(robot.model.inertias[1].inertia, np.eye(3))


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


@pytest.mark.parametrize(("origin", "part"), [
    ('rpy="0 0 0" quat_xyzw="0 0 0 1"', "both rpy and quat_xyzw"),
    ('quat_xyzw="1 1 1 1"', "has length 2, expected 1"),
    ('quat_xyzw="0 0 0 0"', "has length 0, expected 1"),
    ('quat_xyzw="0 0 1"', "expected 4 numbers, got 3"),
    ('quat_xyzw="0 0 0 nan"', "not finite"),
])  # fmt: skip
def test_quaternions_that_are_no_orientation_are_refused(origin: str, part: str) -> None:
    for text in (robot_text(origin, ""), robot_text("", origin), robot_text("", "", origin)):
        with refusal(RobotError, "URDF text:", part):
            tl.load_robot(text)


def test_a_quaternion_of_few_digits_is_normalised() -> None:
    robot = tl.load_robot(robot_text('quat_xyzw="0 0 0.7071 0.7071"', ""))
    turn = robot.model.jointPlacements[1].rotation
    np.testing.assert_allclose(turn, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], rtol=0, atol=1e-15)
