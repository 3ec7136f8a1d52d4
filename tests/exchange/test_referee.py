"""The referee: right trajectories are right, wrong ones are explained."""

import json
from pathlib import Path

import numpy as np
import pytest

import twolink as tl
from tests.exchange.simulators import Log, exact, law_of, stepped
from tests.exchange.urdf_edits import plain_urdf, text

fx = tl.effects


def damped(name: str, damping: float = 0.3, start: float = 0.4) -> tl.Scene:
    robot = tl.load_robot(name)
    effects = [fx.Gravity(), fx.JointDamping(dict.fromkeys(robot.joint_names, damping))]
    return tl.Scene(robot, q=np.full(robot.nq, start), effects=effects, duration=2.0)


ARM = damped("two_link")


@pytest.mark.some(2)
@pytest.mark.parametrize("name", ["two_link", "ur5", "z1", "finger_edu", "xarm7"])
@pytest.mark.parametrize("start", [0.2, *(pytest.param(x, marks=pytest.mark.slow) for x in (0.4, 0.7))])
def test_right_trajectories_are_right(name: str, start: float) -> None:
    scene = damped(name, start=start)
    verdict = tl.judge(scene, exact(scene, law_of(scene.robot, 0.3), 1.0, 0.01))
    assert verdict.right, str(verdict)
    assert verdict.causes == ()
    assert verdict.defect < 1e-6
    assert verdict.beyond == {}


def blamed(log: Log, scene: tl.Scene = ARM) -> str:
    verdict = tl.judge(scene, log)
    assert not verdict.right
    assert verdict.causes, str(verdict)
    return verdict.causes[0].what


LAW = law_of(ARM.robot, 0.3)
RIGHT = exact(ARM, LAW, 2.0, 0.01)


@pytest.mark.slow
def test_steps_that_are_too_long_are_named() -> None:
    assert blamed(stepped(ARM, LAW, 2.0, 0.01, 0.002)) == "semi-implicit Euler with steps of 2 ms"
    assert blamed(stepped(ARM, LAW, 2.0, 0.01, 0.01, "rk4")) == "Runge-Kutta of order 4 with steps of 10 ms"


@pytest.mark.slow
def test_what_is_left_out_is_named() -> None:
    assert blamed(exact(ARM, law_of(ARM.robot), 2.0, 0.01)) == "damping is left out"
    floating = law_of(ARM.robot.with_gravity([0, 0, 0]), 0.3)
    assert blamed(exact(ARM, floating, 2.0, 0.01)) == "gravity is left out"
    assert blamed(stepped(ARM, law_of(ARM.robot), 2.0, 0.01, 0.002)) == (
        "semi-implicit Euler with steps of 2 ms, and damping is left out"
    )


def test_friction_that_is_left_out_is_named() -> None:
    robot = tl.load_robot("two_link")
    scene = tl.Scene(robot, q=[0.4, 0.4], effects=[fx.Gravity(), fx.DryFriction(dict.fromkeys(robot.joint_names, 0.5))])
    assert blamed(exact(scene, law_of(scene.robot), 1.0, 0.005), scene) == "friction is left out"
    assert tl.judge(scene, tl.simulate(scene, 1.0, accuracy=1e-9)).right


@pytest.mark.slow
def test_other_numbers_are_fitted() -> None:
    moon = blamed(exact(ARM, law_of(ARM.robot.with_gravity([0, 0, -1.62]), 0.3), 2.0, 0.005))
    assert moon.startswith("gravity differs")
    assert "z +8.2" in moon or "z +8.1" in moon
    assert "damping differs" in blamed(exact(ARM, law_of(ARM.robot, 0.5), 2.0, 0.005))

    def change(model: object) -> None:
        body = model.inertias[2].copy()
        body.mass = 1.3 * body.mass
        model.inertias[2] = body

    scene = damped("ur5")
    heavy = law_of(scene.robot.changed(change), 0.3)
    assert "upper_arm_link" in blamed(exact(scene, heavy, 2.0, 0.005), scene)


@pytest.mark.slow
def test_delays_starts_and_units_are_named() -> None:
    t, q, v = RIGHT
    assert blamed((t + 0.05, q, v)) == "it is late by 0.05 s"
    assert blamed((t[5:] - 0.05, q[5:], v[5:])) == "it is early by 0.05 s"
    assert blamed((t[1:], q[1:], v[:-1])) == "v is that of the sample before"
    assert blamed((1e3 * t, q, v)) == "t is in milliseconds"
    assert blamed((t, np.rad2deg(q), np.rad2deg(v))) == "q and v are in degrees"
    assert blamed((t, q, np.rad2deg(v))) == "v is in degrees per second"
    assert blamed((t, np.rad2deg(q), v)) == "q is in degrees"
    other = tl.Scene(ARM.base, [0.5, 0.4], [0.0, 0.0], ARM.effects)
    assert blamed(exact(other, LAW, 2.0, 0.01)).startswith("it starts elsewhere, q by 0.1")


