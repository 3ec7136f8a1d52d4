"""Bags of ROS 2: what others' libraries read in them, and what is read back, also from bags of other programs."""

import dataclasses
import json
from pathlib import Path
from typing import Literal
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

import twolink as tl
from tests.command import answer
from tests.near import assert_near
from tests.refusals import refusal
from tests.urdf_text import joint, link, robot_of
from twolink import effects as fx
from twolink.errors import SceneError, TwolinkError
from twolink.io.bags import message, stamp
from twolink.simulation.recording import _wrenches

TYPES = get_typestore(Stores.ROS2_HUMBLE)
CLOCK = 1_763_900_000_123_456_789  # ns


def motion(name: str, root: Literal["fixed", "free"]) -> tl.Trajectory:
    """A robot that falls from a state without symmetry, turning."""
    robot = tl.load_robot(name, root=root)
    q = robot.integrate(robot.neutral, np.linspace(0.3, 0.9, robot.nv))
    return tl.simulate(tl.Scene(robot, q, np.linspace(4, 9, robot.nv), [fx.Gravity()]), 0.5, samples_per_second=50)


@pytest.fixture(
    scope="module", params=[("kinova", "fixed"), ("spinning_box", "free"), ("solo8", "free"), ("pr2", "fixed")], ids=str
)
def run(request: pytest.FixtureRequest) -> tl.Trajectory:
    return motion(*request.param)


def contents(path: Path) -> dict[str, list]:
    """(schema, time in ns, message) by topic, read by the library of MCAP and its decoder alone."""
    found: dict[str, list] = {}
    with path.open("rb") as file:
        for schema, channel, one, decoded in make_reader(file, True, [DecoderFactory()]).iter_decoded_messages():
            assert (schema.encoding, channel.message_encoding) == ("ros2msg", "cdr")
            found.setdefault(channel.topic, []).append((schema.name, one.log_time, decoded))
    return found


@pytest.mark.some(1)
@pytest.mark.parametrize("suffix", [".mcap", ".db3"])
def test_saved_and_loaded_is_the_same(run: tl.Trajectory, suffix: str, tmp_path: Path) -> None:
    again = tl.Trajectory.load(run.save(tmp_path / "deep" / f"x{suffix}"))
    assert_near(again.t, run.t, 0.5e-9)
    assert_near(again.q, run.q, 1e-14)  # continuous joints go through their angles
    for name in ("v", "energy", "error"):
        np.testing.assert_array_equal(getattr(again, name), getattr(run, name))
    assert (again.robot.name, again.title, again.bound) == (run.robot.name, run.title, run.bound)


@pytest.mark.some(1)
def test_the_library_of_mcap_reads_it(run: tl.Trajectory, tmp_path: Path) -> None:
    topics, robot = contents(run.save(tmp_path / "x.mcap")), run.robot
    named = {topic: rows[0][0] for topic, rows in topics.items()}
    assert named["/tf"] == "tf2_msgs/msg/TFMessage"
    assert named["/robot_description"] == "std_msgs/msg/String"
    assert ElementTree.fromstring(topics["/robot_description"][0][2].data).tag == "robot"
    assert [decoded.data for _, _, decoded in topics["/error_bar"]] == run.error.tolist()
    k = 17
    for transform in topics["/tf"][k][2].transforms:
        rotation, position = robot.frame_pose(run.q[k], transform.child_frame_id)
        assert_near([getattr(transform.transform.translation, x) for x in "xyz"], position, 1e-12)
        quaternion = [getattr(transform.transform.rotation, x) for x in "xyzw"]
        assert_near(Rotation.from_quat(quaternion).as_matrix(), rotation, 1e-12)
    assert {t.child_frame_id for t in topics["/tf"][k][2].transforms} == set(robot.frame_names)
    single = [joint for joint in robot.joints if joint.kind in ("vector", "cos-sin")]
    if single:
        assert named["/joint_states"] == "sensor_msgs/msg/JointState"
        _, at, decoded = topics["/joint_states"][k]
        assert at == decoded.header.stamp.sec * 10**9 + decoded.header.stamp.nanosec == round(run.t[k] * 1e9)
        assert list(decoded.name) == [joint.name for joint in single]
        np.testing.assert_array_equal(decoded.velocity, run.v[k, [joint.v.start for joint in single]])
        np.testing.assert_allclose(decoded.effort, run.tau[k, [joint.v.start for joint in single]])


