"""What looks wrong in a robot's numbers is said in its load report, with the value, the reason and the remedy."""

import math
import re
from collections.abc import Callable
from pathlib import Path

import pytest

import twolink as tl
from tests.command import answer

ROD = '<origin xyz="0 0 0.2"/><mass value="{}"/><inertia ixx="0.03" iyy="0.03" izz="0.001" ixy="0" ixz="0" iyz="0"/>'
LINK = """
  <joint name="j{0}" type="revolute"><parent link="{1}"/><child link="l{0}"/><origin xyz="0 0 0.4" rpy="0 0 0"/>
    <axis xyz="0 1 0"/><limit lower="-2.9" upper="2.9" effort="80" velocity="3"/></joint>
  <link name="l{0}"><visual><geometry><sphere radius="0.1"/></geometry></visual><inertial>{2}</inertial></link>"""
BASE = '<robot name="three"><link name="base"><visual><geometry><box size="1 1 1"/></geometry></visual></link>'
URDF = BASE + "".join(
    LINK.format(k, parent, ROD.format(mass)) for k, parent, mass in ((1, "base", 4), (2, "l1", 3), (3, "l2", 1.5))
) + "</robot>"  # fmt: skip


def said(urdf: str) -> list[str]:
    report = tl.load_robot(urdf).report
    lines = [line.strip() for line in str(report).splitlines() if "suspicious" in line]
    assert lines == [f"suspicious: {finding}" for finding in report.suspicious]
    assert report.to_dict()["suspicious"] == [{"what": f.what, "names": list(f.names)} for f in report.suspicious]
    return lines


def swap(old: str, new: str) -> str:
    assert old in URDF
    return URDF.replace(old, new)


def without_inertial(link: str) -> str:
    head, found, tail = URDF.partition(f'<link name="{link}">')
    return head + found + re.sub("<inertial>.*?</inertial>", "", tail, count=1, flags=re.DOTALL)


LIMIT = 'lower="-2.9" upper="2.9"'
CASES: dict[str, tuple[Callable[[], str], tuple[str, ...]]] = {
    "degrees": (lambda: URDF.replace(LIMIT, 'lower="-170" upper="170"'),
                ("limits (-170, 170) rad, 54.1 turns", 'lower="-2.96706" upper="2.96706"', ": j1, j2, j3")),
    "degrees to one side": (lambda: URDF.replace(LIMIT, 'lower="0" upper="90"', 1), ('upper="1.5708"', ": j1")),
    "a link without mass": (lambda: without_inertial("l2"), ("no <inertial>", '<mass value="0"/>', ": l2")),
    "grams": (lambda: swap('<mass value="1.5"/>', '<mass value="1500"/>'),
              ("a mass of 1500 kg, 214 times the 7 kg that carry it", "in grams it would be 1.5 kg", ": l3")),
    "kg mm^2": (lambda: URDF.replace('ixx="0.03" iyy="0.03" izz="0.001"', 'ixx="3e4" iyy="3e4" izz="1e3"', 1),
                ("as of 4 kg spread over 87.3 m", "is it in kg mm^2?", ": l1")),
    "angles of origins": (lambda: URDF.replace('rpy="0 0 0"', 'rpy="0 0 90"', 1),
                          ("is it in degrees?", f'give "0 0 {math.pi / 2:.6g}"', ": j1")),
    "millimetres": (lambda: URDF.replace('xyz="0 0 0.4"', 'xyz="0 0 400"', 1), ("give m, 0.4", ": j1")),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_one_line_has_value_reason_and_remedy(case: str) -> None:
    urdf, parts = CASES[case]
    lines = said(urdf())
    assert len(lines) == 1
    for part in parts:
        assert part in lines[0]


def test_what_is_meant_is_not_suspicious() -> None:
    assert said(URDF) == []
    stated = without_inertial("l2").replace('<link name="l2">', '<link name="l2"><inertial><mass value="0"/><inertia '
                                            'ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial>')  # fmt: skip
    assert said(stated) == []
    assert said(URDF.replace(LIMIT, 'lower="-1000" upper="1000"')) == []
    assert said(URDF.replace(LIMIT, 'lower="-12.5664" upper="12.5664"')) == []  # two turns to each side


def test_a_link_without_mass_is_no_longer_listed_beside_the_base() -> None:
    report = tl.load_robot(without_inertial("l2")).report
    assert [f.names for f in report.assumed if "<inertial>" in f.what] == [("base",)]


@pytest.mark.parts
def test_a_link_between_joints_is_taken_as_massless_and_a_note(tmp_path: Path) -> None:
    text = re.sub('(<link name="l2">)<visual>.*?</visual>', r"\1", without_inertial("l2"))
    report = tl.load_robot(text).report
    assert said(text) == []
    assert [f.names for f in report.assumed if "<inertial>" in f.what] == [("l2",), ("base",)]
    (note,) = tl.lint(text).defects
    assert (note.rule, note.severity, note.name) == ("no-inertial", "note", "l2")
    assert "taken as massless" in note.cause
    path = tmp_path / "three.urdf"
    path.write_text(text)
    assert "taken as massless, as a link between joints" in str(tl.scene_of(path).report)


def test_a_heavy_payload_is_said_of_the_scene() -> None:
    robot = tl.load_robot(URDF)
    heavy = tl.Scene(robot, effects=[tl.effects.Payload("l3", 1500.0, com=(0.0, 0.0, 0.1))])
    assert [note for note in heavy.notes() if note.startswith("suspicious: the payload on 'l3' is a mass of 1500 kg")]
    assert not tl.Scene(robot, effects=[tl.effects.Payload("l3", 20.0)]).notes()


def test_the_command_and_the_scene_of_a_file_say_it_too(tmp_path: Path) -> None:
    path = tmp_path / "grams.urdf"
    path.write_text(CASES["grams"][0]())
    assert "1500 kg" in answer("inspect", str(path))["report"]["suspicious"][0]["what"]
    assert "suspicious: a mass of 1500 kg" in str(tl.scene_of(path).report)
