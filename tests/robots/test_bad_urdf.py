"""Every bad input ends in a RobotError that names the place, the value and the remedy; the process goes on."""

import math
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import twolink as tl
from tests.command import printed_by
from tests.refusals import refusal
from twolink.errors import RobotError
from twolink.robots import catalogue, xml

INERTIAL = """<inertial><origin xyz="0 0 -0.5"/><mass value="2"/>
<inertia ixx="0.2" iyy="0.2" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>"""
JOINT = """<joint name="hinge" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>"""
GOOD = f'<robot name="r"><link name="base"/><link name="arm">{INERTIAL}</link>{JOINT}</robot>'


def swapped(old: str, new: str) -> str:
    assert old in GOOD
    return GOOD.replace(old, new)


def link(name: str, inertial: str = INERTIAL) -> str:
    return f'<link name="{name}">{inertial}</link>'


def joint(name: str, parent: str, child: str, kind: str = "continuous") -> str:
    return f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/></joint>'


def robot(*parts: str) -> str:
    return f'<robot name="r">{"".join(parts)}</robot>'


BAD = {
    "not XML": ("<robot name='r'><link", ["not XML", ":1"]),
    "not XML, mismatched": ("<robot>\n<link name='a'>\n</robot>", ["not XML", "mismatched tag", ":3"]),
    "no robot": ("<model/>", ["<model>", "expected <robot>"]),
    "SDF": ("<sdf version='1.9'/>", ["it is SDF"]),
    "no links": ("<robot name='r'/>", ["no <link>"]),
    "link without name": (robot("<link/>"), ["<link> has no name"]),
    "two roots": (robot(link("a"), link("b")), ["2 root links", "'a', 'b'"]),
    "cycle, no root": (robot(link("a"), link("b"), joint("j", "a", "b"), joint("k", "b", "a")), ["cycle"]),
    "cycle beside a tree": (
        robot(link("r"), link("a"), link("b"), joint("j", "a", "b"), joint("k", "b", "a")),
        ["cycle", "'a'"],
    ),
    "two parents": (
        robot(link("a"), link("b"), link("c"), joint("j", "a", "c"), joint("k", "a", "b"), joint("l", "b", "c")),
        ["joint 'l'", "'c' is already the child of joint 'j'"],
    ),
    "missing parent": (swapped('parent link="base"', 'parent link="bse"'), ["'hinge'", "'bse'", "mean 'base'"]),
    "missing world": (swapped('parent link="base"', 'parent link="world"'), ['add <link name="world"/>']),
    "missing child": (swapped('child link="arm"', 'child link="leg"'), ["child link 'leg' does not exist"]),
    "parent is child": (swapped('child link="arm"', 'child link="base"'), ["parent and child are both 'base'"]),
    "duplicate link": (robot(link("a"), link("b"), link("b"), joint("j", "a", "b")), ["link 'b'", "2 times"]),
    "duplicate joint": (
        robot(link("a"), link("b"), link("c"), joint("j", "a", "b"), joint("j", "b", "c")),
        ["joint 'j'", "2 times"],
    ),
    "negative mass": (swapped('mass value="2"', 'mass value="-2"'), ["link 'arm'", "-2.0 kg is negative"]),
    "NaN mass": (swapped('mass value="2"', 'mass value="nan"'), ["link 'arm'", "nan is not finite"]),
    "infinite mass": (swapped('mass value="2"', 'mass value="inf"'), ["link 'arm'", "inf is not finite"]),
    "mass in words": (swapped('mass value="2"', 'mass value="two"'), ["'two' is not a number"]),
    "decimal comma": (swapped('mass value="2"', 'mass value="2,5"'), ["'2,5'", "a point, not a comma"]),
    "digit groups": (swapped('mass value="2"', 'mass value="1_000"'), ["'1_000' is not a number"]),
    "two masses": (swapped('mass value="2"', 'mass value="2 3"'), ["expected 1 number, got 2"]),
    "no mass value": (swapped('mass value="2"', "mass"), ["<mass> has no value"]),
    "no mass element": (swapped('<mass value="2"/>', ""), ["<inertial> has no <mass>"]),
    "no inertia element": (
        GOOD.replace('<inertia ixx="0.2" iyy="0.2" izz="0.1" ixy="0" ixz="0" iyz="0"/>', ""),
        ["<inertial> has no <inertia>; add <inertia ixx="]),
    "inertia without ixy": (swapped(' ixy="0"', ""), ["link 'arm'", "<inertia> has no ixy"]),
    "NaN inertia": (swapped('ixx="0.2"', 'ixx="nan"'), ["link 'arm'", "not finite"]),
    "inertia not positive": (swapped('izz="0.1"', 'izz="-0.1"'), ["link 'arm'", "positive semi-definite", "-0.1"]),
    "inertia off-diagonal": (swapped('ixy="0"', 'ixy="0.5"'), ["link 'arm'", "positive semi-definite"]),
    "triangle inequality": (
        swapped('izz="0.1"', 'izz="0.5"'), ["link 'arm'", "triangle inequality", "0.2, 0.2, 0.5"]),
    "inertia without mass": (
        swapped('mass value="2"', 'mass value="0"'), ["link 'arm'", "inertia without mass", "0 kg", "0.1, 0.2, 0.2"]),
    "massless leaf": (swapped('mass value="2"', 'mass value="0"').replace("0.2", "0").replace("0.1", "0"),
                      ["link 'arm'", "'hinge' cannot be accelerated", "no mass", "lock={'hinge': 0}"]),
    "no inertial leaf": (swapped(INERTIAL, ""), ["link 'arm'", "'hinge' cannot be accelerated"]),
    "point mass on the axis": (
        swapped('xyz="0 0 -0.5"', 'xyz="0 0 0"').replace("0.2", "0").replace("0.1", "0"),
        ["'hinge' cannot be accelerated", "no inertia about its axis"],
    ),
    "zero axis": (swapped('axis xyz="0 1 0"', 'axis xyz="0 0 0"'), ["joint 'hinge'", "has no direction"]),
    "short axis": (swapped('axis xyz="0 1 0"', 'axis xyz="0 1"'), ["joint 'hinge'", "expected 3 numbers, got 2"]),
    "axis without xyz": (swapped('axis xyz="0 1 0"', "axis"), ["<axis> has no xyz"]),
    "limits reversed": (swapped('lower="-1"', 'lower="3"'), ["joint 'hinge'", "3.0 is above upper limit 1.0"]),
    "limit NaN": (swapped('upper="1"', 'upper="nan"'), ["joint 'hinge'", "not finite"]),
    "no limit": (swapped('<limit lower="-1" upper="1" effort="1" velocity="1"/>', ""), ["needs <limit>", "continuous"]),
    "negative effort": (swapped('effort="1"', 'effort="-1"'), ["effort limit -1.0 is negative"]),
    "link named as the ground": (
        GOOD.replace('"arm"', '"universe"'), ["link 'universe'", "the ground is called 'universe'", "rename the link"]),
    "no joint type": (swapped('type="revolute"', ""), ["joint 'hinge'", "type '' is unknown"]),
    "joint type misspelt": (swapped('"revolute"', '"revolut"'), ["joint 'hinge'", "did you mean 'revolute'"]),
    "ball joint": (swapped('"revolute"', '"ball"'), ["type 'ball' is unknown"]),
    "damping in words": (
        swapped("</joint>", '<dynamics damping="high"/></joint>'), ["joint 'hinge'", "'high' is not a number"]),
    "mimic without joint": (swapped("</joint>", "<mimic/></joint>"), ["joint 'hinge'", "<mimic> has no joint"]),
    "planar normal": (swapped('"revolute"', '"planar"'), ["joint 'hinge'", "x-y plane", '<axis xyz="0 0 1"/>']),
    "other digits": (swapped('mass value="2"', 'mass value="\u0662"'), ["is not a number"]),
    "masses add up to infinity": (
        robot(link("a", INERTIAL.replace('"2"', '"1.7e308"')), link("b", INERTIAL.replace('"2"', '"1.7e308"')),
              joint("j", "a", "b")), ["masses add up"]),
    "entity": ('<!DOCTYPE robot [<!ENTITY a "x">]>' + GOOD, ["DOCTYPE"]),
    "billion laughs": (
        '<!DOCTYPE r [<!ENTITY a "' + "x" * 100 + '"><!ENTITY b "' + "&a;" * 99 + '">]><r>&b;</r>', ["DOCTYPE"]),
    "external entity": ('<!DOCTYPE robot SYSTEM "file:///etc/passwd">' + GOOD, ["DOCTYPE"]),
    "undefined entity": (swapped('name="r"', 'name="&x;"'), ["not XML", "undefined entity"]),
    "xacro element": (
        '<robot xmlns:xacro="http://ros.org/wiki/xacro"><xacro:property name="m" value="1"/></robot>',
        ["xacro", "twolink[xacro]"],
    ),
    "xacro expression": (swapped('mass value="2"', 'mass value="${2 * m}"'), ["xacro", "twolink[xacro]"]),
    "nested absurdly": ("<robot>" + "<a>" * 500 + "</a>" * 500 + "</robot>", ["nested"]),
    "many elements": ("<robot>" + "<a/>" * 400_001 + "</robot>", ["400000 elements"]),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_bad_urdfs_are_refused_with_place_and_reason(case: str) -> None:
    text, parts = BAD[case]
    with refusal(RobotError, *parts):
        tl.load_robot(text)


def test_the_urdf_that_the_bad_ones_are_made_from_loads() -> None:
    assert tl.load_robot(GOOD).joint_names == ("hinge",)


def chain(n: int, kind: str = "revolute") -> str:
    parts = [link("l0")]
    for i in range(1, n + 1):
        parts.append(link(f"l{i}") + JOINT.replace("hinge", f"j{i}").replace('"base"', f'"l{i - 1}"')
                     .replace('"arm"', f'"l{i}"').replace("revolute", kind))  # fmt: skip
    return robot(*parts)


@pytest.mark.some(1)
@pytest.mark.parametrize(("n", "kind"), [(301, "revolute"), (1_001, "fixed"), (5_001, "fixed"), (20_000, "revolute")])
def test_chains_too_long_are_refused_not_fatal(n: int, kind: str) -> None:
    with pytest.raises(RobotError, match="joints"):
        tl.load_robot(chain(n, kind))


@pytest.mark.slow
@pytest.mark.parametrize(("n", "kind", "nv"), [(300, "revolute", 300), (1_000, "fixed", 0)])
def test_the_longest_accepted_chains_load_on_a_small_stack(n: int, kind: str, nv: int, tmp_path: Path) -> None:
    """Pinocchio's reader recurses: on the caller's stack of 256 kB, 500 links end the process."""
    code = """
import sys, threading
import twolink as tl
text = open(sys.argv[1]).read()
loaded = []
threading.stack_size(256 * 1024)
thread = threading.Thread(target=lambda: loaded.append(tl.load_robot(text, unphysical="report").nv))
thread.start(); thread.join()
print(loaded)
"""
    path = tmp_path / "chain.urdf"
    path.write_text(chain(n, kind))
    assert printed_by(code, str(path)).strip() == f"[{nv}]"


def test_urdfs_with_too_many_bytes_are_refused(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for module in (catalogue, xml):
        monkeypatch.setattr(module, "MAX_BYTES", 100)
    with pytest.raises(RobotError, match="the limit is 100"):
        tl.load_robot(GOOD)
    (tmp_path / "big.urdf").write_text(GOOD)
    with pytest.raises(RobotError, match="the limit is 100"):
        tl.load_robot(tmp_path / "big.urdf")


@pytest.mark.parametrize(("source", "part"), [
    ("two_lnk", "did you mean 'two_link'"),
    ("/no/such.urdf", "No such file"),
    ("", "empty"),
    ("cassie", "SDF only"),
    (".", "no robot of this name"),
    ("/tmp", "directory"),
    ("x\0.urdf", "cannot be read"),
    ("a" * 5_000, "no robot of this name"),
    ("/dev/zero", "the limit is"),
])  # fmt: skip
def test_sources_that_name_no_robot(source: str, part: str) -> None:
    with pytest.raises(RobotError, match=part):
        tl.load_robot(source)


@pytest.mark.parametrize("source", [None, 3, b"<robot/>"])
def test_sources_of_a_wrong_type(source: object) -> None:
    with pytest.raises(RobotError, match="is not a robot"):
        tl.load_robot(source)


def test_binary_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "noise.urdf"
    path.write_bytes(np.random.default_rng(0).bytes(5_000))
    with pytest.raises(RobotError, match="not XML"):
        tl.load_robot(path)


@pytest.mark.parametrize(("options", "part"), [
    ({"root": "flying"}, "'flying' is unknown"),
    ({"gravity": (0, 0)}, "expected 3 finite numbers"),
    ({"gravity": (0, 0, math.nan)}, "expected 3 finite numbers"),
    ({"gravity": "down"}, "expected 3 finite numbers"),
    ({"lock": {"hing": 0.0}}, "did you mean 'hinge'"),
    ({"lock": {"hinge": math.inf}}, "expected 1 finite number"),
    ({"lock": {"hinge": "shut"}}, "expected 1 finite number"),
    ({"unphysical": "ignore"}, "'ignore' is unknown"),
    ({"lock": ["hinge"]}, "expected joints with their configurations"),
    ({"lock": {1: 0.0}}, "no moving joint 1"),
    ({"package_dirs": 5}, "expected folders"),
])  # fmt: skip
def test_bad_options_are_refused(options: dict[str, object], part: str) -> None:
    with pytest.raises(RobotError, match=part):
        tl.load_robot(GOOD, **options)


def test_mimic_of_a_missing_joint_is_reported_and_refused_with_mimic_true() -> None:
    text = swapped("</joint>", '<mimic joint="other"/></joint>')
    assert any("does not exist" in str(f) for f in tl.load_robot(text).report.ignored)
    with pytest.raises(RobotError, match="mimics 'other'"):
        tl.load_robot(text, mimic=True)


def test_unphysical_robots_load_with_report_and_are_reported() -> None:
    text = BAD["triangle inequality"][0]
    report = tl.load_robot(text, unphysical="report").report
    assert any("no real body has" in str(f) and "arm" in f.names for f in report.assumed)


def test_bad_input_from_many_threads_does_not_mix() -> None:
    def work(case: str) -> None:
        for _ in range(5):
            test_bad_urdfs_are_refused_with_place_and_reason(case)

    with ThreadPoolExecutor(24) as pool:
        list(pool.map(work, list(BAD)[:24]))
