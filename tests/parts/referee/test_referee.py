"""The referee: right trajectories are right, wrong ones are explained."""

import json
from pathlib import Path

import numpy as np
import pyarrow.parquet
import pytest
from scipy.integrate import solve_ivp

import twolink as tl
from tests.command import call
from tests.parts.exchange.simulators import Log, exact, law_of, stepped
from twolink.errors import SceneError
from twolink.parts.referee.referee import best_run, verdict_of
from twolink.parts.referee.trajectory_log import TrajectoryLog
from twolink.robots.catalogue import our_urdfs

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
    assert verdict.answer == "wrong"
    assert verdict.causes, str(verdict)
    assert all(cause.unexplained < 0.01 for cause in verdict.causes)
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
    both = blamed(stepped(ARM, law_of(ARM.robot), 2.0, 0.01, 0.002))
    assert both == "semi-implicit Euler with steps of 2 ms, and damping is left out"


def test_friction_that_is_left_out_is_named() -> None:
    scene = ARM.with_effects([fx.Gravity(), fx.DryFriction({"shoulder": 0.5, "elbow": 0.5})])
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


def test_a_log_in_degrees_is_wrong_for_other_causes_too() -> None:
    """Its units do not hide what is wrong in SI units: gravity, as of the same log in radians."""
    scene = tl.Scene(ARM.base, [1.2, 0.5], effects=[fx.Gravity()], duration=0.5)
    run = tl.simulate(scene.with_effects([fx.Gravity((0, 0, -12.0))]), accuracy=1e-9)
    (plain, *_), (turned, *_) = (tl.judge(scene, (run.t, scale * run.q, scale * run.v)).causes
                                 for scale in (1.0, 180 / np.pi))  # fmt: skip
    assert plain.what.startswith("gravity differs [m/s^2]: z -2.19")
    assert turned.what == f"q and v are in degrees, and {plain.what}"


@pytest.mark.parametrize("also", [False, True])
def test_lengths_of_a_log_in_degrees_are_metres(also: bool) -> None:
    body = """<inertial><origin xyz="0.3 0 0"/><mass value="1"/><inertia ixx=".01" iyy=".02" izz=".03" ixy="0" ixz="0"
        iyz="0"/></inertial>"""
    limit = '<limit lower="-9" upper="9" effort="9" velocity="9"/>'
    robot = tl.load_robot(f"""<robot name="slider"><link name="w"/><link name="a">{body}</link><link name="b">{body}
        </link><joint name="h" type="revolute"><parent link="w"/><child link="a"/><axis xyz="0 1 0"/>{limit}</joint>
        <joint name="s" type="prismatic"><parent link="a"/><child link="b"/>{limit}</joint></robot>""")
    scene = tl.Scene(robot, [0.5, 0.2], effects=[fx.Gravity(), fx.JointSpring({"s": 200.0})], duration=0.5)
    run, degrees = tl.simulate(scene, accuracy=1e-9), np.array([180 / np.pi, 1.0])
    verdict = tl.judge(scene, (run.t, run.q * degrees, run.v * degrees if also else run.v))
    assert verdict.causes[0].what == ("q and v are in degrees" if also else "q is in degrees")
    assert verdict.distance.max() < 1e-9
    assert verdict.excess == 0.0


def test_a_run_of_one_sample_is_no_trajectory() -> None:
    with pytest.raises(SceneError, match="expected two samples or more, got 1"):
        tl.judge(ARM, tl.simulate(ARM, 0.5, t_eval=[0.5]))


def test_a_run_beyond_its_stops_is_told() -> None:
    scene = ARM.with_effects([fx.Gravity(), fx.JointStops({"shoulder": (0.0, 1.0)})])
    verdict = tl.judge(scene, exact(scene, law_of(scene.robot), 1.0, 0.01))
    assert not verdict.right
    assert verdict.constraints["stop of shoulder"] > 0.1
    assert tl.judge(scene, tl.simulate(scene, 1.0, accuracy=1e-9)).right


def test_a_log_that_goes_on_behind_the_end_of_the_motion_is_held_against_it_until_then() -> None:
    """The log is by SciPy, to 12 digits; the scene ends between two of its samples."""
    t, q, v = RIGHT
    place, between = 60, 0.5 * (q[60, 0] + q[61, 0])
    end = fx.Watch("low", when=fx.JointReaches("shoulder", float(between)), stop=True)
    scene = ARM.with_effects([*ARM.effects, end])
    assert t[place] < tl.simulate(scene).t[-1] < t[place + 1]
    for digits in (None, 6):
        log = (t, *(x if digits is None else np.round(x, digits) for x in (q, v)))
        for start in ("scene", "log"):
            assert tl.judge(ARM, log, start=start).right
            verdict = tl.judge(scene, log, start=start)
            assert (verdict.answer, verdict.unknown_from) == ("not known", pytest.approx(t[place]))
            assert tl.judge(scene, tuple(x[: place + 1] for x in log), start=start).right
    with pytest.raises(SceneError, match="before the second sample"):
        tl.judge(scene, (t[::100], q[::100], v[::100]))


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
    logs = tmp_path / "log.csv", tmp_path / "log.npz", {"t": t, "q": q, "v": v}
    verdicts = [tl.judge(ARM, log) for log in logs]
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
    with pytest.raises(SceneError) as failure:
        tl.judge(ARM, given)
    assert failure.value.code == "not-a-trajectory"


