"""Drives: closed forms, exact pieces of motion, and second implementations integrated by SciPy."""

import copy
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq

import twolink as tl
from tests.effects.bodies import slider, solved
from tests.near import assert_near, assert_within
from tests.refusals import refusal
from twolink.algorithms.motion import KinematicState
from twolink.effects.effect import Loads
from twolink.scenes.parameters import parameters_of

fx = tl.effects
WHEEL = tl.load_robot("friction_pendulum")
I = float(WHEEL.mass_matrix(WHEEL.neutral)[0, 0])  # noqa: E741
WEIGHT = float(tl.Scene(WHEEL, effects=[fx.Gravity()]).robot.inverse_dynamics([np.pi / 2], [0.0], [0.0])[0])
J = "axle"


def of_all(value: float) -> dict[str, float]:
    return {J: value}


def scene(*effects: fx.Effect, v: float = 0.0, duration: float = 1.0) -> tl.Scene:
    return tl.Scene(WHEEL, v=[v], effects=list(effects), duration=duration)


def by_scipy(
    rate: Callable[..., Sequence[float]], x: Sequence[float], t: np.ndarray, method: str = "DOP853"
) -> np.ndarray:
    tolerance = {"rtol": 1e-12, "atol": 1e-13} if method == "DOP853" else {"rtol": 1e-10, "atol": 1e-12}
    return solve_ivp(rate, (0.0, t[-1]), x, method=method, t_eval=t, **tolerance).y


LAGGED = scene(fx.ActuatorLag(fx.Torque(of_all(0.7)), of_all(0.05), {J: 0.1}))


def lagged(t: np.ndarray, time: float = 0.05, u: float = 0.7, start: float = 0.1) -> np.ndarray:
    """q of I q'' = z, T z' = u - z."""
    return (u * t * t / 2 + (start - u) * time * (t - time * (1 - np.exp(-t / time)))) / I


@pytest.mark.some(2)
@pytest.mark.parametrize("method", ["taylor", "dop853", "esdirk43", "scipy-dop853", "rk4"])
def test_lag_by_its_closed_form(method: str) -> None:
    run = tl.simulate(LAGGED, accuracy=1e-9, method=method)
    z = 0.7 - 0.6 * np.exp(-run.t / 0.05)
    assert np.abs(run.q[:, 0] - lagged(run.t)).max() <= run.error.max() <= 1e-9
    assert_within(run.states["axle.lag"], z, (1 + np.abs(z)) * run.error + 1e-15)  # the bar holds for states too


def test_sensitivities_of_a_lag() -> None:
    """By its time, its command and its own start, which moves no equation but the state at t = 0."""
    names = ["effects.0.time.axle", "effects.0.of.inputs.axle", "effects.0.start.axle", "v"]
    found = tl.sensitivities(LAGGED, wrt=names, accuracy=1e-7)
    t, h = found.run.t, 1e-5
    along = (lagged(t, time=0.05 + h) - lagged(t, time=0.05 - h), lagged(t, u=0.7 + h) - lagged(t, u=0.7 - h),
             lagged(t, start=0.1 + h) - lagged(t, start=0.1 - h), 2 * h * t)  # fmt: skip
    for name, difference in zip(names, along, strict=True):
        assert_near(found.q[name][:, 0, 0], difference / (2 * h), 1e-6)


def test_worlds_with_other_lags_in_one_batch() -> None:
    values = {"effects.0.time.axle": [0.02, 0.05], "effects.0.start.axle": [0.1, -0.3]}
    worlds = tl.simulate_many(LAGGED, parameters=values, accuracy=1e-9)
    exact = [lagged(np.ones(1), time, start=start)[0] for time, start in zip(*values.values(), strict=True)]
    assert_near(worlds.q[:, 0], exact, 1e-9)
    assert worlds.cost.compiled


def test_lag_beside_events() -> None:
    """A stop, dry friction, a lag that begins later: against the same in SciPy from the time at which it begins."""
    late = fx.Engage(fx.ActuatorLag(fx.Torque(of_all(2.0)), of_all(0.1)), at=0.25)
    run = tl.simulate(scene(late, fx.DryFriction(of_all(0.5)), fx.JointStops({J: (-1.0, 0.4)}, 0.5), duration=1.5),
                      accuracy=1e-8)  # fmt: skip
    moves = 0.25 - 0.1 * np.log(1 - 0.5 / 2.0)  # where z = 0.5
    assert [event.kind for event in run.events[:3]] == ["engage", "slip", "impact"]
    assert_near(run.events[1].t, moves, 1e-8)
    t = np.linspace(0.0, run.events[2].t - moves, 50)
    y = by_scipy(lambda _, x: [x[1], (x[2] - 0.5) / I, (2.0 - x[2]) / 0.1], [0.0, 0.0, 0.5], t)
    assert_near(y[0, -1], 0.4, 1e-8)
    assert run.states["axle.lag"][run.t < 0.25].max() == 0.0


