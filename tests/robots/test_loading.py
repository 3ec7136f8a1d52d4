"""Loading: names, paths, text; the report; locale; comparison with yourdfpy; drawing and locking."""

import dataclasses
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import twolink as tl
from tests.urdf_text import joint, link, robot_of
from twolink.robots import catalogue_names
from twolink.robots.catalogue import catalogue_entry, examples_share
from twolink.robots.checks import compare

TOP = Path(__file__).parents[2]
REFUSED = {
    # name -> why it is right to refuse it
    "romeo": "no mass",  # its fingers have no <inertial>
    "romeo_laas_small": "positive semi-definite",  # body: a principal moment of -0.02 kg m^2
    "romeo_small": "triangle inequality",  # right shoulder: 0.00066, 0.00068, 0.0066
}


@pytest.fixture(scope="module")
def everything() -> dict[str, tl.Robot | tl.errors.RobotError]:
    loaded: dict[str, tl.Robot | tl.errors.RobotError] = {}
    for name in catalogue_names():
        try:
            loaded[name] = tl.load_robot(name, root=catalogue_entry(name).usual_root)
        except tl.errors.RobotError as error:
            loaded[name] = error
    return loaded


def test_every_file_of_example_robot_data_has_a_name() -> None:
    share = examples_share()
    files = set((share / "example-robot-data" / "robots").rglob("*.urdf"))
    named = {catalogue_entry(name).path for name in catalogue_names()}
    unnamed = {p.name for p in files - named}
    # a stub without links, drawings of a model that is in, and a corrected copy that nobody's loader named
    assert unnamed == {"ur3.urdf", "iris.urdf", "talos_reduced_corrected.urdf"}


def test_all_robots_load_with_a_report_or_are_refused_for_a_known_reason(everything: dict[str, object]) -> None:
    assert len(everything) >= 64
    refused = {name: str(r) for name, r in everything.items() if isinstance(r, Exception)}
    assert refused.keys() == REFUSED.keys()
    for name, reason in REFUSED.items():
        assert reason in refused[name]
    for name, robot in everything.items():
        if isinstance(robot, tl.Robot):
            assert robot.report.read, name
            assert robot.report.assumed, name


def test_no_robot_of_the_catalogue_is_suspicious(everything: dict[str, tl.Robot | tl.errors.RobotError]) -> None:
    robots = {name: robot for name, robot in everything.items() if isinstance(robot, tl.Robot)}
    assert len(robots) > 80
    assert {name: robot.report.suspicious for name, robot in robots.items() if robot.report.suspicious} == {}


def test_refused_robots_load_with_the_remedy_their_error_names() -> None:
    with pytest.raises(tl.errors.RobotError) as caught:
        tl.load_robot("romeo")
    lock = eval(caught.value.remedy.split("lock=")[1])
    assert tl.load_robot("romeo", lock=lock).nv == tl.load_robot("romeo", lock=lock).model.nv > 20
    assert tl.load_robot("romeo_small", unphysical="report").nv > 20


@pytest.mark.parametrize("kind", ["revolute", "continuous", "prismatic", "spherical", "planar", "floating"])
def test_what_holds_a_massless_link_is_taken(kind: str) -> None:
    with pytest.raises(tl.errors.RobotError, match="lock=") as caught:
        tl.load_robot(text := robot_of('<link name="a"/>', joint("j", kind, "ground", "a")))
    assert tl.load_robot(text, lock=eval(caught.value.remedy.split("lock=")[1])).nv == 0
    with pytest.raises(tl.errors.RobotError, match=r'or load it with root="fixed"$'):
        tl.load_robot(text := robot_of(link("a"), joint("j", kind, "ground", "a")), root="free")
    assert tl.load_robot(text, root="fixed").nv > 0


@pytest.mark.parametrize("name", ["ur5", "panda", "talos", "kinova", "pr2", "tiago_pro", "two_link", "arm"])
def test_yourdfpy_reads_the_same_robot(name: str) -> None:
    second = compare(tl.load_robot(name))
    assert second["frames"] < 1e-12
    assert second["mass"] < 1e-9