def test_what_is_not_known_is_neither_right_nor_wrong() -> None:
    """A chaotic arm, whose stops, which it never touches, leave it to 16 digits: the solution is lost, not the log."""
    arm = tl.load_robot("two_link")
    effects = [fx.Gravity(), fx.JointStops(dict.fromkeys(arm.joint_names, (-10000.0, 10000.0)))]
    scene = tl.Scene(arm, q=[np.pi / 2, 0.5], v=[0.0, 3.0], effects=effects)
    solution = best_run(scene, np.linspace(0.0, 16.0, 321), 1e-9)
    assert solution.error.max() > 1e-6
    smooth = tl.simulate(scene.with_effects([fx.Gravity()]), 16.0, accuracy=1e-8, t_eval=solution.t)  # in 33 digits
    t, q, v = smooth.t, smooth.q, smooth.v
    verdict = verdict_of(scene, TrajectoryLog(t, q, v), solution, 1e-6)
    itself = verdict_of(scene, TrajectoryLog(t, solution.q, solution.v), solution, 1e-6)
    for one in (verdict, itself):
        assert one.answer == "not known", str(one)
        assert one.bar[one.t < one.unknown_from].max() <= 1e-6
        assert one.causes == ()
    moved = TrajectoryLog(t, q + 1e-3 * np.sin(t)[:, None], v + 1e-3 * np.cos(t)[:, None])
    lost = verdict_of(scene, moved, solution, 1e-6, seconds=1.0)
    assert lost.answer == "wrong"  # for certain, before the solution is lost
    assert lost.excess >= 0.9e-3


@pytest.mark.some(1)
@pytest.mark.parametrize("digits", [4, 6])
def test_digits_that_a_log_has_not_do_not_make_it_wrong(digits: int) -> None:
    run = tl.simulate(ARM, 2.0, accuracy=1e-10)
    rounded = tuple(np.round(x, digits) for x in (run.t, run.q, run.v))
    significant = tuple(np.vectorize(lambda x: float(f"{x:.{digits}g}"))(x) for x in (run.t, run.q, run.v))
    for log in (rounded, significant):
        assert tl.judge(ARM, log).answer == "right"
        assert tl.judge(ARM, log, start="log").answer != "wrong"
    off = rounded[1] + 3 * 10.0**-digits * (run.t > 1)[:, None]
    assert tl.judge(ARM, (rounded[0], np.round(off, digits), rounded[2]), seconds=1.0).answer == "wrong"


def test_a_log_without_velocities_is_judged_by_its_positions() -> None:
    run = tl.simulate(ARM, 1.0, accuracy=1e-9)
    verdict = tl.judge(ARM, {"t": run.t, "q": run.q})
    assert verdict.right
    assert verdict.velocity is None
    assert tl.judge(ARM, {"t": run.t, "q": 1.01 * run.q}).answer == "wrong"
    with pytest.raises(SceneError, match="no velocities to start from"):
        tl.judge(ARM, {"t": run.t, "q": run.q}, start="log")


def test_wrong_velocities_alone_are_wrong() -> None:
    run = tl.simulate(ARM, 1.0, accuracy=1e-9)
    verdict = tl.judge(ARM, (run.t, run.q, run.v + 0.01), seconds=1.0)
    assert verdict.answer == "wrong"
    assert 0.009 < verdict.excess <= 0.01


def test_a_robot_starts_where_its_log_does(tmp_path: Path) -> None:
    """From another state than scene_of's, and from a log that begins late."""
    made = tl.scene_of("two_link")
    moved = made.with_start([0.9, -0.3], [0.5, 0.2])
    run = tl.simulate(moved, 1.0, accuracy=1e-10)
    later = (run.t[50:], run.q[50:], run.v[50:])
    for log in (run, later):
        for robot in ("two_link", our_urdfs() / "two_link.urdf"):
            assert tl.judge(robot, log).right
            assert tl.judge(robot, log, start="log").right
        assert tl.judge(made, log, start="log").right
        assert tl.judge(made, log, seconds=1.0).answer == "wrong"
    path = run.save(tmp_path / "log.csv")
    assert call("judge", "two_link", str(path)).returncode == 0
    assert call("judge", "two_link", str(path), "--start", "scene", "--seconds", "1").returncode == 1