def test_what_begins_later_begins_with_the_motion_of_then() -> None:
    """A motor on a spring that engages moves as its joint does, which feels nothing; a filter begins at the speed."""
    pushed, begin = fx.Torque(of_all(0.7 * I)), 0.5
    motor = fx.ElasticJoint(fx.Torque(of_all(0.14 * I)), of_all(50.0), of_all(0.2 * I))
    run = tl.simulate(scene(pushed, fx.Engage(motor, at=begin)), accuracy=1e-9)
    assert_near(run.q[:, 0], 0.35 * run.t**2, 1e-9)  # motor and joint are driven at 0.7 rad/s^2 each
    pid = fx.PID(of_all(0.0), of_all(0.0), kd=of_all(3.0 * I), filter=of_all(0.1))
    run = tl.simulate(scene(pushed, fx.Engage(pid, at=begin)), accuracy=1e-9)
    q, v = 0.35 * begin**2, 0.7 * begin  # q' = v, v' = 0.7 - 3 w, w' = (v - w) / 0.1
    rates = np.array([[0, 1, 0, 0], [0, 0, -3.0, 0.7], [0, 10.0, -10.0, 0], [0, 0, 0, 0]])
    assert_near(run.q[-1, 0], (expm((1.0 - begin) * rates) @ [q, v, v, 1.0])[0], 1e-9)


@pytest.mark.parts
def test_motor_by_the_matrix_exponential() -> None:
    """Step response of the armature, the rotor and their coupling."""
    r, ind, k, u = 1.2, 0.01, 0.3, 12.0
    motor = fx.DCMotor(resistance=of_all(r), inductance=of_all(ind), constant=of_all(k), voltage=of_all(u))
    run = tl.simulate(scene(motor, duration=2.0), accuracy=1e-9)
    a = np.zeros((4, 4))
    a[:3, :3], a[2, 3] = [[0, 1, 0], [0, 0, k / I], [0, -k / ind, -r / ind]], u / ind
    for i in (10, 100, -1):
        exact = expm(a * run.t[i]) @ [0, 0, 0, 1]
        found = run.q[i, 0], run.v[i, 0], run.states["axle.current"][i]
        assert_near(np.array(found), exact[:3], 1e-8)
    book = tl.energy_book(scene(motor, duration=2.0), run)
    assert_near(book.residual, 0.0, 1e-8)
    linear = tl.linearize(scene(motor))
    assert linear.names == ("q.axle", "v.axle", "z.axle.current")
    np.testing.assert_allclose(linear.A, a[:3, :3], rtol=1e-9, atol=1e-9)


def geared(**changed: object) -> tl.Scene:
    """A pendulum lifted by a geared motor whose voltage a PID gives, within 12 V."""
    pid = fx.PID(of_all(1.0), of_all(40.0), of_all(30.0), of_all(2.0), of_all(0.01), of_all(12.0))
    motor = fx.DCMotor(pid, of_all(1.2), of_all(0.01), of_all(0.05), winding=fx.Winding(20.0, 0.5, magnet=0.001))
    gear = {"ratio": of_all(20.0), "efficiency": of_all(0.8), "backward": of_all(0.7), "inertia": of_all(1e-4),
            "power": 0.5, **changed}  # fmt: skip
    return scene(fx.Gravity(), fx.Gear(motor, **gear), duration=2.0)


def geared_rate(_t: float, x: Sequence[float]) -> list[float]:
    q, v, integral, w, i, theta = x
    wanted = 40 * (1 - q) + integral - 2 * w
    u = np.clip(wanted, -12, 12)
    r, k = 1.2 * (1 + 0.00393 * theta), 0.05 * (1 - 0.001 * theta)
    tau = k * i
    mean, half = (0.8 + 1 / 0.7) / 2, (1 / 0.7 - 0.8) / 2
    joint = 20 * tau * (mean - half * np.tanh(20 * tau * v / 0.5))
    return [v, (joint - WEIGHT * np.sin(q)) / (I + 400 * 1e-4), 30 * (1 - q) + 30 / 40 * (u - wanted), (v - w) / 0.01,
            (u - r * i - k * 20 * v) / 0.01, (r * i * i - 0.5 * theta) / 20]  # fmt: skip


