"""Objects and robots beside a robot: what is joined moves as it would alone, names stay unique, files say the same."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import trimesh

import twolink as tl
from twolink.errors import RobotError, SceneError, TwolinkError
from twolink.scenes.scene import fall_notes

fx = tl.effects
EMPTY = tl.Scene(tl.load_robot("world"), effects=[fx.Gravity()], duration=1.0)
TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"


@pytest.mark.parametrize(
    ("shape", "moments"),  # of 1 kg that is spread evenly
    [
        (fx.Sphere(0.1), [0.004] * 3),
        (fx.Box((0.1, 0.2, 0.3)), [0.13 / 12, 0.1 / 12, 0.05 / 12]),
        (fx.Cylinder(0.1, 0.3), [0.12 / 12, 0.12 / 12, 0.005]),
    ],
)
def test_shapes_are_filled_evenly(shape: fx.Sphere, moments: list[float]) -> None:
    robot = EMPTY.with_object(shape, mass=1.0).base
    np.testing.assert_allclose(robot.model.inertias[1].inertia, np.diag(moments), rtol=1e-12, atol=1e-17)
    assert robot.mass == 1.0


def test_a_capsule_has_the_moments_of_its_parts() -> None:
    r, h = 0.1, 0.3
    cylinder, ball = np.pi * r**2 * h, 4 / 3 * np.pi * r**3
    whole = cylinder + ball
    along = (cylinder * r**2 / 2 + ball * 0.4 * r**2) / whole
    half_ball = ball / 2 * (83 / 320 * r**2 + (h / 2 + 3 / 8 * r) ** 2)
    across = (cylinder * (3 * r**2 + h**2) / 12 + 2 * half_ball) / whole
    inertia = EMPTY.with_object(fx.Capsule(r, h), mass=1.0).base.model.inertias[1].inertia
    np.testing.assert_allclose(np.diag(inertia), [across, across, along], rtol=1e-12)


def test_a_mesh_has_the_centre_and_moments_of_what_it_encloses(tmp_path: Path) -> None:
    """A tetrahedron at the origin of three unit edges: centre 1/4, I_xx = 3/40 m about it (Tonon 2004)."""
    (tmp_path / "corner.obj").write_text(TETRAHEDRON)
    scene = EMPTY.with_object(tmp_path / "corner.obj", mass=2.0)
    body = scene.base.model.inertias[1]
    np.testing.assert_allclose(body.lever, [0.25] * 3, rtol=1e-12)
    np.testing.assert_allclose(np.diag(body.inertia), [2 * 3 / 40] * 3, rtol=1e-12)
    assert scene.base.joint_names == ("corner",)
    turned = TETRAHEDRON.replace("f 1 3 2", "f 1 2 3").replace("f 1 2 4", "f 1 4 2")
    (tmp_path / "inside.obj").write_text(turned.replace("f 2 3 4", "f 2 4 3").replace("f 3 1 4", "f 3 4 1"))
    with pytest.raises(RobotError, match="encloses no volume"):
        EMPTY.with_object(tmp_path / "inside.obj", mass=2.0)


@pytest.mark.parametrize("suffix", [".stl", ".obj", ".ply"])
def test_a_mesh_that_encloses_nothing_has_no_inertia(suffix: str, tmp_path: Path) -> None:
    """Away from the origin its volume is that of what it encloses with the origin, and its centre is off."""
    box = trimesh.creation.box((0.2, 0.3, 0.4))
    box.apply_translation([1.0, 0.5, 0.3])
    faces = np.array(box.faces)
    flipped = np.concatenate([faces[:1, ::-1], faces[1:]])
    for name, part in {"open": faces[2:], "tube": faces[4:], "flipped": flipped}.items():
        path = tmp_path / f"{name}{suffix}"
        trimesh.Trimesh(box.vertices, part, process=False).export(path)
        with pytest.raises(RobotError, match=r"not closed|encloses no volume"):
            EMPTY.with_object(path, mass=2.0)
    box.export(tmp_path / f"whole{suffix}")
    body = EMPTY.with_object(tmp_path / f"whole{suffix}", mass=2.0).base.model.inertias[1]
    np.testing.assert_allclose(body.lever, [1.0, 0.5, 0.3], rtol=1e-6)
    np.testing.assert_allclose(np.diag(body.inertia), [2 / 12 * x for x in (0.25, 0.2, 0.13)], rtol=1e-5)


def test_two_robots_move_as_each_would_alone() -> None:
    arm, solo = tl.load_robot("ur5"), tl.load_robot("solo12", root="free", lock={"FL_KFE": 0.5})
    scene = tl.Scene(arm, q=arm.neutral + 0.3).with_object(arm, (1, 0, 0, 0, 0, 1, 0), name="left").with_object(solo)
    both, rng = scene.base, np.random.default_rng(1)
    q, (v, tau) = both.random_state(1, seed=3)[0][0], rng.uniform(-1, 1, (2, both.nv))
    a = both.forward_dynamics(q, v, tau)
    for one, prefix in ((arm, ""), (arm, "left_"), (solo, "solo12_")):
        there = {joint.name: joint for joint in both.joints}
        names = ["solo12" if name == "root_joint" else f"{prefix}{name}" for name in one.joint_names]
        parts = [np.concatenate([x[getattr(there[name], key)] for name in names])
                 for key, x in (("q", q), ("v", v), ("v", tau), ("v", a))]  # fmt: skip
        np.testing.assert_allclose(one.forward_dynamics(*parts[:3]), parts[3], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(both.frame_pose(q, "left_base_link")[1], [1, 0, 0], atol=1e-15)
    np.testing.assert_array_equal(scene.q[there["left_elbow_joint"].q], [0.0])
    np.testing.assert_array_equal(scene.q[there["elbow_joint"].q], [0.3])


def test_objects_start_at_their_poses_and_names_are_unique() -> None:
    pose = pin.SE3(pin.rpy.rpyToMatrix(0.1, 0.2, 0.3), np.array([1.0, 2.0, 3.0]))
    scene = EMPTY.with_object("can", pose).with_object("can").with_object("can", name="tin", root="fixed")
    assert scene.base.joint_names == ("can", "can_2")
    assert scene.base.frame_names == ("world", "can", "can_2", "tin")
    np.testing.assert_allclose(scene.q[:7], pin.SE3ToXYZQUAT(pose), atol=1e-15)
    assert [str(line) for line in scene.base.report.read[1:]] == [
        "joined 'can' as 'can', free, at 1.0 2.0 3.0 m", "joined 'can' as 'can_2', free, at 0.0 0.0 0.0 m",
        "joined 'can' as 'tin', fixed, at 0.0 0.0 0.0 m",
    ]  # fmt: skip


def test_a_free_base_stays_free_and_keeps_its_name() -> None:
    solo = tl.load_robot("solo12", root="free")
    scene = tl.Scene(solo, q={"root_joint": [0, 0, 0.4, 0, 0, 0, 1]}).with_object("box", (1, 0, 0)).with_object("ball")
    joints = {joint.name: joint for joint in scene.base.joints}
    np.testing.assert_array_equal(scene.q[joints["root_joint"].q], [0, 0, 0.4, 0, 0, 0, 1])
    assert {"box", "ball"} < joints.keys()


def test_files_say_the_same_and_are_saved(tmp_path: Path) -> None:
    (tmp_path / "corner.obj").write_text(TETRAHEDRON)
    (tmp_path / "a.toml").write_text("""
        robot = "world"
        [q]
        tin = [0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 1.0]
        [[objects]]
        source = "can"
        name = "tin"
        [[objects]]
        source = { kind = "sphere", radius = 0.1 }
        mass = 0.5
        pose = [0.0, 1.0, 0.0]
        [[objects]]
        source = "corner.obj"
        mass = 1.0
        [[effects]]
        type = "contact"
    """)
    scene = tl.load_scene(tmp_path / "a.toml")
    joints = {joint.name: scene.q[joint.q][:3].tolist() for joint in scene.base.joints}
    assert joints == {"tin": [0, 0, 2], "sphere": [0, 1, 0], "corner": [0, 0, 0]}
    again = tl.load_scene(scene.save(tmp_path / "b.toml"))
    np.testing.assert_array_equal(again.q, scene.q)
    np.testing.assert_allclose(again.base.mass_matrix(scene.q), scene.base.mass_matrix(scene.q), rtol=1e-12, atol=1e-15)


def test_a_dropped_object_falls_and_rests() -> None:
    scene = EMPTY.with_object(fx.Sphere(0.1), (0, 0, 0.1 + 9.81 / 8), mass=0.3)
    scene = scene.with_effects([*scene.effects, fx.Contact(("ground",))])
    run = tl.simulate(scene, accuracy=1e-9)
    assert run.events[0].t == pytest.approx(0.5, abs=1e-9)
    np.testing.assert_allclose(run.q[-1, :3], [0, 0, 0.1], atol=1e-9)


@pytest.mark.parametrize(("arguments", "said"), [
    ({"source": "can", "mass": 1.0}, "masses of its own"),
    ({"source": fx.Sphere(0.1), "mass": -1.0}, "it is -1.0 kg"),
    ({"source": fx.Sphere(0.0), "mass": 1.0}, "has no volume"),
    ({"source": fx.Convex(((0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0))), "mass": 1.0}, "span no volume"),
    ({"source": "can", "name": "world"}, "the name 'world' is taken; such as 'world_2'"),
    ({"source": "can", "pose": (0, 0)}, "expected 3 or 7 finite numbers"),
    ({"source": "can", "pose": (0, 0, 0, 0, 0, 0, 0)}, "expected 3 or 7 finite numbers"),
    ({"source": "cann"}, "did you mean 'can'"),
    ({"source": fx.Sphere(0.1), "root": "free"}, "no-inertia|cannot be accelerated"),
])  # fmt: skip
def test_what_cannot_be_is_refused(arguments: dict, said: str) -> None:
    with pytest.raises(TwolinkError, match=said):
        EMPTY.with_object(**arguments)


MOVED = pin.SE3(np.eye(3), np.array([0.9, 0.1, 0.0]))


@pytest.mark.parametrize("change", [
    *(lambda model, name=name: setattr(model, name, np.array([2.0, 5.0]))
      for name in ("armature", "damping", "upperDryFrictionLimit", "upperPositionLimit")),
    lambda model: model.inertias.__setitem__(1, model.inertias[1] + model.inertias[1]),
    lambda model: model.jointPlacements.__setitem__(1, MOVED),
])  # fmt: skip
@pytest.mark.parametrize("is_part", [False, True])
def test_changed_constants_are_not_lost_in_silence(change: Callable[[pin.Model], None], is_part: bool) -> None:
    arm = tl.load_robot("two_link")
    robot = arm.changed(change)
    first, second = (arm, robot) if is_part else (robot, arm)
    with pytest.raises(RobotError, match="joint 'shoulder': its constants were changed after it was loaded"):
        tl.Scene(first).with_object(second, (9, 0, 0, 0, 0.6, 0, 0.8), name="o")


@pytest.mark.parametrize("kind", [{"root": "free"}, {"lock": {"elbow_joint": 0.4}}, {"gravity": (0.0, 0.0, -1.0)}])
@pytest.mark.parametrize("pose", [(1e4, 2, 5, 0, 0.5**0.5, 0, 0.5**0.5), (1, 2, 3, 0.5, 0.5, 0.5, 0.5)])
def test_a_robot_is_joined_however_it_was_loaded(kind: dict, pose: tuple, tmp_path: Path) -> None:
    """Free and fixed ones, at poses whose roll, pitch and yaw are not unique."""
    arm = tl.load_robot("ur5", **kind)
    scene = tl.Scene(arm).with_object(arm, pose, name="p", root="fixed").with_object(arm, (1, 2, 3), name="o")
    again = tl.load_scene(scene.save(tmp_path / "a.toml")).base
    assert again.joint_names == scene.base.joint_names
    np.testing.assert_allclose(again.mass_matrix(scene.q), scene.base.mass_matrix(scene.q), rtol=1e-12, atol=1e-9)


@pytest.mark.parts
def test_an_export_has_changed_constants(tmp_path: Path) -> None:
    """What is joined from it moves as the changed robot alone."""
    moved = tl.load_robot("two_link").changed(lambda model: model.jointPlacements.__setitem__(2, MOVED))
    joined = EMPTY.with_object(tl.load_robot(moved.export_urdf(tmp_path / "moved.urdf")), (1, 0, 0)).base
    q, v, tau = [0.3, -0.4], [0.5, 0.6], [1.0, -1.0]
    np.testing.assert_allclose(joined.forward_dynamics(q, v, tau), moved.forward_dynamics(q, v, tau), rtol=1e-9)


def test_errors_of_files_name_the_object(tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    path.write_text('robot = "world"\n[[objects]]\nsource = "can"\nposse = [0.0, 0.0, 0.0]')
    with pytest.raises(SceneError, match=r"objects\[0\].*posse.*did you mean 'pose'"):
        tl.load_scene(path)
    path.write_text('robot = "world"\n[[objects]]\nsource = "can"\n[[objects]]\nsource = "cann"')
    with pytest.raises(SceneError, match=r"objects\[1\].*'cann'"):
        tl.load_scene(path)


@pytest.mark.parametrize("name", ["go2", "anymal"])
def test_a_quadruped_of_the_catalogue_stands_above_the_ground_with_its_own_shapes(name: str) -> None:
    """`scene_of(contact=True)`: its SRDF's state, the lowest vertex of its collision meshes 1 mm above the ground."""
    scene = tl.scene_of(name, contact=True)
    robot, standing = scene.base, scene.base.visuals.srdf.states["standing"]
    angles = {joint.name: scene.q[joint.q] for joint in robot.joints if joint.name != "root_joint"}
    assert all(angles[joint] == pytest.approx(value) for joint, value in standing.items() if joint in angles)
    heights = []
    for solid in robot.solids:
        turn, place = robot.frame_pose(scene.q, solid.link)
        points, radius = getattr(solid.shape, "vertices", ((0, 0, 0),)), getattr(solid.shape, "radius", 0.0)
        at = pin.SE3(turn, place) * solid.shape.placement
        heights += [at.act(np.array(point, dtype=float))[2] - radius for point in points]
    assert min(heights) <= 1e-3 + 1e-9
    if all(hasattr(solid.shape, "vertices") for solid in robot.solids):
        assert min(heights) == pytest.approx(1e-3, abs=1e-9)
    assert "friction 0.8 of bodies that touch" in str(scene)
    assert any(isinstance(effect, fx.Contact) for effect in scene.effects)
    assert not any(isinstance(effect, fx.Contact) for effect in tl.scene_of(name).effects)