@pytest.mark.parametrize(("was", "other", "key", "size"), [
    ('forearm"/><origin xyz="1.0', 'forearm"/><origin xyz="1.1', "frames", 0.1),
    ('mass value="3.0', 'mass value="4.0', "mass", 1.0),
])  # fmt: skip
def test_what_yourdfpy_reads_otherwise_differs(was: str, other: str, key: str, size: float) -> None:
    """An elbow 0.1 m farther out, an upper arm of 1 kg more, in the text that the second reader gets."""
    robot = tl.load_robot("two_link")
    assert was in robot.visuals.text
    robot.visuals = dataclasses.replace(robot.visuals, text=robot.visuals.text.replace(was, other))
    second = compare(robot)
    assert not second["agree"]
    assert second[key] == pytest.approx(size, rel=0.1)


@pytest.mark.parametrize("more", ['armature="0.5"', 'armature="0.5" mu_viscous="1"', 'armature="0.5" friction="0.2"'])
def test_dynamics_without_damping_is_read(more: str) -> None:
    """M = I + m r^2 + armature, and the shapes are read too."""
    shape = '<collision><geometry><sphere radius="0.1"/></geometry></collision>'
    body = link("a", 2.0, 0.3, "0.5 0 0", more=shape)
    robot = tl.load_robot(robot_of(body, joint("j", "revolute", "ground", "a", more=f"<dynamics {more}/>")))
    assert robot.mass_matrix([0.3])[0, 0] == pytest.approx(0.3 + 2.0 * 0.25 + 0.5, rel=1e-14)
    assert len(robot.solids) == 1
    assert compare(robot)["agree"]


def test_limits_that_are_equal_are_none_and_the_reports_say_so() -> None:
    """The joint swings past them; one that lacks a limit of its two has 0 there."""
    text = robot_of(link("a", at="0.5 0 0"), joint("j", "revolute", "ground", "a", "0 1 0", lower=0.5, upper=0.5))
    equal, half = tl.load_robot(text), tl.load_robot(text.replace('lower="0.5" ', ""))
    scene = tl.scene_of(equal)
    assert tl.simulate(scene).q.max() > 1.0
    assert half.joints[0].lower + half.joints[0].upper == (0.0, 0.5)
    for report, said in ((equal.report, "equal"), (scene.report, "equal"), (half.report, "without lower or upper")):
        (finding,) = (one for one in report.findings if one.names == ("j",) and "limits" in one.what and
                      one.kind == "assumed")  # fmt: skip
        assert said in finding.what


def test_name_path_and_text_give_the_same_robot() -> None:
    path = TOP / "urdf" / "two_link.urdf"
    models = [tl.load_robot(s).model for s in ("two_link", path, str(path), path.read_text())]
    assert all(m == models[0] for m in models)


def test_report_names_what_is_ignored_repaired_and_assumed() -> None:
    text = """<robot name="r"><link name="base"/>
      <link name="a"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
        <visual><geometry><mesh filename="package://nowhere/a.stl"/></geometry></visual>
        <collision><geometry><sphere radius="1"/></geometry></collision></link>
      <link name="b"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
      </link>
      <link name="c"/>
      <joint name="j" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 0 2"/>
        <limit effort="1" velocity="1"/><dynamics damping="0.5" friction="0.2"/><safety_controller k_velocity="1"/>
      </joint>
      <joint name="k" type="continuous"><parent link="a"/><child link="b"/><mimic joint="j"/></joint>
      <joint name="f" type="fixed"><parent link="b"/><child link="c"/></joint>
      <transmission name="t"/><gazebo/></robot>"""
    report = tl.load_robot(text).report
    said = {
        kind: " | ".join(str(f) for f in getattr(report, kind)) for kind in ("read", "ignored", "repaired", "assumed")
    }
    assert "4 links of 2 kg, 1 revolute, 1 continuous, 1 fixed" in said["read"]
    for part in ("joint damping (", "joint friction (", "mimic", "collision", "transmissions", "<gazebo>",
                 "safety controllers", "package://nowhere/a.stl", "limits"):  # fmt: skip
        assert part in said["ignored"], part
    assert "normalised: j" in said["repaired"]
    for part in ("merged into the body", "without <inertial>", "turn or slide along x: k", "taken as no limits: j",
                 "fixed to the world", "gravity (0, 0, -9.81)"):  # fmt: skip
        assert part in said["assumed"], part
    assert said["read"] in str(report)
    assert report.to_dict()["source"] == "URDF text"


