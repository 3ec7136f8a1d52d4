"""lint: a sound robot has no defects, each seeded defect is found by its rule with its cause, and what public threads
reported is found in the numbers that they give.
"""

import json
import math
import os
import random
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

import twolink as tl
from tests.command import TOP, call
from twolink.errors import QueryError, RobotError, TwolinkError
from twolink.parts.lint.findings import SEVERITIES, rules
from twolink.parts.lint.lint import fix
from twolink.robots.catalogue import catalogue_entry
from twolink.robots.tree import other_side

# A box of a x b x c and m has m (b^2 + c^2) / 12 about its middle.
LINK = """
  <link name="{name}">
    <inertial>
      <origin xyz="0 0 0.15"/>
      <mass value="2"/>
      <inertia ixx="0.0154" iyy="0.0156" izz="0.0013" ixy="0.0001" ixz="0.0003" iyz="0.0002"/>
    </inertial>
    <visual><origin xyz="0 0 0.15"/><geometry><box size="0.06 0.06 0.3"/></geometry></visual>
    <collision><origin xyz="0 0 0.15"/><geometry><box size="0.06 0.06 0.3"/></geometry></collision>
  </link>
  <joint name="{name}_joint" type="revolute">
    <parent link="{parent}"/><child link="{name}"/>
    <origin xyz="0 0 0.3" rpy="0 0 0"/>
    <axis xyz="0 1 0"/>
    <limit lower="-2.5" upper="2.5" effort="80" velocity="3"/>
    <dynamics damping="0.1" friction="0.2"/>
  </joint>"""
BASE = '<robot name="arms">\n<link name="base"><visual><geometry><box size="0.3 0.3 0.1"/></geometry></visual></link>'
NAMES = ("left_upper", "left_lower", "right_upper", "right_lower")
SOUND = BASE + "".join(
    LINK.format(name=name, parent="base" if "upper" in name else f"{name[:-6]}_upper") for name in NAMES
) + "\n</robot>"  # fmt: skip
SIX = 'ixx="0.0154" iyy="0.0156" izz="0.0013" ixy="0.0001" ixz="0.0003" iyz="0.0002"'
STEINER = 2 * 0.15**2


def swap(old: str, new: str) -> Callable[[], str]:
    """The sound robot with the last place of a text, which is of right_lower, changed."""

    def changed() -> str:
        head, found, tail = SOUND.rpartition(old)
        assert found, old
        return head + new + tail

    return changed


def inertia(**changed: float) -> Callable[[], str]:
    six = dict(re.findall(r'(\w+)="([^"]*)"', SIX)) | {name: f"{value:.6g}" for name, value in changed.items()}
    return swap(SIX, " ".join(f'{name}="{value}"' for name, value in six.items()))