def test_pid_motor_winding_and_gear_against_scipy() -> None:
    run = tl.simulate(geared(), accuracy=1e-7)
    exact = by_scipy(geared_rate, np.zeros(6), run.t)
    names = ["axle.integral", "axle.filter", "axle.current", "axle.winding"]
    assert list(run.states) == names
    assert_near(run.q[:, 0], exact[0], 1e-7)
    for name, row in zip(names, exact[2:], strict=True):
        assert_near(run.states[name], row, 1e-6)
    assert [(event.kind, event.detail) for event in run.events] == [("limit", "left")]  # the voltage, at its limit


def test_gear_without_losses_is_its_ratio() -> None:
    """A motor with N K and, of the current, the same: N turns of a rotor of N^2 the inertia."""
    plain = fx.DCMotor(resistance=of_all(1.0), inductance=of_all(0.1), constant=of_all(0.2), voltage=of_all(5.0))
    inner = fx.DCMotor(resistance=of_all(1.0), inductance=of_all(0.1), constant=of_all(0.02), voltage=of_all(5.0))
    whole = scene(fx.Gear(inner, of_all(10.0), inertia=of_all(2e-3)))
    runs = [tl.simulate(one, accuracy=1e-10) for one in (whole, scene(plain, fx.Rotor(of_all(2e-3), of_all(10.0))))]
    assert_near(runs[0].q, runs[1].q, 1e-10)


def test_gears_in_a_row_are_one_gear() -> None:
    """Of ratios 5 and 4, where the motor's rotor turns 20 times as fast as the joint, and the wheel between 4 times."""
    inner = fx.Gear(fx.Torque(of_all(0.05)), of_all(5.0), inertia=of_all(1e-3))
    row = scene(fx.Gravity(), fx.Gear(fx.ActuatorLag(inner, of_all(0.1)), of_all(4.0), inertia=of_all(5e-3)))
    one = scene(fx.Gravity(), fx.ActuatorLag(fx.Torque(of_all(1.0)), of_all(0.1)),
                fx.Rotor(of_all(1.0), {"axle": np.sqrt(20.0**2 * 1e-3 + 4.0**2 * 5e-3)}))  # fmt: skip
    assert row.robot.model.armature == pytest.approx(0.48)
    runs = [tl.simulate(each, accuracy=1e-10) for each in (row, one)]
    assert_near(runs[0].q, runs[1].q, 1e-9)


@pytest.mark.parts
def test_what_a_drive_refuses_is_right_beside_it() -> None:
    """Gravity's torque beside a gear is that of Pinocchio; and a rotor counts as N^2 of its inertia before a spring."""
    arm = tl.load_robot("two_link")
    geared = fx.Gear(fx.Torque({"elbow": 0.1}), {"elbow": 10.0})
    run = tl.simulate(tl.Scene(arm, q=[1.2, 0.5], effects=[fx.Gravity(), fx.GravityCompensation(), geared]), 0.01)
    assert run.tau[0] - [0.0, 1.0] == pytest.approx(arm.gravity_torque([1.2, 0.5]))
    motor = fx.ElasticJoint(fx.Gear(fx.Torque(of_all(0.0)), of_all(10.0)), of_all(50.0), of_all(0.1 + 10.0**2 * 2e-3))
    turning = np.sqrt(50.0 * (1 / I + 1 / 0.3))
    assert np.sort(np.abs(tl.linearize(scene(motor)).eigenvalues.imag))[-2:] == pytest.approx(turning, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["effects.1.of.of.kp.axle", "effects.1.efficiency.axle", "effects.1.inertia.axle", "q"]
)
def test_sensitivities_through_a_whole_drive(name: str) -> None:
    """Against differences of runs, also through the limit and of the rotor, which changes the robot."""
    found = tl.sensitivities(geared(), wrt=[name], accuracy=1e-5)

    def run(k: float) -> np.ndarray:
        if name == "q":
            return tl.simulate_many(geared(), q=[[k]], accuracy=1e-10).q[0]
        value = parameters_of(geared())[name].nominal
        return tl.simulate_many(geared(), parameters={name: [value + k]}, accuracy=1e-10).q[0]

    h = 2e-6 if name.endswith("inertia.axle") else 1e-3
    assert found.q[name][-1, 0, 0] == pytest.approx(float((run(h) - run(-h))[0]) / (2 * h), rel=1e-4, abs=1e-5)


