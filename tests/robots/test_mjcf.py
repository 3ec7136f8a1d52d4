"""MJCF: the same accelerations, places and loops as MuJoCo's own, and refusals that name the element."""

import dataclasses
import sys
from pathlib import Path

import gymnasium
import mujoco
import numpy as np
import pinocchio as pin
import pytest
import trimesh

import twolink as tl
from scripts.studies.mjcf import accelerations, difference, smooth_mujoco
from tests.refusals import refusal
from twolink import effects as fx
from twolink.algorithms.namespaces import Numbers
from twolink.effects.loops import Loop
from twolink.errors import MissingExtraError, RobotError
from twolink.integrate.motion.formulas import motion_of
from twolink.integrate.motion.scene_equations import equations_of
from twolink.robots import load_model
from twolink.robots.catalogue import open_source
from twolink.robots.checks import compare
from twolink.robots.meshes import MeshFolders
from twolink.robots.mjcf import read_mjcf
from twolink.robots.mjcf_model import compiled_mjcf
from twolink.robots.xml import Element

# All kinds of joints; anchors off the body's origin, references, several joints of a body, turned inertias, motors.
EVERYTHING = """<mujoco model="everything"><option gravity="1 2 -9"/><worldbody><body name="a" pos="0 0 1">
<joint name="h" axis="0 1 0" pos=".1 .2 .3" ref=".4" stiffness="3" springref=".2" damping=".1" frictionloss=".3"
 range="-1 2" limited="true"/>
<joint name="s" type="slide" axis="1 1 0" ref=".3" armature=".4"/>
<geom type="box" size=".1 .2 .3" pos=".1 0 0" euler="10 20 30"/>
<body name="b" pos=".3 0 0" euler="20 30 0" gravcomp=".7"><joint axis="1 0 1" pos="0 .1 .2"/>
<joint name="ball" type="ball" pos=".1 0 0" armature=".2" damping=".3"/><geom type="capsule" size=".05 .2"/>
<body name="c" pos="0 0 .4"><joint type="hinge" name="k"/><geom size=".1"/></body></body></body>
<body name="f" pos="1 2 3" euler="10 20 30"><freejoint name="free"/><geom type="box" size=".1 .2 .3" pos=".1 .2 .1"/>
<body pos=".2 0 0"><joint type="ball" damping=".1"/><geom size=".1" pos=".1 0 0"/></body></body></worldbody>
<actuator><motor joint="k" gear="3" armature=".7" damping=".5" forcerange="-2 1"/></actuator></mujoco>"""
ASSETS = Path(gymnasium.__file__).parent / "envs" / "mujoco" / "assets"


def placed(source: str | Path) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """MuJoCo's model of a file or a text, and its state at the start."""
    load = mujoco.MjModel.from_xml_path if isinstance(source, Path) else mujoco.MjModel.from_xml_string
    model = load(str(source))
    state = mujoco.MjData(model)
    mujoco.mj_forward(model, state)
    return model, state


def ignored(source: str) -> dict[str, tuple[str, ...]]:
    """What the load report says is ignored: names, by the first word of the statement."""
    return {one.what.partition(" ")[0]: one.names for one in tl.load_robot(source).report.ignored}


def open_by(robot: tl.Robot, q: np.ndarray) -> np.ndarray:
    """How far the only loop of a robot's scene is open, row by row."""
    (loop,) = [effect for effect in tl.scene_of(robot).effects if isinstance(effect, Loop)]
    smooth = equations_of(tl.Scene(robot, robot.neutral))
    x = np.concatenate([q, np.zeros(robot.nv)])[:, None]
    rows = loop.rows(motion_of(smooth, smooth.mechanism, np.zeros(1), x, Numbers))
    return np.array([np.broadcast_to(row, 1)[0] for row in rows], dtype=float)


@pytest.fixture
def everything(tmp_path: Path) -> Path:
    path = tmp_path / "everything.xml"
    path.write_text(EVERYTHING)
    return path


@pytest.mark.parametrize("name", ["everything", "ant", "humanoid", "walker2d_v5"])
def test_accelerations_are_mujocos(everything: Path, name: str) -> None:
    path = everything if name == "everything" else ASSETS / f"{name}.xml"
    assert difference(tl.load_robot(path), smooth_mujoco(path), 20) < 1e-12


