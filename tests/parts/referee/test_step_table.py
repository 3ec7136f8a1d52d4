"""step_table: errors of MuJoCo's steps against exact motions, by the file's own options first."""

import json
from pathlib import Path

import numpy as np
import pytest

import twolink as tl
from tests.command import answer
from tests.urdf_text import joint, link
from tests.urdf_text import robot_of as robot_text
from twolink import effects as fx
from twolink.errors import SceneError

LENGTH, MASS, G = 0.5, 2.0, 9.81
PENDULUM = f"""<mujoco><option timestep="{{step}}" integrator="{{integrator}}"/>
<worldbody><body name="bob"><joint name="hinge" axis="0 1 0"/>
<inertial pos="0 0 -{LENGTH}" mass="{MASS}" diaginertia="1e-3 1e-3 1e-3"/></body></worldbody></mujoco>"""


def pendulum(step: float = 0.002, integrator: str = "Euler") -> tl.Robot:
    return tl.load_robot(PENDULUM.format(step=step, integrator=integrator))


def small(angle: float = 1e-4) -> tl.Scene:
    return tl.Scene(pendulum(), q=[angle], effects=[fx.Gravity()], duration=2.0)


def test_a_free_base_without_ground_is_said_to_fall() -> None:
    box = """<mujoco><worldbody><body name="box"><freejoint/>
    <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body></worldbody></mujoco>"""
    scene = tl.Scene(tl.load_robot(box), effects=[fx.Gravity()], duration=0.1)
    found = str(tl.step_table(scene, methods=["Euler"], steps=[0.01]))
    assert found.count("is free and touches nothing") == 1
    assert "is free and touches nothing" in str(tl.explain(scene))
    ground = fx.Contact(("ground",), shapes={"box": (fx.Box((1, 1, 1)),)})
    for effects in ([fx.Gravity(), ground], []):
        assert "touches nothing" not in str(tl.explain(scene.with_effects(effects)))


def test_the_error_of_a_step_is_that_of_the_exact_recursion() -> None:
    """Semi-implicit Euler of q'' = -w^2 q turns by the angle acos(1 - (w h)^2 / 2) a step."""
    found = tl.step_table(small(), methods=["Euler"], steps=[0.01, 0.005])
    w = np.sqrt(MASS * G * LENGTH / (MASS * LENGTH**2 + 1e-3))
    for row in found.rows:
        count = round(2.0 / row.step)
        q, v, track = 1e-4, 0.0, [1e-4]
        for _ in range(count):
            v -= row.step * w**2 * q
            q += row.step * v
            track.append(q)
        t = row.step * np.arange(count + 1)
        every = max(1, round(0.02 / row.step))
        exact = np.abs(np.array(track) - 1e-4 * np.cos(w * t))[::every].max()
        assert row.error == pytest.approx(exact, rel=1e-3, abs=2 * found.bar)
    assert found.bar < 1e-8
    assert found.softness is None
    assert found.soft == ()
    assert all(row.solver is None and row.seconds > 0 for row in found.rows)


def test_orders_are_those_of_the_integrators() -> None:
    scene = tl.Scene(pendulum(), q=[1.0], effects=[fx.Gravity()], duration=1.0)
    found = tl.step_table(scene, methods=["Euler", "RK4"], steps=[0.01, 0.005])
    errors = {(row.method, row.step): row.error for row in found.rows}
    assert np.log2(errors["Euler", 0.01] / errors["Euler", 0.005]) == pytest.approx(1, abs=0.2)
    assert np.log2(errors["RK4", 0.01] / errors["RK4", 0.005]) == pytest.approx(4, abs=0.3)


def test_the_largest_step_is_that_of_the_table() -> None:
    found = tl.step_table(small(0.5), methods=["Euler", "RK4"], steps=[0.02, 0.01, 0.001])
    for method in ("Euler", "RK4"):
        for limit in (1e-1, 1e-3, 1e-5):
            good = [row.step for row in found.rows if row.method == method and row.error + found.bar <= limit]
            assert found.largest_step(limit, method) == max(good, default=None)
    assert found.largest_step(1e-3) == found.largest_step(1e-3, "Euler")
    with pytest.raises(SceneError, match="RK4"):
        found.largest_step(1e-3, "RK5")


def test_the_options_of_the_file_come_first(tmp_path: Path) -> None:
    path = tmp_path / "pendulum.xml"
    path.write_text(PENDULUM.format(step=0.004, integrator="RK4"))
    found = tl.step_table(path, steps=[0.01], methods=["Euler"], duration=0.5)
    assert [(row.method, row.step, row.own) for row in found.rows] == [("RK4", 0.004, True), ("Euler", 0.01, False)]
    assert "own" in str(found)