@pytest.mark.parts
def test_modes_of_an_elastic_joint() -> None:
    """Free: +- i sqrt(k (1 / I + 1 / J)); and a cubic spring against SciPy."""
    free = scene(fx.ElasticJoint(fx.Torque(of_all(0.0)), of_all(50.0), of_all(0.1)))
    turning = np.sqrt(50.0 * (1 / I + 1 / 0.1))
    assert np.sort(np.abs(tl.linearize(free).eigenvalues.imag))[-2:] == pytest.approx(turning, rel=1e-9)
    hard = fx.ElasticJoint(fx.Torque({J: fx.Sine(1.0, 3.0)}), of_all(50.0), of_all(0.1), of_all(300.0), of_all(0.1))
    run = tl.simulate(scene(hard, v=1.0, duration=3.0), accuracy=1e-9)

    def rate(t: float, x: Sequence[float]) -> list[float]:
        force = 50 * (x[2] - x[0]) + 300 * (x[2] - x[0]) ** 3 + 0.1 * (x[3] - x[1])
        return [x[1], force / I, x[3], (np.sin(3 * t) - force) / 0.1]

    exact = by_scipy(rate, [0.0, 1.0, 0.0, 1.0], run.t)  # the motor begins with the joint
    assert_near(run.q[:, 0], exact[0], 1e-8)
    assert_near(run.states["axle.motor_speed"], exact[3], 1e-7)


def test_backlash_has_the_exact_solution() -> None:
    """A constant torque on the motor: the twist is parabolas in the gap and arcs of a sine on the flank, by turns."""
    torque, inertia, k, half = 0.3, 0.1, 2000.0, 0.05
    drive = fx.Backlash(fx.Torque(of_all(torque)), of_all(k), of_all(inertia), gap=of_all(2 * half))
    run = tl.simulate(scene(drive, duration=1.2), accuracy=1e-9)
    pull, omega = torque / inertia, np.sqrt(k * (1 / I + 1 / inertia))
    meets = np.sqrt(2 * half / pull)
    speed = pull * meets
    pressed = 2 / omega * (np.pi - np.arctan(speed * omega / pull))
    expected, t = [], meets
    while t < 1.2:
        expected += [t, t + pressed]
        t += pressed + 2 * speed / pull
    expected = [t for t in expected if t < 1.2]
    assert_near([event.t for event in run.events], expected, 1e-9)
    assert len(expected) >= 6
    momentum = I * run.v[:, 0] + inertia * run.states["axle.motor_speed"]
    assert_near(momentum, torque * run.t, 1e-8)


def test_limits_of_effort_and_play_of_one_joint_are_located_each() -> None:
    """A controller at its limit behind a gap: flanks and limits meet and part where SciPy says."""
    limit, k, inertia, half = 0.6, 60.0, 0.05, 0.02
    pd = fx.JointPD(of_all(0.2), of_all(6.0), of_all(0.3), effort=of_all(limit))
    drive = fx.Backlash(pd, of_all(k), of_all(inertia), damping=of_all(2.0), gap=of_all(2 * half))

    def wanted(x: Sequence[float]) -> float:
        return 6.0 * (0.2 - x[2]) - 0.3 * x[3]

    def rate(_t: float, x: Sequence[float]) -> list[float]:
        twist = x[2] - x[0]
        pressed = twist - np.clip(twist, -half, half)
        force = k * pressed + 2.0 * abs(pressed) * (x[3] - x[1])
        return [x[1], (force - WEIGHT * np.sin(x[0])) / I, x[3], (np.clip(wanted(x), -limit, limit) - force) / inertia]

    guards = [lambda _, x: x[2] - x[0] - half, lambda _, x: x[2] - x[0] + half,
              lambda _, x: wanted(x) - limit, lambda _, x: wanted(x) + limit]  # fmt: skip
    exact = solve_ivp(rate, (0.0, 1.5), [0.0, 1.5, 0.0, 1.5], "DOP853", rtol=1e-11, atol=1e-12, events=guards,
                      max_step=1e-3)  # fmt: skip
    moving = scene(fx.Gravity(), drive, v=1.5, duration=1.5)
    run = tl.simulate(moving, accuracy=1e-8)
    times = np.sort(np.concatenate(exact.t_events))
    assert min(len(np.concatenate(exact.t_events[:2])), len(np.concatenate(exact.t_events[2:]))) >= 2
    assert_near([event.t for event in run.events], times, 1e-6)
    assert_near(run.q[-1, 0], exact.y[0, -1], 1e-7)
    ends = [tl.simulate(scene(fx.Gravity(), drive, v=1.5 + d, duration=1.5), accuracy=1e-10).q[-1, 0]
            for d in (-1e-5, 1e-5)]  # fmt: skip
    slope = tl.sensitivities(moving, wrt=["v.axle"]).q["v.axle"][-1].item()
    assert slope == pytest.approx((ends[1] - ends[0]) / 2e-5, rel=1e-4, abs=1e-5)