KNOTS = np.linspace(0.0, 1.0, 21)


def by_table(gravity: float, dt: float, *, hold: bool = False) -> Log:
    """The arm under a table of torques at the elbow, by DOP853 from knot to knot with NumPy's interpolation."""
    robot, values, times = ARM.robot.with_gravity([0, 0, -gravity]), 3 * np.sin(7 * KNOTS), np.arange(0.0, 1.0, dt)
    rows, x = [np.array([[1.2, 0.5, 0.0, 0.0]])], np.array([1.2, 0.5, 0.0, 0.0])

    def rate(t: float, x: np.ndarray, held: float) -> np.ndarray:
        torque = held if hold else float(np.interp(t, KNOTS, values))
        return np.concatenate([x[2:], robot.forward_dynamics(x[:2], x[2:], [0.0, torque], engine="pinocchio")])

    for k in range(20):
        inside = times[(times > KNOTS[k]) & (times <= KNOTS[k + 1])]
        done = solve_ivp(rate, KNOTS[k : k + 2], x, "DOP853", t_eval=np.union1d(inside, KNOTS[k + 1]), rtol=1e-11,
                         atol=1e-11, args=(values[k],))  # fmt: skip
        rows.append(done.y[:, : len(inside)].T)
        x = done.y[:, -1]
    out = np.concatenate(rows)
    return times, out[:, :2], out[:, 2:]


@pytest.mark.parametrize("dt", [0.005, 0.03, 0.12])
@pytest.mark.parametrize("kind", ["linear", "hold"])
def test_tables_act_at_all_times(kind: str, dt: float) -> None:
    """Also where some of their knots are between two samples."""
    table = fx.Sampled(tuple(KNOTS), tuple(3 * np.sin(7 * KNOTS)), interpolation=kind)
    scene = tl.Scene(ARM.robot, [1.2, 0.5], effects=[fx.Gravity(), fx.Torque({"elbow": table})], duration=1.0)
    verdict = tl.judge(scene, by_table(9.81, dt, hold=kind == "hold"))
    assert verdict.right, str(verdict)
    assert verdict.defect < 1e-6
    if dt == 0.005:
        assert blamed(by_table(9.7, dt, hold=kind == "hold"), scene).startswith("gravity differs [m/s^2]: z +0.11")


def test_the_energy_of_a_released_payload_is_the_same_on_both_sides() -> None:
    effects = [fx.Gravity(), fx.Release(fx.Payload("forearm", 2.0, (0.3, 0.0, 0.0)), at=0.5)]
    scene = tl.Scene(ARM.robot, [1.2, 0.5], effects=effects, duration=1.0)
    run = tl.simulate(scene, accuracy=1e-9)
    assert tl.judge(scene, run).energy < 1e-5
    faster = tl.judge(scene, (run.t, run.q, run.v * 1.01), seconds=0.1).energy
    held, bare = (robot.energy(run.q, run.v)[0] for robot in (scene.robot, ARM.robot))
    kinetic = np.where(run.t > 0.5, bare, held)
    assert faster == pytest.approx((1.01**2 - 1.0) * kinetic.max(), rel=1e-6)


def test_a_kick_is_no_local_defect() -> None:
    kick = fx.Watch("kick", at=0.503, then=lambda q, v: (q, v + 1.0))
    scene = tl.Scene(ARM.robot, [1.2, 0.5], effects=[fx.Gravity(), kick], duration=1.0)
    verdict = tl.judge(scene, tl.simulate(scene, accuracy=1e-9))
    assert verdict.right
    assert verdict.defect is None