MIMIC = '<dynamics damping="0.1" friction="0.2"/>'
SEEDED: dict[str, tuple[Callable[[], str], str, str]] = {
    "lost decimal point": (inertia(izz=1.3), "impossible-inertia", 'izz="0.0013"'),
    "lost sign": (inertia(ixx=-0.0154), "impossible-inertia", "lost sign: ixx=0.0154"),
    "row-major six": (swap(SIX, 'ixx="0.0154" iyy="0.0001" izz="0.0003" ixy="0.0156" ixz="0.0002" iyz="0.0013"'),
                      "impossible-inertia", "row-major order"),
    "row-major nine": (swap(SIX, 'ixx="0.0154" ixy="0.0001" ixz="0.0003" iyy="0.0001" iyz="0.0156" izz="0.0002"'),
                       "impossible-inertia", "iyy repeats ixy, so iyy is 0.0156"),
    "parallel axis twice": (inertia(ixx=0.0154 - STEINER, iyy=0.0156 - STEINER), "impossible-inertia", "wrong point"),
    "triangle inequality": (inertia(izz=0.04), "impossible-inertia", ""),
    "about the link's origin": (inertia(ixx=0.0154 + STEINER, iyy=0.0156 + STEINER), "inertia-shape",
                                "about the link's origin"),
    "kg mm^2": (inertia(ixx=15400, iyy=15600, izz=1300, ixy=100, ixz=300, iyz=200), "inertia-shape", "kg mm^2"),
    "g mm^2 of a robot": (inertia(ixx=1.54e7, iyy=1.56e7, izz=1.3e6, ixy=1e5, ixz=3e5, iyz=2e5), "inertia-unit",
                          "kg mm^2"),
    "moments of 0": (inertia(**dict.fromkeys(("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), 0)), "zero-inertia", ""),
    "a template's moments": (inertia(ixx=1, iyy=1, izz=1, ixy=0, ixz=0, iyz=0), "placeholder-inertia", "template"),
    "mass in grams": (swap('<mass value="2"/>', '<mass value="2000"/>'), "mass-shape", "likely grams: give kg, 2"),
    "mass in grams of a robot": (swap('<mass value="2"/>', '<mass value="2000"/>'), "heavy", "give kg"),
    "missing moment": (swap('izz="0.0013" ', ""), "format", "add izz="),
    "inertia without mass": (swap('<mass value="2"/>', '<mass value="0"/>'), "impossible-inertia", "give its mass"),
    "mass of 0": (swap('<mass value="2"/>', '<mass value="0"/>'), "zero-mass", "give its mass"),
    "shapes in mm": (swap('<box size="0.06 0.06 0.3"/></geometry></collision>',
                          '<box size="60 60 300"/></geometry></collision>'), "mass-shape", "millimetres"),
    "centre of mass in mm": (swap('<origin xyz="0 0 0.15"/>\n      <mass', '<origin xyz="0 0 150"/>\n      <mass'),
                             "com-shape", "millimetres"),
    "one side differs": (swap('<mass value="2"/>', '<mass value="2.6"/>'), "mirrored-pair", ""),
    "one side's motor is weaker": (swap('effort="80"', 'effort="8"'), "mirrored-pair", ""),
    "limits in degrees": (swap('lower="-2.5" upper="2.5"', 'lower="-143" upper="143"'), "angle-unit", "degrees"),
    "origin in degrees": (swap('rpy="0 0 0"', 'rpy="0 0 90"'), "angle-unit", "degrees"),
    "origin in mm": (swap('xyz="0 0 0.3"', 'xyz="0 0 300"'), "length-unit", "millimetres"),
    "axis not of length 1": (swap('<axis xyz="0 1 0"/>', '<axis xyz="0 1 1"/>'), "axis-not-unit", '0.707106781187"'),
    "effort 0": (swap('effort="80"', 'effort="0"'), "effort-limit", "left out"),
    "velocity 0": (swap('velocity="3"', 'velocity="0"'), "velocity-limit", "left out"),
    "velocity in degrees": (swap('velocity="3"', 'velocity="172"'), "velocity-limit", "give 3.002 rad/s"),
    "limits that do not open": (swap('lower="-2.5" upper="2.5"', 'lower="1" upper="1"'), "unreachable-limits", ""),
    "limits reversed": (swap('lower="-2.5" upper="2.5"', 'lower="2.5" upper="-2.5"'), "format", "swap them"),
    "negative damping": (swap('damping="0.1"', 'damping="-0.1"'), "negative-damping", "sign: 0.1"),
    "mimic of itself": (swap(MIMIC, MIMIC + '<mimic joint="right_lower_joint"/>'), "mimic-target", ""),
    "mimic out of reach": (swap(MIMIC, MIMIC + '<mimic joint="left_lower_joint" multiplier="2"/>'), "mimic-range", ""),
    "no inertial": (lambda: re.sub(r"(?s)<inertial>(?!.*<inertial>).*?</inertial>", "", SOUND), "no-inertial", "give"),
    "comma for a point": (swap('value="2"', 'value="2,0"'), "number", "point, not a comma"),
    "typing error": (swap('<mass value="2"/>', '<mass valeu="2" value="2"/>'), "unknown-name", "did you mean 'value'?"),
    "link that is not there": (swap('<child link="right_lower"/>', '<child link="right_lover"/>'), "tree", ""),
    "negative mass": (swap('<mass value="2"/>', '<mass value="-2"/>'), "format", "0 or more"),
    "not XML": (lambda: SOUND.replace("</robot>", ""), "xml", ""),
    "scale of a mesh": (swap('<box size="0.06 0.06 0.3"/></geometry></collision>',
                             '<mesh filename="a.stl" scale="0 1 1"/></geometry></collision>'), "mesh-scale",
                        "positive"),
}  # fmt: skip


def test_a_sound_robot_has_no_defects() -> None:
    found = tl.lint(SOUND)
    assert found.defects == (), str(found)
    assert str(found) == "0 errors, 0 warnings, 0 notes in 1 file"


@pytest.mark.parametrize("case", SEEDED)
def test_a_seeded_defect_is_found_by_its_rule_with_its_cause(case: str) -> None:
    urdf, rule, cause = SEEDED[case]
    found = tl.lint(urdf())
    hits = [one for one in found.defects if one.rule == rule]
    assert hits, str(found)
    assert any(cause in one.cause for one in hits), str(found)
    if rule not in ("xml", "mesh-scale"):
        assert all(one.line > 0 for one in hits)
        assert {one.name for one in hits} <= {"right_lower", "right_lower_joint", "left_lower", "left_lower_joint"}


def test_an_open_mesh_has_no_density(tmp_path: Path) -> None:
    """A box of 0.017 kg/m^3; without a side its signed volume is that of something else."""
    box = trimesh.creation.box((4, 5, 6))
    box.apply_translation([1.0, 2.0, 3.0])
    (tmp_path / "robot.urdf").write_text("""<robot name="r"><link name="a"><inertial><origin xyz="1 2 3"/>
        <mass value="2"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial><collision><geometry>
        <mesh filename="box.stl"/></geometry></collision></link></robot>""")
    for faces, count in ((box.faces, 1), (box.faces[2:], 0)):
        trimesh.Trimesh(box.vertices, faces, process=False).export(tmp_path / "box.stl")
        found = [one for one in tl.lint(tmp_path / "robot.urdf").defects if one.rule == "mass-shape"]
        assert len(found) == count


def test_all_defects_are_found_at_once() -> None:
    urdf = SOUND.replace('value="2"', 'value="2,0"', 1).replace('effort="80"', 'effort="0"').replace(
        'lower="-2.5" upper="2.5"', 'lower="2.5" upper="-2.5"', 1)  # fmt: skip
    urdf = urdf.replace("<axis xyz", '<axis rpy="0" xyz', 2)
    rules_found = [one.rule for one in tl.lint(urdf).defects]
    assert {rule: rules_found.count(rule) for rule in set(rules_found)} == {
        "number": 1, "effort-limit": 3, "format": 1, "unknown-name": 2}  # fmt: skip


def test_a_robot_without_inertials_has_one_warning_of_its_masses() -> None:
    text = re.sub(r"(?s)<inertial>.*?</inertial>", "", SOUND)
    (one,) = tl.lint(text).defects
    assert (one.rule, one.severity) == ("weightless", "warning")
    assert tl.load_robot(text, purpose="kinematics").nv == 4
    beside = tl.lint(text.replace("<dynamics", "<dynamiks", 1)).defects
    assert {(each.rule, each.severity) for each in beside} == {("weightless", "warning"), ("unknown-name", "error")}


@pytest.mark.parametrize(("left", "right"), [
    ("left_hip", "right_hip"), ("panda_leftfinger", "panda_rightfinger"), ("LShoulderYaw", "RShoulderYaw"),
    ("armLeft", "armRight"), ("FL_hip", "FR_hip"), ("lever", ""), ("right_hip", ""),
    ("frontleft_hip", "frontright_hip"), ("Leftarm", "Rightarm"), ("ARMLEFT", "ARMRIGHT"),
])  # fmt: skip
def test_a_left_name_has_a_right_one(left: str, right: str) -> None:
    assert other_side(left) == right


def test_a_circle_of_mimic_joints_is_an_error() -> None:
    head, joint, tail = SOUND.partition('<joint name="left_lower_joint"')
    one = head.replace(MIMIC, MIMIC + '<mimic joint="left_lower_joint"/>', 1)
    two = tail.replace(MIMIC, MIMIC + '<mimic joint="left_upper_joint"/>', 1)
    assert {one.rule for one in tl.lint(one + joint + two).errors} == {"mimic-loop"}


def named(six: str, mass: float, *, name: str = "moved", com: str = "0 0 0", limit: str = "", more: str = "") -> str:
    """A URDF with one moving link, of a thread's numbers."""
    return f"""<robot name="r"><link name="base"/><link name="{name}"><inertial><origin xyz="{com}"/>
    <mass value="{mass}"/><inertia {six}/></inertial>{more}</link>
    <joint name="j" type="revolute"><parent link="base"/><child link="{name}"/><axis xyz="0 0 1"/>
    <limit {limit or 'lower="-1" upper="1" effort="10" velocity="1"'}/></joint></robot>"""


def zeros(name: str, moments: str) -> str:
    return f"""<link name="{name}"><inertial><mass value="2.175"/><inertia {moments} ixy="0" ixz="0" iyz="0"/>
    </inertial></link><joint name="{name}_j" type="fixed"><parent link="base"/><child link="{name}"/></joint>"""


BOX = '<collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision>'
GALBOT = ('ixx="7.798716588e-05" ixy="5.1716641e-06" ixz="2.425498752e-05" iyy="8.701457658e-05" iyz="1.249373671e-05" '
          'izz="2.604813454e-05"')  # fmt: skip
FINE = 'ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"'
THREADS: dict[str, tuple[str, str, str]] = {
    "RealManRobot/rm_models#6": (
        named('ixx="2661.9E-6" ixy="-31.029E-6" ixz="9.34E-6" iyy="2302.5E-6" iyz="151.466E-6" izz="1676359E-6"',
              1.559),
        "impossible-inertia", 'izz="0.00167636"'),
    "GalaxyGeneralRobotics/galbot_s1_description#5": (named(GALBOT, 0.07548248), "impossible-inertia", ""),
    "GalaxyGeneralRobotics/galbot_s1_description#5, 2": (
        named(FINE, 1.0).replace('<link name="base"/>', f"""<link name="base"><inertial><mass value="0"/>
        <inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial>{BOX}</link>"""), "zero-mass", ""),
    "fiveages-sim/robot_descriptions#29": (
        named('ixx="1.6616493e+4" ixy="-2.2400581e+3" ixz="0.0" iyy="-2.2400581e+3" iyz="1.6616324e+4" izz="0.0"',
              51.3211),
        "impossible-inertia", "row-major"),
    "robotology/icub-models#269": (
        '<robot name="r"><link name="base"/>' + zeros("r_upper_leg", 'ixx="4e-18" iyy="4e-18" izz="4e-18"')
        + zeros("l_upper_leg", 'ixx="0.0076" iyy="0.0075" izz="0.003"') + "</robot>", "mirrored-pair", "are missing"),
    "JAKARobotics/jaka_ros2#15": (
        named('ixx="0.014" ixy="0.000716" ixz="0" iyy="2.9544" iyz="0" izz="2.9595"', 7.293, com="0.0215 0 -0.135",
              more='<collision><origin xyz="0 0 -0.15"/><geometry><box size="0.1 0.1 0.5"/></geometry></collision>'),
        "inertia-shape", ""),
    "compas-dev/compas_fab#486": (
        named('ixx="-4.98" ixy="-0.0" ixz="2.7" iyy="-5.952" iyz="-0.0" izz="0.828"', 120.0, com="0.18 0 0.5"),
        "impossible-inertia", ""),
    "Gepetto/example-robot-data#130": (
        named('ixx="0.000115" ixy="0.000052" ixz="0.000025" iyy="0.000153" iyz="0.000034" izz="0.00019"', 0.14),
        "impossible-inertia", ""),
    "Chestnut-Robotics/aero-hand-open#53": (
        named(FINE, 1.0, limit='lower="0" upper="1.7453" effort="0" velocity="0"'), "effort-limit", "left out"),
    "osrf/drcsim#287": (
        named(FINE, 1.0, limit='effort="11" lower="-1.57" upper="1.57" velocity="-1"'), "format", "magnitude"),
    "turtlebot/turtlebot_arm#20": (
        named('ixx="1.0" iyy="1.0" izz="1.0" ixy="0" ixz="0" iyz="0"', 0.1, more=BOX), "inertia-shape", ""),
    "google-deepmind/mujoco#375": (
        named('ixx="1.486e-06" ixy="0" ixz="0" iyy="2e-07" iyz="0" izz="8.31e-07"', 0.03), "impossible-inertia", ""),
    "dfki-ric/phobos#37": (
        named(FINE, 1.0, limit='lower="0" upper="90" effort="1" velocity="1"'), "angle-unit", 'upper="1.5708"'),
    "fetchrobotics/fetch_ros#14": (named(FINE + ' iyx="0" izx="0" izy="0"', 1.0), "unknown-name", ""),
}  # fmt: skip
"""By issue on GitHub: the numbers that it gives, the rule, the cause that its reporter or an answer names."""


@pytest.mark.parametrize("thread", THREADS)
def test_what_public_threads_report_is_found(thread: str) -> None:
    urdf, rule, cause = THREADS[thread]
    found = tl.lint(urdf)
    assert any(one.rule == rule and cause in one.cause for one in found.defects), str(found)


def refused(urdf: str) -> bool:
    try:
        tl.load_robot(urdf)
    except RobotError:
        return True
    return False


def test_an_error_is_what_loading_refuses() -> None:
    texts = [*(urdf() for urdf, *_ in SEEDED.values()), *(urdf for urdf, *_ in THREADS.values()), SOUND]
    verdicts = {urdf: (refused(urdf), bool(tl.lint(urdf).errors)) for urdf in texts}
    assert {loading for loading, _ in verdicts.values()} == {True, False}
    assert [urdf for urdf, (loading, error) in verdicts.items() if loading != error] == []


VALUES = ("", "nan", "inf", "1e9", "-1", "0", "abc", "1 2", "0 0 0", "1e9 0 1", "left_upper", "fixed", "floating")


def mutated(rng: random.Random) -> str:
    """The sound robot with one to three values, names of attributes or elements changed, repeated or left out."""
    text = SOUND
    for _ in range(rng.randint(1, 3)):
        value, element = (rng.choice(list(re.finditer(p, text))) for p in (r'(\w+)="([^"]*)"', r"<[^<>]*/>"))
        text = rng.choice([
            text[: value.start(2)] + rng.choice(VALUES) + text[value.end(2) :],
            text[: value.start(1)] + rng.choice(["name", "xyz", "foo"]) + text[value.end(1) :],
            text[: element.start()] + text[element.end() :],
            text[: element.end()] + element[0] + text[element.end() :],
        ])  # fmt: skip
    return text


@pytest.mark.some(5)
@pytest.mark.parametrize("seed", range(30))
def test_whatever_stands_in_a_file_lint_answers_and_agrees_with_loading(seed: int) -> None:
    rng = random.Random(seed)
    for text in [mutated(rng) for _ in range(10)]:
        assert bool(tl.lint(text).errors) == refused(text), text


@pytest.mark.slow
def test_false_alarms_are_rare_and_the_load_report_agrees() -> None:
    alarms, names = [], [row["name"] for row in tl.robots()]
    for row in tl.robots():
        found = tl.lint(row["name"])
        assert bool(found.errors) == (row["refused"] is not None), str(found)
        alarms += [row["name"]] if found.errors and row["refused"] is None else []
    assert len(alarms) <= len(names) / 20


@pytest.mark.parametrize("name", ["ur5", "panda"])
def test_suspicions_of_the_load_report_are_findings(name: str, tmp_path: Path) -> None:
    text = catalogue_entry(name).path.read_text().replace('rpy="0 0 0"', 'rpy="0 0 90"')
    path = tmp_path / "changed.urdf"
    path.write_text(text)
    said = {re.split(": |; ", finding.what)[0] for finding in tl.load_robot(path).report.suspicious}
    assert said <= {one.value for one in tl.lint(path).defects}


def test_findings_become_json_sarif_and_annotations(tmp_path: Path) -> None:
    path = tmp_path / "arm, left.urdf"
    path.write_text(SEEDED["effort 0"][0]())
    found = tl.lint(path)
    (one,) = (each for each in found.defects if each.rule == "effort-limit")
    assert path.read_text().splitlines()[one.line - 1].strip().startswith("<limit")
    saved = json.loads(found.save(tmp_path / "f.json").read_text())
    assert [each["rule"] for each in saved["defects"]] == [each.rule for each in found.defects]
    log = json.loads(found.save(tmp_path / "f.sarif").read_text())
    assert log["version"] == "2.1.0"
    (run,) = log["runs"]
    described = {rule["id"] for rule in run["tool"]["driver"]["rules"]}
    for result, each in zip(run["results"], found.defects, strict=True):
        place = result["locations"][0]["physicalLocation"]
        assert (result["ruleId"], result["level"]) == (each.rule, each.severity)
        assert place["region"]["startLine"] == each.line
        assert result["ruleId"] in described
    line = found.to_github().splitlines()[[each.rule for each in found.defects].index("effort-limit")]
    assert line.startswith("::warning file=")
    assert f"arm%2C left.urdf,line={one.line},title=effort-limit::" in line
    with pytest.raises(TwolinkError, match=r"\.sarif"):
        found.save(tmp_path / "f.txt")


def test_a_baseline_leaves_what_is_new(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(SEEDED["effort 0"][0]())
    known = tl.lint(path).save(tmp_path / "known.json")
    assert tl.lint(path, baseline=known).defects == ()
    path.write_text("\n\n" + SEEDED["effort 0"][0]().replace('velocity="3"', 'velocity="0"', 1))
    assert {one.rule for one in tl.lint(path, baseline=known).defects} == {"velocity-limit", "mirrored-pair"}
    (tmp_path / "none.json").write_text("[]")
    with pytest.raises(QueryError, match=r"none\.json holds no findings"):
        tl.lint(path, baseline=tmp_path / "none.json")


def test_only_what_is_certain_is_written(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    text = SEEDED["axis not of length 1"][0]().replace('effort="80"', 'effort="0"')
    text = text.replace('<axis xyz="0 1 1"/>', '<origin xyz="0 1 1"/> <axis xyz="0 1 1"/>').replace(
        '<origin xyz="0 0 0.3" rpy="0 0 0"/>\n    <origin', "<origin")  # fmt: skip
    path.write_text(text)
    before = tl.lint(path)
    assert fix(before) == (Path(before.files[0]),)
    changed = [(a, b) for a, b in zip(text.splitlines(), path.read_text().splitlines(), strict=True) if a != b]
    assert [a.strip() for a, _ in changed] == ['<origin xyz="0 1 1"/> <axis xyz="0 1 1"/>']
    origin, axis = (np.array(xyz.split(), dtype=float) for xyz in re.findall(r'xyz="([^"]*)"', changed[0][1]))
    np.testing.assert_array_equal(origin, [0, 1, 1])
    np.testing.assert_allclose(axis, [0, math.sqrt(0.5), math.sqrt(0.5)], atol=1e-11)
    after = tl.lint(path)
    assert [one.rule for one in before.defects if one.rule not in {each.rule for each in after.defects}] == [
        "axis-not-unit"]  # fmt: skip
    assert fix(after) == ()


@pytest.mark.parametrize("encoding", ["utf-8", "iso-8859-1"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_a_fix_keeps_the_encoding_and_the_ends_of_lines(tmp_path: Path, encoding: str, end: str) -> None:
    path, axis = tmp_path / "arm.urdf", '<axis xyz="0 0 2"/>'
    head = f'<?xml version="1.0" encoding="{encoding}"?>\n<!-- Gelenk für Ellbogen, Å -->\n'
    text = re.sub(r"^<\?xml.*\n", "", SEEDED["axis not of length 1"][0]()).replace('<axis xyz="0 1 1"/>', axis)
    data = (head + text).replace("\n", end).encode(encoding)
    path.write_bytes(data)
    assert len(fix(tl.lint(path))) == 1
    assert path.read_bytes() == data.replace(axis.encode(), b'<axis xyz="0 0 1"/>')


def test_a_fix_leaves_alone_what_a_xacro_computes(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf.xacro"
    path.write_text(SEEDED["axis not of length 1"][0]().replace('<axis xyz="0 1 1"/>', '<axis xyz="0 ${1} ${1}"/>'))
    assert "axis-not-unit" in {one.rule for one in tl.lint(path).defects}
    assert fix(tl.lint(path)) == ()


def test_the_command_has_formats_and_exit_codes(tmp_path: Path) -> None:
    files = {case: tmp_path / f"{k}.urdf" for k, case in enumerate(SEEDED)}
    for case, file in files.items():
        file.write_text(SEEDED[case][0]())
    odd, bad = str(files["effort 0"]), str(files["not XML"])
    clean, *others = call("lint", "two_link"), call("lint", odd), call("lint", bad)
    assert [done.returncode for done in (clean, *others)] == [0, 0, 1]
    assert others[1].stdout.startswith("1 error, 0 warnings, ")
    assert clean.stdout == "0 errors, 0 warnings, 0 notes in 1 file\n"
    assert call("lint", odd, "--fail-on", "warning").returncode == 1
    both = call("lint", odd, bad, "--format", "json", "--out", str(tmp_path / "k.json"))
    assert len(json.loads(both.stdout)["files"]) == 2
    again = call("lint", odd, bad, "--baseline", str(tmp_path / "k.json"))
    assert (again.returncode, again.stdout) == (0, "0 errors, 0 warnings, 0 notes in 2 files\n")
    for arguments in ([str(tmp_path / "none.urdf")], ["two_link", "--format", "xml"], []):
        assert call("lint", *arguments).returncode == 2
    mended = call("lint", "--fix", str(files["axis not of length 1"]))
    assert "corrected" in mended.stderr
    assert "axis-not-unit" not in mended.stdout


def test_the_action_and_the_hook_run_the_command(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(SEEDED["lost decimal point"][0]())
    (line,) = re.findall(r"run: (python -m twolink .*)", (TOP / ".github/actions/lint/action.yml").read_text("utf-8"))
    given = {**os.environ, "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}", "PYTHONPATH": str(TOP)}
    given |= {"FILES": "arm.urdf two_link", "ARGUMENTS": "--fail-on error"}
    done = subprocess.run(["bash", "-c", line], cwd=tmp_path, env=given, capture_output=True, text=True)
    assert done.returncode == 1, done.stderr
    assert "::error file=arm.urdf,line=" in done.stdout
    hook = (TOP / ".pre-commit-hooks.yaml").read_text("utf-8")
    assert "entry: twolink lint\n" in hook
    assert re.search(re.findall(r"files: (.*)", hook)[0], "urdf/arm.urdf")


MJCF = """<mujoco><compiler angle="{unit}"/><worldbody><body name="a"><geom size="0.1"/>
<joint name="j1" range="-1.5 1.5"/>
<body name="b"><geom size="0.1"/><joint name="j2" range="0 {range}"/><body name="c"><geom size="0.1"/>
<joint name="j3" range="-1 1" damping="1"/></body></body></body></worldbody></mujoco>"""


def test_ranges_of_an_mjcf_in_the_other_unit_are_found() -> None:
    assert [one.rule for one in tl.lint(MJCF.format(unit="radian", range=2)).defects] == []
    narrow = [one for one in tl.lint(MJCF.format(unit="degree", range=2)).defects if one.rule == "range-unit"]
    assert [(one.name, one.line) for one in narrow] == [("j1", 2), ("j2", 3), ("j3", 4)]
    assert all('angle="radian"' in one.cause for one in narrow)
    wide = [one for one in tl.lint(MJCF.format(unit="radian", range=90)).defects if one.rule == "range-unit"]
    assert [(one.name, "degree" in one.cause) for one in wide] == [("j2", True)]


def test_a_file_that_an_mjcf_lacks_is_named_with_its_line(tmp_path: Path) -> None:
    path = tmp_path / "a.xml"
    path.write_text('<mujoco>\n<asset>\n<mesh name="m" file="parts/m.obj"/></asset><worldbody><body><freejoint/>'
                    '<geom type="mesh" mesh="m"/></body></worldbody></mujoco>')  # fmt: skip
    (one,) = tl.lint(path).defects
    assert (one.rule, one.severity, one.line) == ("mesh-missing", "error", 3)
    assert "m.obj" in one.value


def test_all_inertias_of_an_mjcf_are_looked_at_where_mujoco_stops_at_the_first() -> None:
    body = '<body name="{}"><joint name="j{}"/><inertial pos="0 0 0" mass="2" {}/></body>'
    wrong = 'fullinertia="0.0154 0.0156 1.3 0.0001 0.0003 0.0002"', 'diaginertia="0.01 0.01 0.03"'
    text = "\n".join(body.format(k, k, inertia) for k, inertia in enumerate((*wrong, 'diaginertia="0.01 0.01 0.01"')))
    found = tl.lint(f"<mujoco><worldbody>\n{text}</worldbody></mujoco>")
    assert [(one.rule, one.line, one.name) for one in found.errors] == [
        ("refused", 0, ""), ("impossible-inertia", 2, "0"), ("impossible-inertia", 3, "1")]  # fmt: skip
    assert "izz=" in found.errors[1].cause


def test_a_xacro_is_expanded_and_lines_are_found_by_name(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf.xacro"
    head, _, tail = swap('effort="80"', 'effort="${motor}"')().partition('<robot name="arms">')
    prefixed = tail.replace('"right_lower_joint"', '"${side}_lower_joint"')
    path.write_text(head + '<robot name="arms" xmlns:xacro="http://www.ros.org/wiki/xacro">'
                    '<xacro:arg name="motor" default="0"/><xacro:property name="side" value="right"/>'
                    '<xacro:property name="motor" value="$(arg motor)"/>' + prefixed)  # fmt: skip
    (one,) = (each for each in tl.lint(path).defects if each.rule == "effort-limit")
    assert "${side}_lower_joint" in path.read_text().splitlines()[one.line - 1]
    assert not tl.lint(path, xacro_arguments={"motor": 80}).defects
    macros = tmp_path / "macros.xacro"
    macros.write_text('<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:property name="a" value="1"/></robot>')
    assert [(each.rule, each.severity) for each in tl.lint(macros).defects] == [("tree", "note")]


def test_an_srdf_is_compared_with_its_urdf(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(SOUND)
    (tmp_path / "arm.srdf").write_text("""<robot name="arms">
<disable_collisions link1="base" link2="left_upper"/>
<disable_collisions link1="left_upper" link2="base"/>
<disable_collisions link1="base" link2="tool"/>
<group_state name="home" group="all"><joint name="left_upper_joint" value="0,5"/></group_state></robot>""")
    assert [(one.line, one.name) for one in tl.lint(tmp_path / "arm.srdf").defects] == [
        (3, "left_upper"), (4, "tool"), (5, "left_upper_joint")]  # fmt: skip


def test_the_page_has_the_rules_as_they_are_declared() -> None:
    page = (TOP / "docs" / "how" / "lint.md").read_text("utf-8")
    pattern = r'^\| <a id="([a-z-]+)"></a>`([a-z-]+)` \| (\w+) \| (.*?) \| (.*?) \|$'
    rows = re.findall(pattern, page, re.MULTILINE)
    assert [(name, rule.severity, rule.expects, rule.meaning) for name, rule in rules().items()] == [
        (name, severity, expects, meaning) for name, _, severity, expects, meaning in rows]  # fmt: skip
    assert all(anchor == name for anchor, name, *_ in rows)
    assert {rule.severity for rule in rules().values()} == set(SEVERITIES)


def test_every_rule_is_used() -> None:
    texts = "".join(path.read_text("utf-8") for path in (TOP / "twolink").rglob("*.py"))
    unused = [name for name in rules() if f'"{name}"' not in texts]
    assert unused == ["effort-limit", "velocity-limit"]  # whose names are made of the attribute