def test_flanks_meet_where_the_controller_behind_them_has_no_limit_any_more() -> None:
    """Released gravity takes the limit of its compensation along; the play is the same limit before and after."""
    limit, k, inertia, half, end = 0.4 * WEIGHT, 60.0, 0.05, 0.02, 0.25
    compensation = fx.GravityCompensation((J,), effort=of_all(limit))
    drive = fx.Backlash(compensation, of_all(k), of_all(inertia), gap=of_all(2 * half))

    def rate(t: float, x: Sequence[float]) -> list[float]:
        twist, weight = x[2] - x[0], WEIGHT * (t < end)
        force = k * (twist - np.clip(twist, -half, half))
        return [x[1], (force - weight * np.sin(x[0])) / I, x[3],
                (np.clip(weight * np.sin(x[2]), -limit, limit) - force) / inertia]  # fmt: skip

    run = tl.simulate(scene(fx.Release(fx.Gravity(), at=end), drive, v=2.0, duration=1.0), accuracy=1e-8)
    before = solve_ivp(rate, (0.0, end), [0.0, 2.0, 0.0, 2.0], "DOP853", rtol=1e-11, atol=1e-12, max_step=1e-3).y[:, -1]
    guards = [lambda _, x: x[2] - x[0] - half, lambda _, x: x[2] - x[0] + half]
    after = solve_ivp(rate, (end, 1.0), before, "DOP853", rtol=1e-11, atol=1e-12, max_step=1e-3, events=guards)
    assert_near(run.q[-1, 0], after.y[0, -1], 1e-7)
    times = np.sort(np.concatenate(after.t_events))
    assert len(times) >= 2
    assert_near([event.t for event in run.events if event.t > end], times, 1e-6)


def test_backlash_makes_a_limit_cycle() -> None:
    """Integral control by the load's side hunts; by the motor's side the load rests (Nordin, Gutman 2002)."""
    hunting = {}
    for side in ("joint", "motor"):
        pid = fx.PID(of_all(0.5), of_all(20.0), of_all(20.0), of_all(4.0), side=side)
        drive = fx.Backlash(pid, of_all(300.0), of_all(0.05), of_all(0.0), of_all(50.0), of_all(0.2))
        run = tl.simulate(scene(drive, fx.JointDamping(of_all(0.3)), duration=8.0), verify=False)
        hunting[side] = np.ptp(run.q[run.t > 6.0, 0])
    assert hunting["joint"] > 0.05
    assert hunting["motor"] < 1e-3