def test_a_cause_that_leaves_more_than_a_percent_is_not_named() -> None:
    """A student's two equations of the arm, by absolute angles; one sign of the second is wrong."""
    arm = ARM.robot
    scene = tl.Scene(arm, q=[0.4, 0.4], v=[1.0, 2.0], effects=[fx.Gravity()])

    def law(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        coriolis = arm.bias(q, v) - arm.gravity_torque(q)
        return arm.forward_dynamics(q, v, np.array([0.0, 2 * coriolis[1]]), engine="pinocchio")

    verdict = tl.judge(scene, exact(scene, law, 1.0, 0.01))
    assert verdict.answer == "wrong"
    assert verdict.causes == ()
    assert verdict.nearest.unexplained > 0.01
    assert "cause: none known; nearest: " in str(verdict)


@pytest.mark.some(1)
@pytest.mark.parametrize("name", ["implicit in the velocity", "implicit damping"])
def test_implicit_steps_are_named(name: str) -> None:
    """v += h (M + h (D + dh/dv))^-1 (M a), written down here with differences for dh/dv."""
    robot, d, h = ARM.robot, 0.3, 0.004

    def step(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        mass, force = robot.mass_matrix(q), -d * v - robot.bias(q, v)
        slope = d * np.eye(2)
        if "velocity" in name:
            moved = [robot.bias(q, v + 1e-6 * e) - robot.bias(q, v - 1e-6 * e) for e in np.eye(2)]
            slope += np.array(moved).T / 2e-6
        return v + h * np.linalg.solve(mass + h * slope, force)

    q, v = ARM.q.copy(), ARM.v.copy()
    rows = [(q, v)]
    for _ in range(200):
        v = step(q, v)
        q = q + h * v
        rows.append((q, v))
    log = np.arange(201) * h, np.array([q for q, _ in rows]), np.array([v for _, v in rows])
    assert name in blamed(log)
    assert "steps of 4 ms" in blamed(log)


def test_causes_take_no_more_time_than_they_are_given() -> None:
    labels: list[str] = []
    log = exact(ARM, law_of(ARM.robot, 0.5), 1.0, 0.01)

    def tell(_done: float, _total: float, label: str) -> None:
        labels.append(label)

    verdict = tl.judge(ARM, log, seconds=1e-3, progress=tell)
    assert verdict.answer == "wrong"
    assert verdict.causes == ()
    assert any("local defects" in one for one in verdict.not_looked_at)
    assert "not looked at, for lack of time" in str(verdict)
    assert "WRONG" in labels[0]


@pytest.mark.slow
def test_joints_in_the_order_of_another_program_are_named() -> None:
    t, q, v = RIGHT
    assert blamed((t, q[:, ::-1], v[:, ::-1])) == "its joints are in another order: by the alphabet"
    verdict = tl.judge(ARM, {"t": t, "joint_pos": q[:, ::-1], "joint_vel": v[:, ::-1],
                             "joint_names": ["elbow", "shoulder"]})  # fmt: skip
    assert verdict.right, str(verdict)
    assert "joint_pos as q, by the names of its columns" in str(verdict)


def test_of_two_logs_the_nearer_one_and_what_both_miss(tmp_path: Path) -> None:
    fine, coarse = (stepped(ARM, LAW, 1.0, 0.01, h) for h in (0.001, 0.01))
    found = tl.judge_many(ARM, {"coarse": coarse, "fine": fine})
    assert found.nearest == ("fine", "coarse")
    assert [verdict.answer for verdict in found.verdicts.values()] == ["wrong", "wrong"]
    assert "nearest to the solution: fine, at most" in str(found)
    assert found.plot(tmp_path / "both.png").stat().st_size > 1000
    page = found.save(tmp_path / "both.html").read_text()
    assert "WRONG" in page
    assert "data:image/png" in page
    alike = tl.judge_many(ARM, {"a": coarse, "b": (coarse[0][:60], coarse[1][:60], coarse[2][:60])})
    assert alike.common_causes == ("semi-implicit Euler with steps of 10 ms",)
    assert "what all miss: semi-implicit Euler" in str(alike)
    with pytest.raises(SceneError, match="expected trajectories by name"):
        tl.judge_many(ARM, {})


def test_a_data_set_of_lerobot_is_read_by_the_names_beside_it(tmp_path: Path) -> None:
    run = tl.simulate(ARM, 1.0, accuracy=1e-9, samples_per_second=30)
    table = pyarrow.table({"timestamp": run.t.astype(np.float32), "episode_index": np.zeros(len(run.t), int),
                           "observation.state": [row.tolist() for row in run.q[:, ::-1]],
                           "observation.velocity": [row.tolist() for row in run.v[:, ::-1]]})  # fmt: skip
    (tmp_path / "data").mkdir()
    (tmp_path / "meta").mkdir()
    pyarrow.parquet.write_table(table, tmp_path / "data" / "episode_000000.parquet")
    names = {"observation.state": {"names": {"motors": ["elbow.pos", "shoulder.pos"]}}}
    (tmp_path / "meta" / "info.json").write_text(json.dumps({"features": names}))
    verdict = tl.judge(ARM, tmp_path / "data" / "episode_000000.parquet", tolerance=1e-5)
    assert verdict.right, str(verdict)


def test_compressed_csv_is_read(tmp_path: Path) -> None:
    path = tmp_path / "log.csv.gz"
    np.savetxt(path, np.column_stack(RIGHT), "%.17g", ",", header="t,q0,q1,v0,v1", comments="")
    assert tl.judge(ARM, path).right


@pytest.mark.parametrize("tolerance", [float("nan"), 0.0, -1.0, "small"])
def test_a_tolerance_that_is_none_is_refused(tolerance: object) -> None:
    """Against nan every comparison is false: nothing would be beyond it."""
    with pytest.raises(SceneError, match="tolerance"):
        tl.judge(ARM, {"t": [0.0, 1.0], "q": [[0.0, 0.0]] * 2}, tolerance=tolerance)