def test_a_changed_inertia_is_seen(everything: Path) -> None:
    model = smooth_mujoco(everything)
    model.body_iquat[1] = (1, 0, 0, 0)
    assert difference(tl.load_robot(everything), model, 5) > 1e-3


def test_links_are_where_mujoco_has_them(everything: Path) -> None:
    robot, model = tl.load_robot(everything), smooth_mujoco(everything)
    data, rng = mujoco.MjData(model), np.random.default_rng(3)
    q = pin.integrate(robot.model, robot.neutral, rng.uniform(-1, 1, robot.nv))
    accelerations(robot, model, data, q, np.zeros(robot.nv), np.zeros(robot.nv))
    for name in ("a", "b", "c", "f"):
        rotation, position = robot.frame_pose(q, name)
        np.testing.assert_allclose(position, data.body(name).xpos, atol=1e-14)
        np.testing.assert_allclose(rotation.ravel(), data.body(name).xmat, atol=1e-14)


def test_a_second_reader_agrees(everything: Path) -> None:
    assert compare(tl.load_robot(everything))["agree"]


def test_what_belongs_to_joints_is_in_the_model(everything: Path) -> None:
    robot = tl.load_robot(everything)
    joints, model = {joint.name: joint for joint in robot.joints}, robot.model
    np.testing.assert_allclose(robot.gravity, (1, 2, -9))
    np.testing.assert_allclose(model.armature[joints["k"].v], 9 * 0.7)
    np.testing.assert_allclose(model.damping[joints["k"].v], 9 * 0.5)
    np.testing.assert_allclose(model.upperEffortLimit[joints["k"].v], 3 * 2)
    np.testing.assert_allclose(model.upperPositionLimit[joints["h"].q], np.radians(2))
    np.testing.assert_allclose(model.upperDryFrictionLimit[joints["h"].v], 0.3)
    np.testing.assert_allclose(tl.load_robot(everything, gravity=(0, 0, 0)).gravity, 0)
    np.testing.assert_allclose(tl.scene_of(robot).q[joints["free"].q][:3], (1, 2, 3))
    assert "actuators (no command is given, none acts): actuator0" in str(robot.report)


LOOPS = """<mujoco><worldbody>
<body name="a"><joint name="p" axis="0 1 0"/><geom size=".1"/><site name="s" pos=".1 .2 0"/>
<body name="b" pos=".5 0 0"><joint name="q" axis="0 1 1" ref=".2"/><geom size=".1"/></body></body>
<body name="c" pos="1 0 0"><freejoint/><geom size=".1"/><site name="t" pos="0 .1 0" euler="10 0 20"/></body></worldbody>
<equality>{}</equality></mujoco>"""


@pytest.mark.parametrize("text", [
    '<connect body1="c" body2="b" anchor=".1 .2 .3"/>',
    '<connect site1="s" site2="t"/>',
    '<weld body1="c" body2="b" relpose=".1 .2 .3 .5 .5 .5 .5" anchor=".1 0 .3"/>',
    '<weld site1="s" site2="t"/>',
    '<weld body1="c"/>',
    '<joint joint1="p" joint2="q" polycoef=".1 .5 0 0 0"/>',
])  # fmt: skip
def test_loops_are_as_far_open_as_mujocos(text: str) -> None:
    robot, (model, data) = tl.load_robot(LOOPS.format(text)), placed(LOOPS.format(text))
    start, rng = tl.scene_of(robot).q, np.random.default_rng(4)
    for _ in range(3):
        q = pin.integrate(robot.model, start, rng.uniform(-1, 1, robot.nv))
        accelerations(robot, model, data, q, np.zeros(robot.nv), np.zeros(robot.nv))
        theirs = data.efc_pos[data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY]
        ours = open_by(robot, q)
        assert len(ours) == len(theirs)
        assert np.linalg.norm(ours[:3]) == pytest.approx(np.linalg.norm(theirs[:3]), abs=1e-12)


def test_a_weld_is_closed_where_mujocos_is() -> None:
    text = LOOPS.format('<weld body1="b" body2="c" relpose=".1 .2 .3 .5 -.5 .5 .5" anchor=".1 0 .3"/>')
    robot, (model, data) = tl.load_robot(text), placed(text)
    b = model.body("b").id
    relative = pin.Quaternion(*model.eq_data[0][6:10]).matrix()
    place = pin.SE3(data.xmat[b].reshape(3, 3), data.xpos[b]) * pin.SE3(relative, model.eq_data[0][3:6])
    place = place * pin.SE3(np.eye(3), -model.eq_data[0][:3])
    q = np.array([*model.qpos0[:2], *pin.SE3ToXYZQUAT(place)])
    q = q if robot.joints[0].name == "p" else np.roll(q, 7)
    np.testing.assert_allclose(open_by(robot, q), 0, atol=1e-14)