def test_backlash_limit_cycle_by_exact_pieces() -> None:
    """Linear between contacts: matrix exponentials of (q, v, theta, w, integral, 1) from one contact to the next."""
    k, inertia, half, damping, kp, ki, kd, target, end, h = 50.0, 0.5, 0.1, 2.0, 8.0, 8.0, 0.5, 0.5, 10.0, 2e-3
    pid = fx.PID(of_all(target), of_all(kp), of_all(ki), of_all(kd))
    drive = fx.Backlash(pid, of_all(k), of_all(inertia), gap=of_all(2 * half))
    run = tl.simulate(scene(drive, fx.JointDamping(of_all(damping)), duration=end), accuracy=1e-6)

    def system(side: int) -> np.ndarray:
        a, pressed = np.zeros((6, 6)), abs(side) * k * np.array([-1.0, 0.0, 1.0, 0.0, 0.0, -side * half])
        a[0, 1] = a[2, 3] = 1.0
        a[1] = (np.array([0.0, -damping, 0.0, 0.0, 0.0, 0.0]) + pressed) / I
        a[3] = (np.array([-kp, -kd, 0.0, 0.0, 1.0, kp * target]) - pressed) / inertia
        a[4, [0, 5]] = -ki, ki * target
        return a

    def room(x: np.ndarray, side: int) -> float:
        """To the flank: from inside the gap, or from outside."""
        return half - (side * (x[2] - x[0]) if side else abs(x[2] - x[0]))

    t, x, side, exact, met = 0.0, np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0]), 0, np.zeros_like(run.t), []
    while t < end:
        a, n = system(side), 1
        step = expm(a * h)
        after = step @ x
        while room(after, side) * (1 if side == 0 else -1) > 0.0 and t + n * h < end + h:
            after, n = step @ after, n + 1
        crossed = room(after, side) * (1 if side == 0 else -1) <= 0.0
        length = brentq(lambda dt, a=a, x=x, side=side: room(expm(a * dt) @ x, side), (n - 1) * h or 1e-9, n * h,
                        xtol=1e-13) if crossed else np.inf  # fmt: skip
        for i in np.flatnonzero((run.t >= t) & (run.t < t + length)):
            exact[i] = (expm(a * (run.t[i] - t)) @ x)[0]
        if crossed:
            x = expm(a * length) @ x
            met.append(t + length)
        t, side = t + length, 0 if side else int(np.sign(x[2] - x[0]))
    assert_near([event.t for event in run.events], [at for at in met if at < end], 1e-5)
    assert_within(run.q[:, 0], exact, run.error + 1e-11)
    early, late = (np.ptp(run.q[(run.t > t) & (run.t < t + 2.5), 0]) for t in (5.0, 7.5))
    assert late == pytest.approx(early, rel=0.05)  # it goes on
    assert late > half


def test_a_drive_without_a_torque_is_told_what_is_missing() -> None:
    robot = tl.load_robot("two_link")
    for of, told in ((None, "that drives the joints is missing"), (3.0, "float gives no torque")):
        with refusal(tl.errors.SceneError, told, "give a controller"):
            tl.Scene(robot, effects=[fx.ElasticJoint(of, stiffness={"elbow": 1e3}, inertia={"elbow": 0.02})])


PAPER = fx.LuGreFriction({"x": 1e5}, {"x": 1.0}, {"x": 1.5}, {"x": 1e-3}, {"x": np.sqrt(1e5)}, {"x": 0.4})


def lugre(force: Callable[[float, float], float]) -> Callable[..., list[float]]:
    """The block of the paper: m = 1 kg, with Canudas de Wit's parameters of 1995."""

    def rate(t: float, x: Sequence[float]) -> list[float]:
        level = 1 + 0.5 * np.exp(-((x[1] / 1e-3) ** 2))
        slip = x[1] - 1e5 * abs(x[1]) * x[2] / level
        return [x[1], force(t, x[0]) - 1e5 * x[2] - np.sqrt(1e5) * slip - 0.4 * x[1], slip]

    return rate


def test_lugre_presliding_of_the_paper() -> None:
    """95 % of the break-away force moves the block 15 um ln 20 = 45 um, and it stays; back and forth is a loop."""
    ramp = fx.Sampled((0.0, 10.0, 15.0, 35.0, 40.0, 60.0), (0.0, 1.425, 1.425, -1.425, -1.425, 1.425))
    times = [10.0, 15.0, 25.0, 35.0, 40.0, 50.0, 60.0]
    run = solved(slider(), [PAPER, fx.Torque({"x": ramp})], 60.0, accuracy=1e-8, t_eval=times)
    up, held, middle, down, _, back, again = 1e6 * run.q[:, 0]
    exact = 15 * np.log(20)
    assert up == pytest.approx(exact, rel=0.02)
    assert held == pytest.approx(up, rel=0.02)
    # From z_m on, down to -z_m: x falls by 15 um ln((1 + 0.95) / (1 - 0.95)).
    assert up - down == pytest.approx(15 * np.log(1.95 / 0.05), rel=0.02)
    assert middle - back > 10.0  # um: hysteresis at zero force
    assert again - down == pytest.approx(up - down, rel=0.05)


