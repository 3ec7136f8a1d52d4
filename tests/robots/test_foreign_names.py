"""Names that are not URDF's: unknown ones are refused with their place, those of known other programs are reported."""

import pytest

import twolink as tl
from tests.refusals import refusal
from twolink.errors import RobotError

TEXT = """<robot name="r">
<link name="base"/>
<link name="arm"><inertial><origin xyz="0.1 0 0"/><mass value="2"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="revolute"><origin xyz="1 0 0"/><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/><dynamics damping="0.1"/></joint>
<joint name="follower" type="continuous"><parent link="arm"/><child link="tip"/><mimic joint="hinge"/></joint>
<link name="tip"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
</robot>"""

# What is written in place of what, and parts of the message.
UNKNOWN = {
    "attribute of robot": ('<robot name="r">', '<robot name="r" units="mm">', ["units= is unknown in <robot>"]),
    "attribute of link": ('<link name="arm">', '<link name="arm" mass="3">', ["'arm'", "mass= is unknown in <link>"]),
    "attribute of inertial": ("<inertial><o", '<inertial mass="3"><o', ["'arm'", "mass= is unknown in <inertial>"]),
    "origin of an inertial": (
        'origin xyz="0.1 0 0"', 'origin xzy="0.1 0 0"', ["link 'arm'", "xzy= is unknown", "mean 'xyz'"]),
    "origin of a joint": (
        'origin xyz="1 0 0"', 'origin xyz="1 0 0" rpx="1 0 0"', ["joint 'hinge'", ":5", "rpx=", "mean 'rpy'"]),
    "unit of a mass": ('mass value="2"', 'mass value="2" unit="g"', ["unit= is unknown in <mass>", "known: value"]),
    "misspelt mass": ('mass value="2"', 'mass valeu="2"', ["valeu= is unknown", "mean 'value'"]),
    "inertia in another case": ('ixx="1"', 'ixX="1"', ["link 'arm'", "ixX= is unknown", "mean 'ixx'"]),
    "more in an inertia": ('iyz="0"/></inertial></link>\n<j', 'iyz="0" iyx="1"/></inertial></link>\n<j', ["iyx="]),
    "axis by angles": ('axis xyz="0 1 0"', 'axis xyz="0 1 0" rpy="1 0 0"', ["rpy= is unknown in <axis>"]),
    "attribute of a joint": ('type="revolute"', 'type="revolute" armature="1"', ["armature= is unknown in <joint>"]),
    "misspelt limit": ('lower="-1"', 'loer="-1"', ["joint 'hinge'", "loer= is unknown", "mean 'lower'"]),
    "misspelt damping": ('damping="0.1"', 'dampng="0.1"', ["joint 'hinge'", "mean 'damping'"]),
    "misspelt multiplier": (
        'mimic joint="hinge"', 'mimic joint="hinge" multiplyer="2"', ["joint 'follower'", "mean 'multiplier'"]),
    "misspelt inertial": (
        "<inertial><o", "<inertail/><inertial><o", ["link 'arm'", "<inertail> is unknown", "mean 'inertial'"]),
    "misspelt joint": ("</robot>", '<jiont name="k"/></robot>', ["<jiont> is unknown in <robot>", "mean 'joint'"]),
    "capital letters": ("</robot>", '<Link name="k"/></robot>', ["<Link> is unknown"]),
    "mass beside inertial": ("<inertial><o", '<mass value="1"/><inertial><o', ["<mass> is unknown in <link>"]),
    "origin of a link": (
        "<inertial><o", '<origin xyz="0 0 1"/><inertial><o', ["link 'arm'", "<origin> is unknown in <link>"]),
    "turned origin of a link": (
        "<inertial><o", '<origin quat_xyzw="1 0 0 0"/><inertial><o', ["<origin> is unknown in <link>"]),
    "old name of dynamics": (
        "<dynamics", '<joint_properties damping="1"/><dynamics', ["<joint_properties> is unknown in <joint>"]),
    "closed loop": ("</robot>", '<loop_joint name="k"/></robot>', ["<loop_joint> is unknown"]),
    "another program's joint": ("</robot>", '<drake:joint name="k"/></robot>', ["<drake:joint> is unknown"]),
    "two inertials": ("<inertial><o", "<inertial/><inertial><o", ["link 'arm'", "<inertial> stands twice"]),
    "two masses": ('<mass value="2"/>', '<mass value="2"/><mass value="2"/>', ["link 'arm'", "<mass> stands twice"]),
    "two origins": ('<origin xyz="1 0 0"/>', '<origin xyz="1 0 0"/><origin/>', ["joint 'hinge'", "stands twice"]),
    "two axes": ('<axis xyz="0 1 0"/>', '<axis xyz="0 1 0"/><axis xyz="1 0 0"/>', ["<axis> stands twice"]),
    "two limits": ("<limit", "<limit/><limit", ["joint 'hinge'", "<limit> stands twice"]),
    "text in place of attributes": ('<origin xyz="1 0 0"/>', "<origin>1 0 0</origin>", ["has text in place"]),
}  # fmt: skip