@pytest.mark.slow
def test_angles_of_continuous_joints_go_on_beyond_a_turn(tmp_path: Path) -> None:
    robot = tl.load_robot("double_pendulum_continuous")
    run = tl.simulate(tl.Scene(robot, robot.neutral, [9.0, 0.0], [fx.JointDamping({robot.joint_names[0]: 0.0})]), 3.0)
    rows = contents(run.save(tmp_path / "x.mcap"))["/joint_states"]
    angles = np.array([decoded.position for _, _, decoded in rows])
    assert angles[-1, 0] > 2 * np.pi
    speeds = np.array([decoded.velocity for _, _, decoded in rows])
    steps = 0.5 * (speeds[1:] + speeds[:-1]) * np.diff(run.t)[:, None]
    assert_near(np.diff(angles, axis=0), steps, 2e-3)


def test_turns_between_few_samples_are_those_of_the_speed(tmp_path: Path) -> None:
    """A wheel at 20 rad/s, ten seconds from sample to sample: in a bag, and in the figures of a run and of worlds."""
    text = robot_of(link("rotor", 1.0, 0.1), joint("axle", "continuous", "ground", "rotor", "0 0 1"))
    scene = tl.Scene(tl.load_robot(text), v=[20.0])
    run = tl.simulate(scene, 100.0, t_eval=np.linspace(0.0, 100.0, 11))
    rows = contents(run.save(tmp_path / "x.mcap"))["/joint_states"]
    assert [decoded.position[0] for _, _, decoded in rows] == pytest.approx(20.0 * run.t)
    line = run.plot().axes[0].get_lines()[0]
    assert line.get_ydata() == pytest.approx(20.0 * line.get_xdata())
    worlds = tl.simulate_many(scene, 100.0, v=[[20.0], [-30.0]], t_eval=run.t)
    curves = worlds.plot().axes[0].collections[0].get_segments()
    assert [curve[-1, 1] for curve in curves] == pytest.approx([2000.0, -3000.0])


def test_events_after_the_last_sample_are_in_the_bag(tmp_path: Path) -> None:
    effects = [fx.Gravity(), fx.JointStops({"elbow": (-0.2, 1.0)}, restitution=0.6)]
    run = tl.simulate(tl.Scene(tl.load_robot("two_link"), [1.2, 0.5], effects=effects), 0.8, t_eval=[0.0, 0.1])
    seen = [round(at * 1e-9, 6) for _, at, _ in contents(run.save(tmp_path / "x.mcap"))["/rosout"]]
    assert seen == [round(event.t, 6) for event in run.events] != []


@pytest.mark.slow
def test_a_contact_is_a_wrench_about_the_origin(tmp_path: Path) -> None:
    scene = tl.load_scene("bowl")
    run = tl.simulate(scene, samples_per_second=50)
    topics = contents(run.save(tmp_path / "x.mcap"))
    (name, (points, forces)), *_ = run.contacts.items()
    rows = next(rows for topic, rows in topics.items() if topic.startswith("/contacts/"))
    for k, (schema, _, decoded) in enumerate(rows):
        assert schema == "geometry_msgs/msg/WrenchStamped"
        touching = ~np.isnan(forces[k, :, 0])
        force = [getattr(decoded.wrench.force, x) for x in "xyz"]
        assert_near(force, run.contact_forces[name][k], 1e-12)
        moment = sum(
            (np.cross(p, f) for p, f in zip(points[k, touching], forces[k, touching], strict=True)), np.zeros(3)
        )
        assert_near([getattr(decoded.wrench.torque, x) for x in "xyz"], moment, 1e-9)
    assert max(abs(decoded.wrench.force.z) for _, _, decoded in rows) > 0
    assert [(e.name, round(t * 1e-9, 6)) for _, t, e in topics.get("/rosout", [])] == [
        (event.kind, round(event.t, 6)) for event in run.events]  # fmt: skip