@pytest.mark.parametrize("cache", ["", "off"])
def test_a_hull_of_points_is_filled_evenly(monkeypatch: pytest.MonkeyPatch, cache: str) -> None:
    """A tetrahedron with edges a along the axes, turned: J = m a^2 / 80 (5 1 + 1 1^T) about its centre.

    The covariance of an even tetrahedron is that of its corners, summed, times m / 20. A point within has no part.
    """
    if cache:
        monkeypatch.setenv("TWOLINK_CACHE", cache)
    a, m, rpy = 0.4, 2.0, (0.3, -0.2, 0.9)
    corners = ((0, 0, 0), (a, 0, 0), (0, a, 0), (0, 0, a), (0.1 * a,) * 3)
    robot = EMPTY.with_object(fx.Convex(corners, point=(0.1, 0.2, 0.3), rpy=rpy), mass=m).base
    turn, inertia = pin.rpy.rpyToMatrix(*rpy), robot.model.inertias[1]
    off = np.array(corners[:4]) - a / 4
    covariance = m / 20 * off.T @ off
    about_centre = np.trace(covariance) * np.eye(3) - covariance
    assert inertia.mass == m
    np.testing.assert_allclose(inertia.lever, [0.1, 0.2, 0.3] + turn @ np.full(3, a / 4), atol=1e-14)
    np.testing.assert_allclose(inertia.inertia, turn @ about_centre @ turn.T, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(about_centre, m * a**2 / 80 * (5 * np.eye(3) + np.ones((3, 3))), rtol=1e-12)


def test_a_hull_of_points_lies_on_the_ground_as_the_box_that_it_is() -> None:
    size = np.array([0.2, 0.3, 0.1])
    corners = tuple(map(tuple, (size / 2 * np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1).T).tolist()))
    ends = []
    for shape in (fx.Box(tuple(size)), fx.Convex(corners)):
        scene = EMPTY.with_object(shape, (0, 0, 0.12, 0.1, 0.05, 0, 1), mass=1.0)
        scene = scene.with_effects([*scene.effects, fx.Contact(("ground",), friction=0.5)])
        ends.append(tl.simulate(scene, 0.3, contact="stepped", step=2e-3, verify=False).q[-1])
    np.testing.assert_allclose(*ends, atol=1e-9)