@pytest.mark.parametrize(("kind", "limits", "said"), [
    ("continuous", 'lower="-1" upper="1"', True), ("continuous", 'lower="0" upper="0"', False),
    ("planar", 'lower="0" upper="0"', True), ("floating", 'lower="-1"', True), ("revolute", 'lower="-1"', False),
])  # fmt: skip
def test_limits_that_no_joint_has_are_reported(kind: str, limits: str, said: bool) -> None:
    robot = tl.load_robot(f"""<robot name="r"><link name="base"/><link name="a"><inertial><mass value="1"/>
        <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="j" type="{kind}">
        <parent link="base"/><child link="a"/><axis xyz="0 0 1"/><limit {limits} effort="5" velocity="3"/></joint>
        </robot>""")
    lost = [one.names for one in robot.report.ignored if "turn without end" in one.what]
    assert lost == [("j",)] * said


def test_a_decimal_comma_locale_changes_no_number(tmp_path: Path) -> None:
    localedef = shutil.which("localedef")
    if localedef is None or not Path("/usr/share/i18n/locales/de_DE").exists():
        pytest.skip("no localedef to make a locale with a decimal comma from")
    made = subprocess.run([localedef, "-i", "de_DE", "-f", "UTF-8", str(tmp_path / "de_DE.UTF-8")], capture_output=True)
    assert (tmp_path / "de_DE.UTF-8").exists(), made.stderr
    code = """
import locale, ctypes
locale.setlocale(locale.LC_ALL, "de_DE.UTF-8")
assert locale.localeconv()["decimal_point"] == ","
assert ctypes.CDLL(None).strtod  # the C library now reads 0,5
import twolink as tl
robot = tl.load_robot("arm")
print(repr(robot.mass), repr(robot.model.upperPositionLimit[0]), repr(robot.mass_matrix([0.1, 0.2]).tolist()))
"""
    environment = {"LOCPATH": str(tmp_path), "PATH": "/usr/bin:/bin", "PYTHONPATH": str(TOP)}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    arm = tl.load_robot("arm")
    here = (arm.mass, arm.model.upperPositionLimit[0], arm.mass_matrix([0.1, 0.2]).tolist())
    assert done.stdout.split("\n") == [" ".join(map(repr, here)), ""]


def test_free_root_and_locked_joints() -> None:
    free = tl.load_robot("ur5", root="free")
    assert (free.nq, free.nv) == (13, 12)
    assert free.joint_names[0] == "root_joint"
    locked = tl.load_robot("panda", lock={"panda_finger_joint1": 0.02, "panda_finger_joint2": 0.02})
    assert locked.nv == 7
    whole = tl.load_robot("panda")
    q = np.concatenate([np.linspace(-1, 1, 7), [0.02, 0.02]])
    np.testing.assert_allclose(locked.mass_matrix(q[:7]), whole.mass_matrix(q)[:7, :7], rtol=0, atol=1e-12)
    angle = tl.load_robot("kinova", lock={"j2s6s200_joint_1": np.pi / 2})
    assert (angle.nq, angle.nv) == (7, 5)


@pytest.mark.parametrize("name", ["a", "b"])
def test_joints_that_have_the_names_of_links_can_be_locked(name: str) -> None:
    ball = '<visual><geometry><sphere radius="1"/></geometry></visual>'
    text = robot_of(
        link("a", at="0.1 0 0.3", more=ball), joint("a", "continuous", "ground", "a", "0 1 0"),
        link("b", at="0.1 0 0.3", more=ball),
        joint("b", "continuous", "a", "b", "0 1 0", more='<origin xyz="0 0 1"/>'))  # fmt: skip
    same = tl.load_robot(text, lock={name: 0.5})
    other = tl.load_robot(text.replace('joint name="', 'joint name="turn_'), lock={f"turn_{name}": 0.5})
    q = [np.cos(0.3), np.sin(0.3)]
    assert same.frame_names == other.frame_names == ("ground", "a", "b")
    for query in ("mass_matrix", "gravity_torque"):
        np.testing.assert_array_equal(getattr(same, query)(q), getattr(other, query)(q))
    np.testing.assert_array_equal(same.frame_pose(q, "b")[1], other.frame_pose(q, "b")[1])
    placements = [[g.placement.homogeneous for g in r.visual_model().geometryObjects] for r in (same, other)]
    np.testing.assert_array_equal(*placements)