def changed(old: str, new: str) -> str:
    assert TEXT.count(old) >= 1
    return TEXT.replace(old, new, 1)


@pytest.mark.parametrize("case", UNKNOWN)
def test_what_may_change_the_dynamics_and_is_not_understood_is_refused(case: str) -> None:
    old, new, parts = UNKNOWN[case]
    with refusal(RobotError, "URDF text:", *parts, code="urdf"):
        tl.load_robot(changed(old, new))


# What other programs write into a URDF, and parts of the report.
FOREIGN = {
    "transmission": (
        "</robot>", "<transmission><joint><mechanicalReduction>50</mechanicalReduction></joint></transmission></robot>",
        ["1 x transmissions", "change the motion there", "1 x mechanicalReduction in <transmission>"]),
    "Gazebo's springs": (
        "</robot>", '<gazebo reference="hinge"><springStiffness>5</springStiffness><mu1>1</mu1></gazebo></robot>',
        ["1 x <gazebo> blocks", "springStiffness in <gazebo>", "1 x mu1 in <gazebo>"]),
    "Gazebo's plugins": ("</robot>", "<gazebo><plugin><kp>1</kp></plugin></gazebo></robot>", ["1 x <gazebo> blocks"]),
    "rotor inertia": (
        "</robot>", '<transmission><drake:rotor_inertia value="1"/></transmission></robot>', ["rotor_inertia in"]),
    "ros2_control": ("</robot>", "<ros2_control/></robot>", ["1 x <ros2_control>"]),
    "safety": ("<dynamics", '<safety_controller k_velocity="1"/><dynamics', ["safety controllers"]),
    "onshape-to-robot's joints": (
        "<dynamics", '<joint_properties friction="0.0"/><dynamics', ["1 x <joint_properties>"]),
    "pybullet's contact": (
        "<inertial><o", '<contact><inertia_scaling value="3"/></contact><inertial><o',
        ["contact coefficients", "inertia_scaling in <contact>"]),
    "SDF's gravity": ("<inertial><o", "<gravity>0</gravity><inertial><o", ["1 x <gravity>"]),
    "another program's spring": ('damping="0.1"', 'damping="0.1" K="7000"', ["programs: 1 x K= in <dynamics>"]),
    "gains and elasticity of controllers": (
        "<dynamics", '<controller_gains Kp="2" Kd="1"/><traits spring_k="2.5"/><dynamics',
        ["1 x <controller_gains>", "traits in <joint>"]),
    "Drake's frames": ("</robot>", '<frame name="f" link="a"/></robot>', ["1 x <frame>"]),
    "a prefix": ('<mass value="2"/>', '<mass value="2" drake:x="1"/>', ["1 x drake:x= in <mass>"]),
    "an element with a prefix": ("</robot>", "<drake:frame/></robot>", ["1 x <drake:frame>"]),
    "origin that moves nothing": ("<inertial><o", '<origin xyz="0 0 0" rpy="0 -0 0"/><inertial><o', ["1 x <origin>"]),
    "text beside attributes": ('<origin xyz="1 0 0"/>', '<origin xyz="1 0 0">1 0 0</origin>', ["1 x in <origin>"]),
}  # fmt: skip


@pytest.mark.parametrize("case", FOREIGN)
def test_what_belongs_to_other_programs_is_reported_and_changes_nothing(case: str) -> None:
    old, new, parts = FOREIGN[case]
    robot = tl.load_robot(changed(old, new))
    said = " | ".join(str(finding) for finding in robot.report.ignored)
    for part in parts:
        assert part in said
    assert "kp in" not in said  # a plugin's numbers are its own
    assert robot.model == tl.load_robot(TEXT).model


def test_namespace_declarations_are_not_mentioned() -> None:
    text = changed('<robot name="r">', '<robot name="r" xmlns="http://a/b" xmlns:drake="http://c/d">')
    assert "xmlns" not in str(tl.load_robot(text).report)


LEFT_OUT = (
    "attribute of robot", "attribute of link", "attribute of inertial", "origin of a joint", "unit of a mass",
    "axis by angles", "attribute of a joint", "more in an inertia", "capital letters", "origin of a link",
    "old name of dynamics", "closed loop", "another program's joint",
)  # fmt: skip


@pytest.mark.parametrize("case", LEFT_OUT)
def test_unknown_names_are_left_out_and_listed_where_that_is_asked_for(case: str) -> None:
    old, new, _ = UNKNOWN[case]
    robot = tl.load_robot(changed(old, new), foreign="report")
    (listed,) = [finding for finding in robot.report.ignored if 'foreign="report"' in finding.what]
    assert len(listed.names) == 1
    assert listed.names[0].startswith("1 x ")
    assert robot.model == tl.load_robot(TEXT).model


def test_what_is_required_is_refused_still() -> None:
    with pytest.raises(RobotError, match="has no value"):
        tl.load_robot(changed('mass value="2"', 'mass valeu="2"'), foreign="report")