def test_a_robot_without_shapes_touches_nothing() -> None:
    ball = '<mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
    urdf = f'<robot name="b"><link name="a"><inertial>{ball}</inertial></link></robot>'
    scene = tl.scene_of(tl.load_robot(urdf, root="free"), contact=True)
    assert scene.effects == (fx.Gravity(),)
    assert "no shapes collide" in str(scene.report)


MIMIC = """<robot name="{0}"><link name="{0}w"/><link name="{0}a"><inertial><origin xyz="0.3 0 0"/><mass value="1"/>
  <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="{0}b"><inertial><origin xyz="0.2 0 0"/><mass value="2"/>
  <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="{0}1" type="revolute"><parent link="{0}w"/><child link="{0}a"/><axis xyz="0 1 0"/>
  <limit lower="-3" upper="3" effort="9" velocity="9"/></joint>
  <joint name="{0}2" type="revolute"><parent link="{0}a"/><child link="{0}b"/><axis xyz="0 1 0"/>
  <limit lower="-3" upper="3" effort="9" velocity="9"/><mimic joint="{0}1" multiplier="-2" offset="0.3"/></joint>
  </robot>"""


@pytest.mark.parametrize("first_follows", [True, False])
def test_joints_follow_beside_others_only_where_they_did_alone(first_follows: bool) -> None:
    first = tl.load_robot(MIMIC.format("j"), mimic=first_follows)
    second = tl.load_robot(MIMIC.format("k"), mimic=not first_follows)
    both = tl.Scene(first).with_object(second, (0, 1, 0), name="o").base
    assert both.nq == 3
    assert "scene_of couples none" in str(both.report)
    q, v, tau = np.array([0.2, 0.3, -0.4]), np.array([0.5, -0.6, 0.7]), np.array([1.0, 2.0, -3.0])
    a = both.forward_dynamics(q, v, tau)
    alone = [one.forward_dynamics(*(x[part] for x in (q, v, tau)))
             for one, part in ((first, slice(first.nq)), (second, slice(first.nq, 3)))]  # fmt: skip
    np.testing.assert_allclose(a, np.concatenate(alone), rtol=1e-9)