def test_lugre_stick_slip_of_the_paper() -> None:
    """k = 2 N/m pulled at 0.1 m/s: it sticks till the spring gives 1.5 N, then jumps; against SciPy's Radau."""
    pulled = [PAPER, fx.JointSpring({"x": 2.0}), fx.Torque({"x": fx.Polynomial((0.0, 0.2))})]
    run = solved(slider(), pulled, 15.0, accuracy=1e-5)
    exact = by_scipy(lugre(lambda t, x: 2.0 * (0.1 * t - x)), np.zeros(3), run.t, "Radau")
    assert_near(run.q[:, 0], exact[0], 1e-5)
    spring = 2.0 * (0.1 * run.t - run.q[:, 0])
    assert_near(spring.max(), 1.5, 0.02)
    sticks = np.abs(run.v[:, 0]) < 1e-3
    assert 0.3 < sticks.mean() < 0.95
    assert np.count_nonzero(np.diff(sticks.astype(int)) == -1) >= 2  # jumps


def muscle_rate(arm: float, u: Callable[[float], float]) -> Callable[..., list[float]]:
    """Thelen's muscle on the wheel, beside another with constant excitation: a second implementation."""

    def force(a: float, length: float, speed: float) -> float:
        active = np.exp(-((length - 1) ** 2) / 0.45)
        if speed < 0:
            by_speed = max(0.0, (1 + speed) / (1 - speed / 0.25))
        else:
            by_speed = (0.4 + 10 * 1.4 * speed) / (0.4 + 10 * speed)
        passive = np.expm1(5 / 0.6 * (length - 1)) / np.expm1(5) if length > 1 else 0.0
        return 800 * (a * active * by_speed + passive)

    def rate(t: float, x: Sequence[float]) -> list[float]:
        q, v, a, b = x
        tau = sum(r * force(own, 1 - r * q / 0.1, -r * v / 1.0) for r, own in ((arm, a), (-arm, b)))
        rates = [(e - own) / (0.015 * (0.5 + 1.5 * own) if e > own else 0.05 / (0.5 + 1.5 * own))
                 for e, own in ((u(t), a), (0.3, b))]  # fmt: skip
        return [v, (tau - WEIGHT * np.sin(q)) / I, *rates]

    return rate


def test_muscles_against_scipy() -> None:
    effects = [fx.Gravity(), fx.Muscle("flexor", {J: 0.03}, 800.0, 0.1, fx.Sine(0.4, 4.0, mean=0.5), start=0.1),
               fx.Muscle("extensor", {J: -0.03}, 800.0, 0.1, 0.3)]  # fmt: skip
    run = tl.simulate(scene(*effects, duration=2.0), accuracy=1e-8)
    exact = by_scipy(muscle_rate(0.03, lambda t: 0.5 + 0.4 * np.sin(4 * t)), [0, 0, 0.1, 0], run.t)
    assert_near(run.q[:, 0], exact[0], 1e-7)
    assert_near(run.states["flexor.activation"], exact[2], 1e-7)
    assert run.q[:, 0].max() > 0.3


@pytest.mark.parts
def test_what_does_not_follow_states_refuses() -> None:
    for ask in (
        lambda: tl.equilibria(LAGGED),
        lambda: tl.lqr(LAGGED, np.eye(2), np.eye(1)),
        lambda: tl.periodic_motion(LAGGED, 1.0),
    ):
        with refusal(tl.errors.SceneError, code="states-of-effects"):
            ask()
    ball = tl.load_robot("bouncing_ball")
    ground = fx.Contact(("ground",), shapes={"ball": (fx.Sphere(0.1),)})
    lag = fx.ActuatorLag(fx.Torque({"height": 1.0}), {"height": 0.1})
    stepped = tl.Scene(ball, [0.5], effects=[fx.Gravity(), ground, lag])
    with refusal(tl.errors.SceneError, code="not-stepped"):
        tl.simulate(stepped, contact="stepped")