def test_visuals_are_there_with_colours_and_without_missing_meshes() -> None:
    arm = tl.load_robot("two_link").visual_model()
    assert {tuple(np.round(g.meshColor, 2)) for g in arm.geometryObjects} >= {(0.13, 0.4, 0.68, 1.0)}
    panda = tl.load_robot("panda", lock={"panda_finger_joint1": 0.0}).visual_model()
    assert panda.ngeoms >= 8
    assert all(
        Path(g.meshPath).is_file() for g in panda.geometryObjects if g.meshPath not in ("BOX", "CYLINDER", "SPHERE")
    )
    lost = tl.load_robot('<robot name="r"><link name="a"><visual><geometry><mesh filename="x.stl"/></geometry></visual>'
                         "</link></robot>")  # fmt: skip
    assert lost.visual_model().ngeoms == 0
    assert any("x.stl" in str(f) for f in lost.report.ignored)


def test_gravity_and_mass() -> None:
    moon = tl.load_robot("two_link", gravity=(0, 0, -1.62))
    earth = tl.load_robot("two_link")
    q = np.array([0.4, -0.2])
    np.testing.assert_allclose(moon.gravity_torque(q) / earth.gravity_torque(q), 1.62 / 9.81, rtol=1e-14)
    assert earth.mass == 4.0
    assert np.array_equal(pin.neutral(earth.model), earth.neutral)


def test_blanks_around_numbers_do_not_matter() -> None:
    """Pinocchio's own parser drops the inertia of a link that has one."""
    text = (TOP / "urdf" / "two_link.urdf").read_text()
    padded = text.replace('mass value="3"', 'mass value=" 3 "').replace('iyy="0.25"', 'iyy=" 0.25 "')
    assert tl.load_robot(padded).model == tl.load_robot(text).model


@pytest.mark.parametrize(("axis", "movable"), [("1 0 0", True), ("0 0 1", False)])
def test_what_a_mimic_joint_moves_counts_for_the_joint_it_follows(axis: str, movable: bool) -> None:
    """J1 moves no mass; J3 mimics it and turns L3 on the planar joint J2, which can turn L3 about z itself."""
    follows = '<mimic joint="J1" multiplier="1.5"/>'
    text = robot_of(
        '<link name="L1"/><link name="L2"/>', link("L3", 1.0, (0.1, 0.12, 0.15), "0.3 0.1 0.2"),
        joint("J1", "revolute", "ground", "L1", "1 0 0"), joint("J2", "planar", "ground", "L2"),
        joint("J3", "revolute", "L2", "L3", axis, more=follows))  # fmt: skip
    if movable:
        assert tl.load_robot(text, mimic=True).nv == 4
    else:
        with pytest.raises(tl.errors.RobotError, match="'J1' cannot be accelerated"):
            tl.load_robot(text, mimic=True)


def test_text_is_unicode_whatever_encoding_it_declares() -> None:
    text = '<?xml version="1.0" encoding="ISO-8859-1"?>' + (TOP / "urdf" / "two_link.urdf").read_text()[21:]
    assert tl.load_robot(text.replace('"elbow"', '"coudé"')).joint_names == ("shoulder", "coudé")


@pytest.mark.parametrize(
    ("name", "value"),
    [("j2s6s200_joint_1", [3.0, 4.0]), ("j2s6s200_joint_1", [0.0, 0.0]), ("root_joint", [0] * 6 + [2])],
)
def test_locked_quaternions_must_have_length_1(name: str, value: list[float]) -> None:
    root = "free" if name == "root_joint" else "fixed"
    with pytest.raises(tl.errors.RobotError, match="expected length 1"):
        tl.load_robot("kinova", root=root, lock={name: value})


def test_locks_beyond_limits_are_reported() -> None:
    report = tl.load_robot("panda", lock={"panda_joint1": 1000.0}).report
    assert any("beyond their limits" in str(f) and "panda_joint1" in f.names for f in report.assumed)


def test_a_robot_without_joints_answers_with_an_empty_run() -> None:
    robot = tl.load_robot("hector")
    run = tl.simulate(tl.Scene(robot), 0.1)
    assert run.q.shape == (21, 0)


def test_normalize_and_with_gravity_refuse_bad_arguments() -> None:
    robot = tl.load_robot("kinova")
    for bad in ("a", np.zeros(3), 1.0):
        with pytest.raises(tl.errors.QueryError, match="expected shape"):
            robot.normalize(bad)
    with pytest.raises(tl.errors.QueryError, match="no direction"):
        robot.normalize(np.zeros(9))
    for field in ([np.nan] * 3, [1.0, 2.0]):
        with pytest.raises(tl.errors.QueryError, match="3 finite numbers"):
            robot.with_gravity(field)