def foreign(folder: Path, run: tl.Trajectory, topics: dict[str, list[str]], start: int = CLOCK) -> Path:
    """A bag as another program records it: by topic some joints in any order, with stamps of a clock."""
    robot, columns = run.robot, {j.name: j.v.start for j in run.robot.joints}
    with Writer(folder, version=8, storage_plugin=StoragePlugin.SQLITE3) as bag:
        for topic, names in topics.items():
            connection = bag.add_connection(topic, "sensor_msgs/msg/JointState", typestore=TYPES)
            for k, t in enumerate(run.t):
                order = names if k % 2 else names[::-1]
                position, velocity = (
                    [x[k, columns[n]] if n in columns else 7.0 for n in order] for x in (run.q, run.v)
                )
                header = message("std_msgs/msg/Header", stamp(start + round(t * 1e9)), "base")
                one = message("sensor_msgs/msg/JointState", header, order, np.array(position), np.array(velocity),
                              np.empty(0))  # fmt: skip
                raw = TYPES.serialize_cdr(one, "sensor_msgs/msg/JointState")
                bag.write(connection, start + round(t * 1e9) + 12_000_000, raw)
    assert robot.nv == len(run.v[0])
    return folder


@pytest.fixture(scope="module")
def arm() -> tl.Trajectory:
    return tl.simulate(tl.load_scene("arm-swing"), 1.0)


@pytest.mark.parts
@pytest.mark.some(1)
@pytest.mark.parametrize("start", [CLOCK, 0])
def test_the_bag_of_another_program_is_judged(arm: tl.Trajectory, start: int, tmp_path: Path) -> None:
    bag = foreign(tmp_path / "bag", arm, {"/joint_states": ["gripper", "elbow", "shoulder"], "/other": ["x"]}, start)
    scene = tl.load_scene("arm-swing")
    assert tl.judge(scene, bag).right
    assert tl.judge(scene, next(bag.glob("*.db3"))).right
    again = tl.Trajectory.load(bag, arm.robot)
    assert_near(again.energy, arm.energy, 1e-9)
    np.testing.assert_array_equal(again.v, arm.v)
    late = tl.judge(scene, {"t": again.t[:-4], "q": again.q[4:], "v": again.v[4:]})
    assert not late.right


@pytest.mark.parts
@pytest.mark.some(1)
@pytest.mark.parametrize(
    ("topics", "part"),
    [
        ({"/left": ["elbow"], "/right": ["shoulder"]}, "several such topics: /left, /right"),
        ({}, "no sensor_msgs/msg/JointState"),
    ],
)
def test_bags_without_joint_states_of_one_robot(
    arm: tl.Trajectory, topics: dict[str, list[str]], part: str, tmp_path: Path
) -> None:
    with refusal(TwolinkError, code="no-joint-states", match=part):
        tl.judge(tl.load_scene("arm-swing"), foreign(tmp_path / "bag", arm, topics))


@pytest.mark.parts
def test_joints_that_lack_are_named(arm: tl.Trajectory, tmp_path: Path) -> None:
    bag = foreign(tmp_path / "bag", arm, {"/joint_states": ["elbow"]})
    with pytest.raises(SceneError, match=r"column 'q.shoulder' is not in it"):
        tl.Trajectory.load(bag, arm.robot)
    with refusal(SceneError, code="not-a-trajectory", match="expected q"):
        tl.judge(tl.load_scene("arm-swing"), bag)


def test_what_is_no_bag(arm: tl.Trajectory, tmp_path: Path) -> None:
    whole = arm.save(tmp_path / "x.mcap").read_bytes()
    for name, content in (("short.mcap", whole[:2000]), ("text.mcap", b"t,q0\n0,1\n"), ("empty.db3", b"")):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(TwolinkError) as caught:
            tl.Trajectory.load(tmp_path / name)
        assert caught.value.code in ("not-readable", "no-joint-states"), name
    (tmp_path / "folder").mkdir()
    with pytest.raises(TwolinkError, match="cannot be read"):
        tl.Trajectory.load(tmp_path / "folder")


def test_joints_and_times_without_a_place_in_a_bag(tmp_path: Path) -> None:
    ball = '<body name="b"><joint name="j" type="ball"/><geom size="0.1"/></body>'
    robot = tl.load_robot(f"<mujoco><worldbody>{ball}</worldbody></mujoco>")
    run = tl.Trajectory(robot, np.array([0.0, 1.0]), robot.neutral[None] * [[1], [1]], np.zeros((2, 3)), None, None)
    with refusal(SceneError, code="not-in-format", match="quaternion joint"):
        run.save(tmp_path / "x.mcap")
    two, zero = tl.load_robot("two_link"), np.zeros((2, 2))
    with pytest.raises(SceneError, match="closer than a nanosecond"):
        tl.Trajectory(two, np.array([0.0, 1e-10]), zero, zero, None, None).save(tmp_path / "x.mcap")
    assert list(tmp_path.iterdir()) == []