def test_torques_of_a_log_act_and_its_first_row_is_the_start(tmp_path: Path) -> None:
    """A torque m g l sin(q0) holds the pendulum where it is."""
    log, q0 = tmp_path / "u.csv", 0.4
    held = MASS * G * LENGTH * np.sin(q0)
    log.write_text("t,tau.hinge,q.hinge,v.hinge\n" + "".join(f"{t},{held:.17g},{q0},0\n" for t in (5.0, 5.3, 5.6)))
    found = tl.step_table(pendulum(), log=log, steps=[0.01], methods=["Euler"])
    assert found.duration == pytest.approx(0.6)
    assert all(row.error < 1e-10 for row in found.rows)
    assert found.guessed == ()
    np.savez(tmp_path / "u.npz", time=[5.0, 5.3, 5.6], joint_torque=np.full((3, 1), held), qpos=np.full((3, 1), q0),
             qvel=np.zeros((3, 1), int))  # fmt: skip
    other = tl.step_table(pendulum(), log=tmp_path / "u.npz", steps=[0.01], methods=["Euler"])
    assert [row.error for row in other.rows] == [row.error for row in found.rows]
    assert "read: time as t; qpos as q, in MuJoCo's order and conventions; qvel as v" in str(other)
    log.write_text("t,q.hinge\n0,0\n1,0\n")
    with pytest.raises(SceneError, match=r"u\.csv: it has no times or no torques"):
        tl.step_table(pendulum(), log=log)
    log.write_text("t,tau.hing,tau.hinge\n0,1,0\n1,1,0\n")
    with pytest.raises(SceneError, match=r"its column 'tau\.hing' drives no joint of one coordinate"):
        tl.step_table(pendulum(), log=log)


GIMBAL = """<mujoco><worldbody><body pos="0 0 1" euler="20 0 0"><joint name="x" type="slide" axis="1 0 0"/>
<joint name="a" axis="0 1 0" pos="0.1 0 0.2" stiffness="1"/><joint name="b" axis="0 0.6 0.8" pos="0 0.1 0"/>
<geom type="capsule" size="0.05" fromto="0 0 0 0.3 0 -0.2"/>
<body pos="0.3 0 -0.2"><joint name="c" axis="1 0 0"/><geom type="box" size="0.05 0.1 0.15" pos="0 0.1 0"/></body></body>
</worldbody></mujoco>"""


def test_bodies_with_many_joints_are_those_of_mujoco() -> None:
    found = tl.step_table(GIMBAL, steps=[0.01, 0.001], methods=["RK4"], duration=1.0)
    coarse, fine = (next(row for row in found.rows if row.method == "RK4" and row.step == h) for h in (0.01, 0.001))
    assert fine.error < 1e-7
    assert np.log10(coarse.error / fine.error) == pytest.approx(4, abs=0.5)


def test_soft_laws_are_told_from_steps() -> None:
    """A block at 1 m/s meets a stop without restitution: it rests there at once; a soft stop gives way."""
    slide = joint("j", "prismatic", "ground", "block", "1 0 0", upper=0.2)
    robot = tl.load_robot(robot_text(link("block", 2.0), slide))
    scene = tl.Scene(robot, v=[1.0], effects=[fx.JointStops()], duration=0.4)
    found = tl.step_table(scene, steps=[0.01, 0.001], methods=["RK4"])
    assert found.soft == ("stops",)
    assert 1e-3 < found.softness < 0.05
    finest = min((row for row in found.rows if row.method == "RK4"), key=lambda row: row.step)
    assert finest.solver < 0.2 * found.softness
    assert finest.error == pytest.approx(found.softness, rel=0.2)
    assert "whatever the step" in str(found)
    assert found.largest_step(2 * finest.solver, "RK4") >= finest.step


def test_other_peers_and_bad_steps_are_refused() -> None:
    wrong = {"peer": "drake", "steps": [0.0], "methods": ["Newton"], "duration": -1.0, "seconds": float("nan")}
    for name, value in wrong.items():
        with pytest.raises(SceneError, match=name):
            tl.step_table(small(), **{name: value})


def test_what_takes_too_long_is_left_out() -> None:
    found = tl.step_table(small(), steps=[0.01, 1e-5], methods=["Euler"], seconds=0.02)
    assert [row.message != "" for row in found.rows] == [False, False, True]
    assert "left out" in str(found)


def test_the_command_writes_figure_and_data(tmp_path: Path) -> None:
    path = tmp_path / "pendulum.xml"
    path.write_text(PENDULUM.format(step=0.002, integrator="Euler"))
    data = answer("steps", str(path), "--steps", "0.01,0.005", "--duration", "0.2", "--out", str(tmp_path / "s.png"),
                  "--out", str(tmp_path / "s.json"))  # fmt: skip
    assert {row["step"] for row in data["rows"]} == {0.002, 0.01, 0.005}
    assert json.loads((tmp_path / "s.json").read_text())["peer"] == data["peer"]
    assert (tmp_path / "s.png").stat().st_size > 1000