ARM = """<mujoco>{top}<worldbody><body name="a"><joint name="j" axis="0 1 0"{joint}/><geom size=".1" pos=".1 0 0"/>
<body name="b"><joint name="o" type="ball"{ball}/><geom size=".1"/></body></body>
<body name="f"><joint name="g" type="free"{free}/><geom size=".1"/></body></worldbody>{end}</mujoco>"""
TENDON = '<tendon><fixed name="t"{}><joint joint="j" coef="1"/></fixed></tendon>'
# What is written where, and what the refusal names.
MISSING = {
    "fluid": ({"top": '<option density="1.2"/>'}, ["option density", "a fluid"]),
    "tendon's spring": ({"end": TENDON.format(' stiffness="2"')}, ["tendon 't'", "spring"]),
    "tendon's damping": ({"end": TENDON.format(' damping="2"')}, ["tendon 't'", "damping"]),
    "tendon's friction": ({"end": TENDON.format(' frictionloss="2"')}, ["tendon 't'", "friction"]),
    "tendon's armature": ({"end": TENDON.format(' armature="2"')}, ["tendon 't'", "armature"]),
    "ball's spring": ({"ball": ' stiffness="2"'}, ["joint 'o'", "spring"]),
    "ball's friction": ({"ball": ' frictionloss="2"'}, ["joint 'o'", "friction"]),
    "armature of a free body": ({"free": ' armature="1"'}, ["joint 'g'", "armature"]),
    "curved damping": ({"joint": ' damping="1 2"'}, ["joint 'j'", "not linear"]),
    "joint to a curve": (
        {"end": '<equality><joint name="e" joint1="j"/></equality>'}, ["equality 'e' (joint)", "equality"]),
}  # fmt: skip


def arm(**parts: str) -> str:
    return ARM.format(**dict.fromkeys(("top", "joint", "ball", "free", "end"), "") | parts)


@pytest.mark.parametrize("case", MISSING)
def test_what_changes_the_motion_and_has_no_counterpart_is_refused_or_reported(case: str) -> None:
    parts, words = MISSING[case]
    with refusal(RobotError, *words, code="no-counterpart"):
        tl.load_robot(arm(**parts))
    said = " | ".join(map(str, tl.load_robot(arm(**parts), foreign="report").report.ignored))
    assert all(word in said for word in words)
    tl.load_robot(arm())


def test_laws_that_queries_do_not_apply_are_in_the_report() -> None:
    """MuJoCo's accelerations have the spring, the weightless body and the equality; those of queries have not."""
    text = """<mujoco><worldbody><body><joint name="a" axis="0 1 0" stiffness="2" springref="30"/>
        <geom type="capsule" fromto="0 0 0 0 0 -0.5" size="0.02"/><body name="b" pos="0 0 -.5" gravcomp="1">
        <joint name="k" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0 0 -0.5" size="0.02"/></body></body>
        </worldbody><equality><joint joint1="k" joint2="a"/></equality></mujoco>"""
    robot, (_, data) = tl.load_robot(text), placed(text)
    assert np.abs(data.qacc - robot.forward_dynamics([0.0, 0.0], [0.0, 0.0], [0.0, 0.0])).max() > 1.0
    (finding,) = (one for one in robot.report.ignored if "scene_of makes them effects" in one.what)
    assert finding.names == ("joint-spring", "gravity-compensation", "coupling")
    joined = tl.Scene(tl.load_robot("world")).with_object(robot, name="arm").base.report.ignored
    assert dataclasses.replace(finding, what=f"arm: {finding.what}") in joined


def test_disabled_laws_do_not_act() -> None:
    parts = {"joint": ' damping="1" stiffness="2" range="-1 1" limited="true"'}
    flags = '<option><flag spring="disable" damper="disable" limit="disable" gravity="disable"/></option>'
    robot = tl.load_robot(arm(top=flags, **parts))
    assert [type(effect).__name__ for effect in tl.scene_of(robot).effects] == ["Gravity"]
    assert not robot.gravity.any()
    assert "disable" in str(robot.report)


