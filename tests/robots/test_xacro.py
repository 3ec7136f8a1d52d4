"""xacro: arguments, packages found without ROS, and errors with file and line."""

import sys
from pathlib import Path

import pytest

import twolink as tl
from tests.command import answer
from tests.refusals import refusal
from twolink.errors import RobotError

TEXT = """<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">
<xacro:arg name="mass" default="2"/>
<xacro:include filename="$(find my_arm)/parts/link.xacro"/>
<link name="base"/>
<xacro:body name="arm" mass="$(arg mass)"/>
<joint name="hinge" type="continuous"><parent link="base"/><child link="arm"/></joint>
</robot>"""
PART = """<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:macro name="body" params="name mass">
<link name="${name}"><inertial><mass value="${mass}"/>
<inertia ixx="${mass * 0.1}" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link></xacro:macro></robot>"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A package whose folder has another name than itself."""
    for name, text in {
        "checkout/urdf/arm.urdf.xacro": TEXT,
        "checkout/parts/link.xacro": PART,
        "checkout/package.xml": "<package><name>my_arm</name></package>",
    }.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return tmp_path


def test_arguments_and_packages(folder: Path) -> None:
    path = folder / "checkout" / "urdf" / "arm.urdf.xacro"
    assert tl.load_robot(path).mass == 2
    assert tl.load_robot(path, xacro_arguments={"mass": 5}).mass == 5
    with refusal(RobotError, "no argument 'mas'", "did you mean 'mass'", code="xacro", argument="xacro_arguments"):
        tl.load_robot(path, xacro_arguments={"mas": 5})
    hand = '<xacro:if value="0"><xacro:arg name="finger" default="1"/></xacro:if></robot>'
    path.write_text(path.read_text().replace("</robot>", hand))
    assert tl.load_robot(path, xacro_arguments={"mass": 5, "finger": 2}).mass == 5  # of a part that is not there
    away = folder / "away.urdf.xacro"
    away.write_text(TEXT)
    assert tl.load_robot(away, package_dirs=[folder / "checkout"]).mass == 2


@pytest.mark.parametrize(("old", "new", "words"), [
    ("$(arg mass)", "$(arg mess)", ["arm.urdf.xacro:5", "mess"]),
    ("my_arm", "my_leg", ["arm.urdf.xacro:3", "'my_leg' is not found", "package_dirs"]),
    ("${mass * 0.1}", "${mas * 0.1}", ["link.xacro:3", "mas"]),
    ("</robot>", "</rbot>", ["arm.urdf.xacro:7"]),
    ('name="hinge"', 'name="hinge" armature="1"', ["joint 'hinge'", "armature="]),
])  # fmt: skip
def test_errors_name_file_and_line(folder: Path, old: str, new: str, words: list[str]) -> None:
    for path in folder.rglob("*.xacro"):
        path.write_text(path.read_text().replace(old, new))
    with refusal(RobotError, *words):
        tl.load_robot(folder / "checkout" / "urdf" / "arm.urdf.xacro")


def test_without_the_extra_the_command_is_given(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "xacro", None)
    with pytest.raises(ImportError, match=r"pip install 'twolink\[xacro\]'"):
        tl.load_robot(folder / "checkout" / "urdf" / "arm.urdf.xacro")


def test_arguments_of_no_xacro_are_refused() -> None:
    with pytest.raises(RobotError, match="no xacro"):
        tl.load_robot("arm", xacro_arguments={"a": 1})


LEFT = """<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">
<xacro:property name="width" value="2"/>
<xacro:include filename="$(find nowhere)/macros.xacro"/>
<link name="base"/>
<link name="arm"><inertial><mass value="3"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
<visual><geometry><box size="1 1 1"/></geometry><xacro:paint/></visual></link>
<joint name="hinge" type="continuous"><parent link="base"/><child link="arm"/>
<xacro:property name="w" value="1"/></joint>
<xacro:if value="0"><link name="tool"/></xacro:if>
</robot>"""


def test_a_finished_urdf_with_xacro_left_in_it(tmp_path: Path) -> None:
    path = tmp_path / "finished.urdf"
    path.write_text(LEFT)
    for source in (path, LEFT):
        with pytest.raises(RobotError, match='of a finished URDF, xacro="ignore"'):
            tl.load_robot(source)
        robot = tl.load_robot(source, xacro="ignore")
        assert (robot.mass, robot.joint_names) == (3.0, ("hinge",))
        (said,) = [finding for finding in robot.report.ignored if "xacro" in finding.what]
        assert set(said.names) == {"2 x <xacro:property>", "1 x <xacro:include>", "1 x <xacro:paint>", "1 x <xacro:if>",
                                   "1 x <link> in <xacro:if>"}  # fmt: skip
    answered = answer("inspect", str(path), "--xacro", "ignore")
    assert any("xacro" in finding["what"] for finding in answered["report"]["ignored"])
    with pytest.raises(RobotError, match=r"'\$\{w\}' is not a number"):  # not finished: nothing is guessed
        tl.load_robot(LEFT.replace('mass value="3"', 'mass value="${w}"'), xacro="ignore")
    with pytest.raises(RobotError, match="did you mean 'ignore'"):
        tl.load_robot(path, xacro="ignored")