def test_a_run_beyond_its_stops_is_told() -> None:
    robot = tl.load_robot("two_link")
    scene = tl.Scene(robot, q=[0.4, 0.4], effects=[fx.Gravity(), fx.JointStops({"shoulder": (0.0, 1.0)})])
    verdict = tl.judge(scene, exact(scene, law_of(scene.robot), 1.0, 0.01))
    assert not verdict.right
    assert verdict.constraints["stop of shoulder"] > 0.1
    assert tl.judge(scene, tl.simulate(scene, 1.0, accuracy=1e-9)).right


@pytest.mark.slow
@pytest.mark.parametrize("name", ["pendulum-friction", "four-bar", "panda-hold"])
def test_our_own_runs_of_bundled_scenes_are_right(name: str) -> None:
    scene = tl.load_scene(name)
    end = min(scene.duration, 1.0)
    verdict = tl.judge(scene, tl.simulate(scene, end, accuracy=1e-9))
    assert verdict.right, str(verdict)
    assert max(verdict.constraints.values(), default=0.0) < 1e-7


@pytest.mark.slow
def test_files_data_and_figures(tmp_path: Path) -> None:
    t, q, v = stepped(ARM, LAW, 1.0, 0.01, 0.01)
    table = np.column_stack([t, q, v])
    np.savetxt(tmp_path / "log.csv", table, "%.17g", ",", header="t,q0,q1,v0,v1", comments="")
    np.savez(tmp_path / "log.npz", t=t, q=q, v=v)
    verdicts = [
        tl.judge(ARM, given) for given in (tmp_path / "log.csv", tmp_path / "log.npz", {"t": t, "q": q, "v": v})
    ]
    assert len({str(verdict) for verdict in verdicts}) == 1
    record = json.loads(verdicts[0].save(tmp_path / "v.json").read_text())
    assert record["right"] is False
    assert record["causes"][0]["what"] == "semi-implicit Euler with steps of 10 ms"
    assert "WRONG" in verdicts[0].summary
    assert verdicts[0].plot(tmp_path / "v.png").is_file()


def test_angles_of_continuous_joints_may_be_given() -> None:
    robot = tl.load_robot("double_pendulum_continuous")
    scene = tl.Scene(robot, q={robot.joint_names[0]: 0.5}, effects=[fx.Gravity()])
    run = tl.simulate(scene, 0.5, accuracy=1e-9)
    angles = np.arctan2(run.q[:, 1::2], run.q[:, ::2])
    assert tl.judge(scene, (run.t, angles, run.v)).right


@pytest.mark.parametrize("given", [
    ([0, 1], [[0, 0]] * 2, [[0, 0]] * 2), ([0, 1, 1], [[0, 0]] * 3, [[0, 0]] * 3),
    ([0, 1, 2], [[0]] * 3, [[0, 0]] * 3), ([0, 1, 2], [[0, np.nan]] * 3, [[0, 0]] * 3), {"t": [0, 1, 2]},
])  # fmt: skip
def test_what_is_no_trajectory_is_refused(given: object) -> None:
    with pytest.raises(tl.errors.SceneError) as failure:
        tl.judge(ARM, given)
    assert failure.value.code == "not-a-trajectory"


@pytest.mark.slow
def test_mujoco_is_judged() -> None:
    mujoco = pytest.importorskip("mujoco")
    robot = tl.load_robot("ur5")
    model = mujoco.MjModel.from_xml_string(text(plain_urdf("ur5")))
    model.opt.timestep, data = 0.002, mujoco.MjData(model)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    scene = tl.Scene(robot, q=np.full(6, 0.4), effects=[fx.Gravity()])
    data.qpos[:] = scene.q
    rows = [(0.0, scene.q, scene.v)]
    for _ in range(500):
        mujoco.mj_step(model, data)
        rows.append((data.time, data.qpos.copy(), data.qvel.copy()))
    verdict = tl.judge(scene, tuple(np.array(x) for x in zip(*rows, strict=True)))
    assert not verdict.right
    assert verdict.causes[0].what == "semi-implicit Euler with steps of 2 ms"
    assert verdict.beyond["0.0001"] < verdict.beyond["0.001"]