@pytest.mark.parametrize(
    ("text", "code", "word"),
    [("<mujoco><wrldbody/></mujoco>", "mjcf", "wrldbody"), ("<mujoco><worldbody/></mujoco>", "", ""),
     ("<sdf version='1.9'/>", "other-format", "sdf2mjcf"), ("#usda 1.0", "other-format", "usd_to_urdf")],
)  # fmt: skip
def test_other_files_are_refused_with_a_remedy(tmp_path: Path, text: str, code: str, word: str) -> None:
    path = tmp_path / "robot.xml"
    path.write_text(text)
    if not code:
        assert tl.load_robot(path).nv == 0
        return
    with refusal(RobotError, word, code=code):
        tl.load_robot(path)


def test_what_strangers_send_opens_no_files() -> None:
    with pytest.raises(RobotError, match="export_urdf"):
        load_model(tl.Robot, arm(), meshes=MeshFolders((), None, ()))


def test_a_free_base_is_refused() -> None:
    with pytest.raises(RobotError, match="freejoint"):
        tl.load_robot(arm(), root="free")


def test_without_the_extra_the_command_is_given(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'twolink\[mjcf\]'"):
        tl.load_robot(arm())


def test_the_scene_runs_and_is_saved(everything: Path, tmp_path: Path) -> None:
    scene = tl.scene_of(tl.load_robot(ASSETS / "inverted_double_pendulum.xml"), duration=0.2)
    saved = tl.load_scene(scene.save(tmp_path / "scene.toml"))
    a, b = tl.simulate(scene, accuracy=1e-6), tl.simulate(saved, accuracy=1e-6)
    np.testing.assert_allclose(a.q[-1], b.q[-1], atol=1e-5)
    springs = tl.load_scene(tl.scene_of(tl.load_robot(everything)).save(tmp_path / "all.toml"))
    assert {"JointSpring", "FrameWrench"} <= {type(effect).__name__ for effect in springs.effects}
    np.testing.assert_allclose(springs.robot.model.armature, tl.load_robot(everything).model.armature)


def test_bodies_whose_contact_the_file_excludes_do_not_touch() -> None:
    bodies = "".join(f'<body name="{name}" pos="{x} 0 1"><joint axis="0 1 0"/><geom size=".1"/></body>'
                     for x, name in enumerate("abc"))  # fmt: skip
    excluded = '<contact><exclude body1="a" body2="c"/></contact>'
    for text, expected in ((excluded, {"a - b", "b - c"}), ("", {"a - b", "b - c", "a - c"})):
        robot = tl.load_robot(f"<mujoco><worldbody>{bodies}</worldbody>{text}</mujoco>")
        assert {pair.name for pair in fx.Contact("self").selected(robot).chosen} == expected
        assert ("do not touch" in str(robot.report)) == bool(text)


def test_bodies_whose_masks_differ_do_not_touch_as_in_mujoco() -> None:
    """MuJoCo's own contacts of bodies that all overlap name the pairs."""
    masks = {"a": (1, 1), "c": (2, 2), "d": (0, 2), "e": (0, 1), "f": (1, 2)}
    bodies = "".join(
        f'<body name="{name}" pos="0 0 {1 + k / 100}"><freejoint/><geom name="g{name}" size=".1" '
        f'contype="{c}" conaffinity="{d}"/></body>'
        for k, (name, (c, d)) in enumerate(masks.items())
    )
    for more in ("", '<contact><pair geom1="gd" geom2="ge"/></contact>'):
        text = f'<mujoco><worldbody><geom type="box" size="1 1 1"/>{bodies}</worldbody>{more}</mujoco>'
        model, state = placed(text)
        pairs = {frozenset(model.body(model.geom_bodyid[geom]).name for geom in contact.geom)
                 for contact in state.contact}  # fmt: skip
        robot = tl.load_robot(text)
        chosen = fx.Contact("self").selected(robot).chosen
        assert {frozenset(pair.name.split(" - ")) for pair in chosen} == pairs
    assert not any("masks" in finding.what for finding in robot.report.ignored)


def test_masks_of_some_shapes_or_of_the_ground_and_ranges_of_balls_are_in_the_report() -> None:
    text = """<mujoco><worldbody><geom type="plane" size="1 1 1"/><body name="a">
        <joint name="j" type="ball" range="0 30"/><geom size=".1"/>
        <geom size=".1" contype="2" conaffinity="2"/></body><body name="b" pos="0 0 1"><freejoint/>
        <geom size=".1"/></body></worldbody></mujoco>"""
    found = ignored(text)
    assert found["masks"] == ("a", "b")
    assert found["limits"] == ("j",)


def test_margins_at_which_mujoco_keeps_bodies_and_joints_are_in_the_report() -> None:
    """A ball of 0.1 m rests at 0.12 m there, and a joint stops 0.1 rad before its limit; here at 0.1 m and there."""
    text = """<mujoco><option timestep="0.005"/><worldbody><geom type="plane" size="1 1 1"/><body pos="0 0 .12">
        <freejoint/><geom name="g" size=".1" {0}/></body><body pos="9 0 9"><joint name="j" axis="0 1 0" range="0 20"
        damping="1" {1}/><geom size=".1" pos="1 0 0"/></body></worldbody></mujoco>"""
    with_margins = text.format('margin="0.02"', 'margin="0.1"')
    model, state = placed(with_margins)
    mujoco.mj_step(model, state, 1000)
    assert state.qpos[2] == pytest.approx(0.12, abs=1e-3)
    assert state.qpos[7] == pytest.approx(np.deg2rad(20) - 0.1, abs=2e-3)
    assert ignored(with_margins)["margins"] == ("g", "j")
    assert "margins" not in str(tl.load_robot(text.format("", "")).report)


def test_a_height_field_is_the_ground_of_a_scene_and_has_mujocos_heights(tmp_path: Path) -> None:
    """MuJoCo's rays from above say the heights at the corners, whose rows lie along y."""
    data = " ".join(map(str, [0, 0.2, 0.1, 0.7, 1, 0.3]))
    path = tmp_path / "field.xml"
    asset = f'<hfield name="h" nrow="2" ncol="3" size="1 0.5 0.4 0.1" elevation="{data}"/>'
    path.write_text(f"""<mujoco><asset>{asset}</asset>
        <worldbody><geom type="hfield" hfield="h" pos="0.3 0.2 0.1"/>
        <body name="ball" pos="0.3 0.2 1"><freejoint/><geom size=".1"/></body></worldbody></mujoco>""")
    scene = tl.scene_of(tl.load_robot(path), 0.05, contact=True)
    (contact,) = (effect for effect in scene.effects if isinstance(effect, fx.Contact))
    name, field = contact.pairs[1]  # type: ignore[str-unpack]
    assert name == "ball"
    assert field.cell == (1.0, 1.0)
    model, state = placed(path)
    for i, k in np.ndindex(3, 2):
        x, y = field.point[0] + 0.999 * i + 5e-4, field.point[1] + 0.999 * k + 5e-4
        ray = mujoco.mj_ray(
            model, state, np.array([x, y, 3.0]), np.array([0, 0, -1.0]), None, 1, 1, np.zeros(1, np.int32)
        )
        assert field.point[2] + field.heights[i][k] == pytest.approx(3.0 - ray, abs=2e-3)
    assert tl.simulate(scene, contact="stepped", step=5e-3, verify=False).q[-1, 2] > 0.0


def test_planes_of_the_world_are_the_ground_of_a_scene_where_they_lie() -> None:
    """One that is turned and raised is as far from a ball as MuJoCo says; below that a ball rests on the lowest."""
    text = """<mujoco><worldbody><geom type="plane" size="1 1 1" pos="0 0 -.5"/>
        <body pos="0 0 -2" euler="20 30 0"><geom type="plane" size="1 1 1" pos=".1 .2 .3" euler="0 10 5"/></body>
        <body name="ball" pos="{}"><freejoint/><geom size=".1"/></body></worldbody></mujoco>"""
    model, state = placed(text.format("0 0 1"))
    scene = tl.scene_of(text.format("0 0 1"), 1.0, contact=True)
    (contact,) = (effect for effect in scene.effects if isinstance(effect, fx.Contact))
    assert [pair[0] for pair in contact.pairs[1:]] == ["ball", "ball"]
    for number, (_, plane) in enumerate(contact.pairs[1:]):  # type: ignore[str-unpack]
        gap = np.dot(plane.normal, scene.q[:3]) - plane.height - 0.1
        assert gap == pytest.approx(mujoco.mj_geomDistance(model, state, number, 2, 9.0, None), abs=1e-12)
    falling = tl.scene_of(text.format("5 0 1"), 1.0, contact=True)
    assert tl.simulate(falling).q[-1, 2] == pytest.approx(-0.4, abs=1e-8)
    said = ignored(text.format("0 0 1"))
    assert said["ground"] == ("plane",)
    assert "shapes" not in said


def test_the_load_report_names_laws_of_the_file_that_queries_leave_out() -> None:
    assert ignored(EVERYTHING)["laws"] == ("joint-spring", "gravity-compensation")
    assert "laws" not in str(tl.load_robot("two_link").report)


# A mesh of a body whose mass is given; one of a body without; one that gives a box its size.
MESHED = """<mujoco><compiler meshdir="parts"/><asset><mesh file="given.stl" refpos=".1 0 0" scale="2 1 1"/>
<mesh name="massive" file="b.obj"/><mesh name="sized" file="c.obj"/></asset><worldbody><body name="a"><freejoint/>
<inertial mass="2" pos="0 0 .1" diaginertia=".1 .1 .1"/>{given}<body name="b"><joint/>{massive}</body>
<body name="c"><joint/><inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/>{sized}</body></body></worldbody></mujoco>"""
GEOMS = {"given": '<geom type="mesh" mesh="given" pos=".3 0 0" euler="10 20 30"/>',
         "massive": '<geom type="mesh" mesh="massive"/>', "sized": '<geom type="box" mesh="sized"/>'}  # fmt: skip


def numbers(element: Element) -> list[float]:
    """All numbers of an element and of those in it, in their order."""
    own = [float(x) for text in element.attributes.values() for x in text.split() if x[0] in "-0123456789"]
    return own + [x for child in element.children for x in numbers(child)]


def test_meshes_that_give_no_mass_and_no_size_are_not_read(tmp_path: Path) -> None:
    box, path = trimesh.creation.box((0.2, 0.4, 0.6)), tmp_path / "robot.xml"
    box.apply_translation([0.5, 0.1, 0.2])
    (tmp_path / "parts").mkdir()
    for name in ("b.obj", "c.obj", "given.stl"):
        box.export(tmp_path / "parts" / name)
    path.write_text(MESHED.format(**GEOMS))
    source = open_source(path)
    model, _ = placed(path)
    by_mujoco = read_mjcf(dataclasses.replace(compiled_mjcf(source), model=model), source, "refuse").robot
    (tmp_path / "parts" / "given.stl").unlink()
    np.testing.assert_allclose(numbers(read_mjcf(compiled_mjcf(source), source, "refuse").robot), numbers(by_mujoco),
                               atol=1e-14)  # fmt: skip
    assert "given.stl" in str(tl.load_robot(path).report)
    for name, file in (("massive", "b.obj"), ("sized", "c.obj")):
        (tmp_path / "parts" / file).rename(tmp_path / file)
        with pytest.raises(RobotError, match=file):
            tl.load_robot(path)
        path.write_text(MESHED.format(**{**GEOMS, name: '<geom size=".1"/>'}))
        tl.load_robot(path)
        path.write_text(MESHED.format(**GEOMS))
        (tmp_path / file).rename(tmp_path / "parts" / file)


@pytest.mark.parametrize("name", ['name="m"', ""])
def test_the_mass_of_an_attached_model_is_that_of_its_own_compiler(name: str, tmp_path: Path) -> None:
    trimesh.creation.box((0.2, 0.4, 0.6)).export(tmp_path / "m.obj")
    (tmp_path / "part.xml").write_text(
        f'<mujoco model="part"><compiler inertiafromgeom="true"/><asset><mesh {name} file="m.obj"/></asset><worldbody>'
        '<body name="b"><joint/><inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/><geom type="mesh" mesh="m"/></body>'
        "</worldbody></mujoco>")  # fmt: skip
    path = tmp_path / "whole.xml"
    path.write_text('<mujoco><asset><model name="part" file="part.xml"/></asset><worldbody><body><freejoint/>'
                    '<geom size=".1"/><attach model="part" body="b" prefix="its-"/></body></worldbody>'
                    "</mujoco>")  # fmt: skip
    model, _ = placed(path)
    assert model.body_mass[2] == pytest.approx(48.0)
    assert compiled_mjcf(open_source(path)).model.body_mass == pytest.approx(model.body_mass)


@pytest.mark.parametrize("seen", ["part.obj", "./part.obj", "other/part.obj"])
def test_a_mass_is_read_from_its_own_mesh_beside_another_of_that_file(seen: str, tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    for file in ("part.obj", "other/part.obj"):
        trimesh.creation.box((0.1, 0.2, 0.3)).export(tmp_path / file)
    path = tmp_path / "robot.xml"
    path.write_text(f"""<mujoco><asset><mesh name="body" file="part.obj"/><mesh name="seen" file="{seen}"
        scale="2 2 2"/></asset><worldbody><geom type="mesh" mesh="seen" contype="0" conaffinity="0"/><body>
        <joint axis="0 1 0"/><geom type="mesh" mesh="body"/></body></worldbody></mujoco>""")
    assert tl.load_robot(path).mass == pytest.approx(1000 * 0.1 * 0.2 * 0.3)


def test_meshes_of_a_model_are_beside_it_however_its_path_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "robots" / "meshes").mkdir(parents=True)
    trimesh.creation.box((0.1, 0.2, 0.3)).export(tmp_path / "robots" / "meshes" / "part.obj")
    path = tmp_path / "robots" / "one.xml"
    path.write_text("""<mujoco><compiler meshdir="meshes"/><asset><mesh name="m" file="part.obj"/></asset><worldbody>
        <body><joint axis="0 1 0"/><geom type="mesh" mesh="m"/></body></worldbody></mujoco>""")
    for folder, written in ((tmp_path, "robots/one.xml"), (tmp_path / "robots", "one.xml"), (Path("/"), str(path)),
                            (tmp_path / "robots" / "meshes", "../one.xml")):  # fmt: skip
        monkeypatch.chdir(folder)
        (solid,) = tl.load_robot(written).solids
        assert np.ptp(np.asarray(solid.shape.vertices), axis=0) == pytest.approx([0.1, 0.2, 0.3])


WEDGE = ((0, 0, 0), (0.3, 0, 0), (0, 0.2, 0), (0, 0, 0.1))
TURN = 'refquat=".8 .2 -.3 .4" '


@pytest.mark.parametrize("mesh", ["", TURN, 'scale="2 1 -1"', TURN + 'scale="-2 -2 -2"'])
def test_meshes_with_a_reference_stand_where_mujoco_has_them(mesh: str, tmp_path: Path) -> None:
    faces = ((1, 3, 2), (1, 2, 4), (1, 4, 3), (2, 3, 4))
    lines = [*(f"v {x} {y} {z}" for x, y, z in WEDGE), *(f"f {i} {j} {k}" for i, j, k in faces)]
    (tmp_path / "w.obj").write_text("\n".join(lines))
    path = tmp_path / "robot.xml"
    path.write_text(f"""<mujoco><asset><mesh name="w" file="w.obj" refpos=".05 .1 .15" {mesh}/></asset>
        <worldbody><body><joint axis="0 1 0"/><geom type="mesh" mesh="w" pos=".1 .2 .3" euler="10 20 30"/></body>
        </worldbody></mujoco>""")
    model, state = placed(path)
    expected = model.mesh_vert @ state.geom_xmat[0].reshape(3, 3).T + state.geom_xpos[0]
    (solid,) = tl.load_robot(path).solids
    place = solid.shape.placement
    corners = np.asarray(solid.shape.vertices) @ place.rotation.T + place.translation
    for point in corners:
        assert np.linalg.norm(expected - point, axis=1).min() < 1e-6
    assert len(corners) == len(expected)


def test_meshes_that_a_urdf_cannot_name_are_in_the_report(tmp_path: Path) -> None:
    vertices = " ".join(str(x) for corner in WEDGE for x in corner)
    text = f"""<mujoco><asset><mesh name="w" vertex="{vertices}"/></asset><worldbody><body><freejoint/>
        <geom name="inline" type="mesh" mesh="w"/></body></worldbody></mujoco>"""
    (finding,) = (one for one in tl.load_robot(text).report.ignored if one.names == ("inline",))
    assert "meshes of no file" in finding.what
    trimesh.creation.box((0.2, 0.4, 0.6)).export(tmp_path / "box.stl")
    path = tmp_path / "robot.xml"
    path.write_text(text.replace(f'vertex="{vertices}"', f'file="box.stl" scale="2 1 1" {TURN}'))
    robot = tl.load_robot(path)
    (finding,) = (one for one in robot.report.ignored if one.names == ("inline",))
    assert "refquat" in finding.what
    assert not robot.solids
