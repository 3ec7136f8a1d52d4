"""Logs with the names and conventions of other programs are read as what they are, and it is said."""

from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest

import twolink as tl
from tests.urdf_text import joint, link
from twolink.errors import QueryError
from twolink.robots.joint_layout import read_columns
from twolink.robots.log_columns import in_our_names, joint_order

N = 5
RANDOM = np.random.default_rng(0)
# Children whose names have another order than they have in the file, on a free base; a ball joint.
BRANCHED = """<mujoco><option integrator="RK4" timestep="0.0002"/><worldbody><body name="base"><freejoint name="base"/>
<geom size=".2"/><body name="z" pos=".2 0 0"><joint name="zj" axis="0 1 0"/><geom size=".1" pos=".3 0 0"/>
<body name="y" pos=".4 0 0"><joint name="yj" axis="0 0 1"/><geom size=".1" pos=".1 0 0"/></body></body>
<body name="a" pos="0 .2 0"><joint name="aj" type="ball"/><geom type="box" size=".1 .2 .05" pos="0 .3 0"/></body>
</body></worldbody></mujoco>"""


@pytest.fixture
def branched(tmp_path: Path) -> Path:
    path = tmp_path / "branched.xml"
    path.write_text(BRANCHED)
    return path


@pytest.mark.parts
def test_a_log_of_mujoco_is_read_in_its_order_and_conventions(branched: Path, tmp_path: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(branched))
    data, rows = mujoco.MjData(model), []
    data.qvel[:] = RANDOM.uniform(-1, 1, model.nv)
    for k in range(1001):
        if k % 50 == 0:
            rows.append((data.time, data.qpos.copy(), data.qvel.copy()))
        mujoco.mj_step(model, data)
    np.savez(tmp_path / "log.npz", time=[r[0] for r in rows], qpos=[r[1] for r in rows], qvel=[r[2] for r in rows])
    verdict = tl.judge(branched, tmp_path / "log.npz")
    assert verdict.right, str(verdict)
    assert "qpos as q, in MuJoCo's order and conventions" in str(verdict)


def test_the_orders_of_other_programs(branched: Path) -> None:
    robot = tl.load_robot(branched)
    assert robot.joint_names == ("base", "aj", "zj", "yj")
    assert joint_order(robot) == ["base", "zj", "yj", "aj"]
    assert joint_order(robot, breadth=True) == ["base", "zj", "aj", "yj"]


def test_a_matrix_of_a_free_body_without_known_conventions_is_refused(branched: Path) -> None:
    robot = tl.load_robot(branched)
    with pytest.raises(QueryError, match="conventions"):
        in_our_names({"t": np.arange(N), "joint_q": np.zeros((N, robot.nq))}, robot)
    with pytest.raises(QueryError, match="this robot 13 in MuJoCo"):
        in_our_names({"t": np.arange(N), "qpos": np.zeros((N, 9))}, robot)


Q, V = RANDOM.normal(size=(N, 2)), RANDOM.normal(size=(N, 2))
TABLES = {
    "matrices with names": {"timestamp": np.arange(N), "joint_pos": Q[:, ::-1], "joint_vel": V[:, ::-1],
                            "joint_names": np.array(["elbow", "shoulder"])},
    "names before": {"sim_time": np.arange(N), "pos_shoulder": Q[:, 0], "pos_elbow": Q[:, 1],
                     "dq/shoulder": V[:, 0], "dq/elbow": V[:, 1]},
    "names behind": {"time": np.arange(N), "shoulder.pos": Q[:, 0], "elbow.pos": Q[:, 1],
                     "Shoulder Velocity": V[:, 0], "Elbow Velocity": V[:, 1]},
    "numbers": {"t": np.arange(N), "qpos[0]": Q[:, 0], "qpos[1]": Q[:, 1], "qvel_0": V[:, 0], "qvel_1": V[:, 1]},
    "from one": {"t": np.arange(N), "q1": Q[:, 0], "q2": Q[:, 1], "v1": V[:, 0], "v2": V[:, 1]},
    "joints alone": {"t": np.arange(N), "elbow": Q[:, 1], "shoulder": Q[:, 0], "qd0": V[:, 0], "qd1": V[:, 1]},
    "more columns": {"t": np.arange(N), "joint_pos": np.column_stack([Q, Q]), "dof_vel": V,
                     "names": np.array(["shoulder", "elbow", "finger", "thumb"])},
}  # fmt: skip