@pytest.mark.parametrize(("effect", "where"), [
    (fx.ActuatorLag(None, of_all(0.1)), "of"),
    (fx.ActuatorLag(fx.DryFriction(of_all(1.0)), of_all(0.1)), "of"),
    (fx.ActuatorLag(fx.Torque({"axel": 1.0}), of_all(0.1)), "of.inputs"),
    (fx.ActuatorLag(fx.Torque(of_all(1.0)), of_all(0.0)), "time.axle"),
    (fx.Gear(fx.Torque(of_all(1.0)), of_all(0.0)), "ratio.axle"),
    (fx.Gear(fx.Torque(of_all(1.0)), of_all(9.0), of_all(1.2)), "efficiency.axle"),
    (fx.Gear(fx.GravityCompensation(), of_all(9.0)), "of"),
    (fx.Gear(fx.ActuatorLag(fx.ComputedTorque(of_all(1.0), 1.0, 1.0), of_all(0.1)), of_all(9.0)), "of"),
    (fx.ElasticJoint(fx.Gear(fx.Torque(of_all(1.0)), of_all(9.0), inertia=of_all(9.0)), of_all(9.0), {J: 9.0}), "of"),
    (fx.Gear(fx.JointPD(of_all(1.0), of_all(1.0), effort="urdf"), of_all(9.0)), "of"),
    (fx.Gear(fx.ElasticJoint(fx.Controller(lambda _, y, s: (y.q, s), limit="urdf"), of_all(9.0), of_all(1.0)),
             of_all(9.0)), "of"),
    (fx.DCMotor(fx.PID(of_all(1.0), of_all(1.0), effort="urdf"), of_all(1.0), of_all(1.0), of_all(1.0)), "of"),
    (fx.DCMotor(resistance=of_all(1.0), inductance=of_all(1.0)), "constant"),
    (fx.ElasticJoint(fx.Torque(of_all(1.0)), of_all(9.0)), "inertia"),
    (fx.Backlash(fx.Torque(of_all(1.0)), of_all(9.0), of_all(1.0)), "gap"),
    (fx.LuGreFriction(of_all(9.0), of_all(1.0), of_all(2.0)), "stribeck"),
    (fx.PID(of_all(1.0), of_all(0.0), of_all(1.0), effort=of_all(1.0)), "tracking.axle"),
    (fx.Muscle("m", of_all(0.1), 9.0, 0.1, 1.5), "excitation"),
    (fx.Muscle("m", of_all(0.1), 9.0, 0.1, 0.5, start=-0.1), "start"),
    (fx.Muscle("m", of_all(0.1), 9.0, 0.1, fx.Sampled((0.0, 0.5), (0.0, 80.0))), "excitation"),  # in percent
    (fx.Muscle("m", of_all(0.1), 9.0, 0.1, fx.Sine(0.5, 3.0, mean=0.4)), "excitation"),
    (fx.Muscle("m", of_all(0.1), 9.0, 0.1, fx.Bezier((0.0, 0.5, 1.2), 1.0)), "excitation"),
    (fx.Muscle("m", of_all(0.1), 9.0, 0.1, fx.Polynomial((-0.2, 1.0))), "excitation"),
])  # fmt: skip
def test_refusals(effect: fx.Effect, where: str) -> None:
    with pytest.raises(tl.errors.SceneError) as caught:
        scene(effect)
    assert str(caught.value.where).startswith(f"effects[0].{where}")
    assert caught.value.remedy


class Valve(fx.Effect, frozen=True):
    """An effect of a user's own with a state: p' = c (u - p), force p."""

    joint: str
    c: float

    def states(self, motion: KinematicState) -> dict[str, float]:
        del motion
        return {"pressure": 0.0}

    def act(self, motion: KinematicState, loads: Loads) -> None:
        loads.rates["pressure"] = self.c * (1.0 - motion.states["pressure"])
        loads.torque(motion.coordinate(self.joint)[1], motion.states["pressure"])


def test_states_of_an_effect_of_ones_own_in_files_and_tables(tmp_path: Path) -> None:
    run = tl.simulate(scene(Valve(J, 20.0)), accuracy=1e-9)
    assert_near(run.states["pressure"], 1 - np.exp(-20 * run.t), 1e-9)
    for name in ("run.npz", "run.csv", "run.parquet"):
        again = tl.Trajectory.load(run.save(tmp_path / name), WHEEL)
        assert np.array_equal(again.states["pressure"], run.states["pressure"])
    assert run.to_dict()["states"] == {"pressure": run.states["pressure"][-1]}
    assert np.array_equal(run.to_xarray()["z.pressure"].values, run.to_pandas()["z.pressure"])
    text = tl.explain(scene(Valve(J, 20.0))).text()
    assert "3 states" in text
    assert "pressure" in text


def test_states_in_quadruple_precision() -> None:
    run = tl.simulate(LAGGED, accuracy=1e-18)
    assert run.error.max() < 1e-18
    assert run.precise.shape[1] == 3


def test_two_of_a_kind_are_refused() -> None:
    twice = scene(*LAGGED.effects, *map(copy.copy, LAGGED.effects))
    with refusal(tl.errors.SceneError, code="state-twice"):
        tl.simulate(twice)