SPRUNG = """<mujoco><worldbody><body name="p" gravcomp="0.4"><joint name="h" axis="0 1 0" stiffness="7" springref="10"
  range="-60 60"/><geom size=".1" pos=".3 0 0"/>
  <body name="r" pos=".5 0 0"><joint name="e" axis="0 1 0" stiffness="2"/><geom size=".08" pos=".2 0 0"/></body></body>
  <body name="s" pos="0 1 0"><joint name="f" axis="0 1 0"/><geom size=".1" pos=".2 0 0"/></body></worldbody>
  <equality><joint joint1="f" joint2="h" polycoef="0.1 0.5 0 0 0"/></equality></mujoco>"""


def test_a_joined_part_keeps_the_laws_of_its_file_and_what_its_report_says() -> None:
    """Springs, loops and gravity compensation act on it beside another one as they do alone."""
    pytest.importorskip("mujoco")
    alone = tl.load_robot(SPRUNG)
    both = tl.Scene(alone).with_object(alone, (0.5, 2, 1), name="o").base
    assert [type(effect).__name__ for effect in tl.scene_of(both).effects].count("JointSpring") == 2
    assert "o: options of MuJoCo's simulation" in str(both.report)
    run, twice = (tl.simulate(tl.scene_of(robot), 0.5, accuracy=1e-9) for robot in (alone, both))
    assert np.abs(run.q[-1] - run.q[0]).max() > 0.1
    np.testing.assert_allclose(twice.q[-1], np.tile(run.q[-1], 2), atol=1e-7)