@pytest.mark.parametrize("name", TABLES)
def test_columns_are_found_by_their_names(name: str) -> None:
    robot = tl.load_robot("two_link")
    found, guessed = in_our_names(TABLES[name], robot)
    for letter, values in (("q", Q), ("v", V)):
        for k, name in enumerate(robot.joint_names):
            column = found[f"{letter}.{name}"] if f"{letter}.{name}" in found else found[letter][:, k]
            np.testing.assert_array_equal(column, values[:, k])
    assert guessed
    assert "t" in found or "time" in found


def test_a_free_body_with_a_continuous_joint_is_read_as_mujoco_has_it() -> None:
    """The velocity of the base turns with its quaternion, and q has the cosine and sine of the joint's angle."""
    parts = link("base"), link("upper"), joint("axis", "continuous", "base", "upper")
    robot = tl.load_robot(f'<robot name="r">{"".join(parts)}</robot>', root="free")
    q, v = np.asarray(robot.normalize(RANDOM.normal(size=robot.nq))), RANDOM.normal(size=robot.nv)
    x, y, z, w = q[3:7]
    turn = pin.Quaternion(np.array([x, y, z, w])).matrix()
    qpos = np.concatenate([q[:3], [w, x, y, z], [np.arctan2(q[8], q[7])]])
    qvel = np.concatenate([turn @ v[:3], v[3:]])
    table = in_our_names({"t": np.arange(N), "qpos": np.tile(qpos, (N, 1)), "qvel": np.tile(qvel, (N, 1))}, robot)[0]
    np.testing.assert_allclose(read_columns(table, robot.joints, "q")[0], np.tile(q, (N, 1)), rtol=0, atol=1e-14)
    np.testing.assert_allclose(table["v"], np.tile(v, (N, 1)), rtol=0, atol=1e-14)


def test_our_own_names_stay_and_others_are_left_alone() -> None:
    robot, own = tl.load_robot("two_link"), {"t": np.arange(N), "q0": Q[:, 0], "q1": Q[:, 1], "pos": Q, "camera": Q}
    assert in_our_names(own, robot) == (own, ())
    numbered = {"t": np.arange(N), **{f"q{k + 1}": Q[:, 0] for k in range(7)}}  # of seven joints: which two are it?
    assert in_our_names(numbered, robot) == (numbered, ())


def test_several_episodes_are_refused() -> None:
    with pytest.raises(QueryError, match="2 episodes"):
        in_our_names({"timestamp": np.arange(N), "episode_index": np.arange(N) > 2}, tl.load_robot("two_link"))


def test_two_columns_of_one_name_are_none() -> None:
    robot = tl.load_robot("two_link")
    table = {"t": np.arange(N), "elbow_pos": Q[:, 1], "elbow.pos": Q[:, 0], "shoulder_pos": Q[:, 0]}
    assert in_our_names(table, robot) == (table, ())


@pytest.mark.parts
def test_columns_of_other_lengths_are_refused_by_name() -> None:
    table = {"t": np.arange(N), "q.shoulder": Q[:, 0], "q.elbow": Q[:, :1], "v.shoulder": V[:, 0], "v.elbow": V[:2, 1]}
    robot = tl.load_robot("two_link")
    assert np.array_equal(read_columns(table, robot.joints, "q")[0], Q[:, [0, 0]])
    for call in (lambda: tl.judge(robot, table), lambda: tl.identify(robot, table)):
        with pytest.raises(QueryError, match=r"'v\.shoulder' and 'v\.elbow' are not equally long"):
            call()


@pytest.mark.parts
def test_logs_of_one_joint_may_have_columns_q_v_and_tau() -> None:
    """A pendulum's log is judged right, and its driving torques give its first moment back."""
    robot = tl.load_robot("friction_pendulum")
    drive = tl.effects.Torque({"axle": tl.effects.Sine(2.0, 0.7)})
    scene = tl.Scene(robot, q=[1.0], effects=[tl.effects.Gravity(), drive], duration=4.0)
    run = tl.simulate(scene)
    log = {"t": run.t, "q": run.q[:, 0], "v": run.v[:, 0], "tau": run.tau[:, 0]}
    assert tl.judge(scene, log).answer == "right"
    moment = tl.identify(robot, log).values["pendulum.first_moment.z"]
    assert moment == pytest.approx(-0.5, abs=1e-5)  # 1 kg at 0.5 m