def test_notes_are_in_the_file_and_the_bag_of_another_robot_is_refused(arm: tl.Trajectory, tmp_path: Path) -> None:
    path = arm.save(tmp_path / "x.mcap")
    assert json.loads(contents(path)["/twolink"][0][2].data)["robot"] == "two_link"
    with pytest.raises(SceneError, match="nq = 2"):
        tl.Trajectory.load(path, tl.load_robot("panda"))


@pytest.mark.parts
@pytest.mark.slow
def test_parameters_are_found_from_a_bag(tmp_path: Path) -> None:
    path = tl.simulate(tl.load_scene("swing-up"), 2.0, samples_per_second=500).save(tmp_path / "x.mcap")
    found = {entry["parameter"]: entry["value"] for entry in answer("identify", "two_link", str(path))["found"]}
    body = tl.load_robot("two_link").model.inertias[2]
    assert found["forearm.first_moment.x"] == pytest.approx(body.mass * body.lever[0], rel=1e-6)


def test_a_loaded_run_keeps_its_torques_in_a_bag(tmp_path: Path) -> None:
    """Efforts are the torques that the motion takes, by Pinocchio."""
    arm = tl.load_robot("two_link")
    effects = [fx.Gravity(), fx.JointPD({"elbow": 0.2}, {"elbow": 30.0}, {"elbow": 2.0})]
    run = tl.simulate(tl.Scene(arm, q=[1.2, 0.5], effects=effects, duration=0.2), samples_per_second=20)
    read = tl.Trajectory.load(run.save(tmp_path / "a.npz"), arm)
    rows = contents(read.save(tmp_path / "a.mcap"))["/joint_states"]
    taken = [pin.rnea(arm.model, arm.model.createData(), *state)
             for state in zip(run.q, run.v, run.acceleration, strict=True)]  # fmt: skip
    assert_near([decoded.effort for _, _, decoded in rows], taken, 1e-9)
    bare = contents(dataclasses.replace(read, recorded_tau=None).save(tmp_path / "b.mcap"))["/joint_states"]
    assert not any(len(decoded.effort) for _, _, decoded in bare)


def test_wrenches_of_effects_move_the_robot_as_they_do(tmp_path: Path) -> None:
    """Their moments about the world's origin give the joint torques that the motion takes, also when read again."""
    arm = tl.load_robot("two_link")
    pressing = fx.CompliantContact("forearm", 2000.0, 0.2, friction=0.5, patch=0.02, rolling=0.01, radius=0.3,
                                   height=0.65)  # fmt: skip
    effects = [pressing, fx.FrameWrench("forearm", moment=(0.0, 5.0, 0.0)),
               fx.FrameWrench("forearm", force=(0.0, 0.0, 2.0), moment=(0.0, 5.0, 0.0), axes="frame",
                              point=(0.3, 0.0, 0.0))]  # fmt: skip
    run = tl.simulate(tl.Scene(arm, q=[1.2, 0.5], v=[0.4, 2.0], effects=effects, duration=0.2), samples_per_second=20)
    read = tl.Trajectory.load(run.save(tmp_path / "a.npz"), arm)
    for one in (run, read):
        found = _wrenches(one, {})
        assert sorted(found) == ["/forces/compliant_contact_on_forearm", "/forces/frame_wrench_on_forearm"]
        wrench = sum(found.values())
        model, data = run.robot.model, run.robot.model.createData()
        for k, q in enumerate(run.q):
            rows = pin.computeFrameJacobian(model, data, q, model.getFrameId("forearm"), pin.LOCAL_WORLD_ALIGNED)
            moment = wrench[k, 3:] - np.cross(arm.frame_pose(q, "forearm")[1], wrench[k, :3])
            taken = pin.rnea(model, data, q, run.v[k], run.acceleration[k])
            assert_near(rows.T @ np.append(wrench[k, :3], moment), taken, 1e-9)
    assert np.abs(found["/forces/compliant_contact_on_forearm"]).max() > 1.0