def test_a_weight_is_compensated_under_the_gravity_of_the_whole() -> None:
    """It is as for MuJoCo with that gravity, alone and joined to a robot on the moon."""
    mujoco, moon = pytest.importorskip("mujoco"), (0.3, 0.0, -1.6)
    model = mujoco.MjModel.from_xml_string(SPRUNG)
    model.opt.gravity[:] = moon
    model.opt.disableflags = mujoco.mjtDisableBit.mjDSBL_EQUALITY
    state = mujoco.MjData(model)
    mujoco.mj_forward(model, state)
    alone = tl.load_robot(SPRUNG, gravity=moon)
    joined = tl.Scene(tl.load_robot("two_link", gravity=moon)).with_object(tl.load_robot(SPRUNG), name="o").base
    for robot in (alone, joined):
        effects = [effect for effect in tl.scene_of(robot).effects if not isinstance(effect, fx.Coupling)]
        run = tl.simulate(tl.Scene(robot, effects=effects), 1e-3)
        dofs = [robot.joint_names.index(name) for name in "hef"]  # in MuJoCo's order
        np.testing.assert_allclose(run.acceleration[0, dofs], state.qacc, atol=1e-9)


@pytest.mark.parametrize("name", ["ball", "zebra"])
def test_what_falls_is_named_wherever_its_joint_stands(name: str) -> None:
    scene = tl.Scene(tl.load_robot("two_link"), effects=[fx.Gravity()]).with_object("ball", (3.0, 0.0, 0.5), name=name)
    assert [f"joint '{name}' is free and touches nothing" in note for note in fall_notes(scene)] == [True]
