"""Dry friction that sticks: closed forms, and a second integration piece by piece on equations derived by hand."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import twolink as tl
from tests.effects.bodies import G, kinds, slider, sliders, solved, times
from tests.effects.cases import E, robot
from tests.near import assert_near
from tests.refusals import refusal
from tests.urdf_text import joint, link, robot_of
from twolink.errors import AccuracyError


def spring_and_friction(t: np.ndarray, amplitude: float, w: float, shift: float) -> np.ndarray:
    """x of a mass on a spring with friction, shift = c / k: half a cosine about +-shift, until |x| <= shift."""
    x, start, out = amplitude, 0.0, np.empty_like(t)
    while abs(x) > shift:
        middle = np.copysign(shift, x)
        inside = t >= start
        out[inside] = middle + (x - middle) * np.cos(w * (t[inside] - start))
        x, start = 2 * middle - x, start + np.pi / w
    out[t >= start] = x
    return out


@pytest.mark.parametrize("accuracy", [1e-3, 1e-6, 1e-9])
def test_mass_on_a_spring_loses_2c_over_k_a_half_cycle_and_sticks(accuracy: float) -> None:
    run = solved(slider(), [E.JointSpring({"x": 100.0}), E.DryFriction({"x": 3.0})], 8.0, [1.0], accuracy=accuracy)
    off = np.abs(run.q[:, 0] - spring_and_friction(run.t, 1.0, 10.0, 0.03))
    assert np.all(off <= run.error + 1e-15)
    assert run.error[-1] <= accuracy
    stuck = run.t > 17 * np.pi / 10 + 1e-9
    assert np.all(run.v[stuck] == 0)
    assert np.ptp(run.q[stuck]) < 1e-14
    assert kinds(run)[-1] == "stick"
    assert_near(times(run, "stick"), [17 * np.pi / 10], 10 * accuracy)


@pytest.mark.parametrize("levels", [(3.0,), (1.0, 2.0)], ids=["one", "two that add up"])
def test_a_sliding_block_stops_for_good(levels: tuple[float, ...]) -> None:
    effects = [E.DryFriction({"x": level}) for level in levels]
    run = solved(slider(), effects, 2.0, v=[2.0])
    assert_near(run.q[:, 0], np.where(run.t < 2 / 3, 2 * run.t - 1.5 * run.t**2, 2 / 3), 1e-12)
    assert kinds(run) == ["stick"]


def test_static_friction_above_kinetic_holds_until_the_ramp_exceeds_it() -> None:
    run = solved(slider(), [E.DryFriction({"x": 3.0}, {"x": 5.0}), E.Torque({"x": E.Polynomial((0.0, 2.0))})], 4.0)
    t = np.fmax(run.t, 2.5)
    expected = (t**3 - 2.5**3) / 3 - 2.5**2 * (t - 2.5) - 1.5 * (t - 2.5) ** 2
    assert_near(run.q[:, 0], expected, 1e-9)
    assert_near(times(run, "slip"), [2.5], 1e-12)


@pytest.mark.parametrize(("load", "static"), [(2.999, 3.0), (3.0, 3.0), (5.0, 5.0), (0.0, 3.0)])
def test_what_is_not_above_static_friction_moves_nothing(load: float, static: float) -> None:
    """The very edge included: it is not more than s."""
    run = solved(slider(), [E.DryFriction({"x": 3.0}, {"x": static}), E.Torque({"x": load})], 3.0)
    assert np.all(run.q == 0)
    assert not run.events


def test_a_load_equal_to_kinetic_friction_keeps_the_speed() -> None:
    run = solved(slider(), [E.DryFriction({"x": 3.0}), E.Torque({"x": 3.0})], 3.0, v=[1.0])
    assert_near(run.q[:, 0], run.t, 1e-12)


def test_a_step_of_the_load_between_samples_of_a_table() -> None:
    """Held below 3 N, pulled by 4 N from t = 1, and braked from t = 2: q = 1/2, v = 1, stops after 1/3 s at 2/3 m."""
    table = E.Sampled((0.0, 1.0, 2.0, 4.0), (2.9, 4.0, 0.0, 0.0), interpolation="hold")
    run = solved(slider(), [E.DryFriction({"x": 3.0}), E.Torque({"x": table})], 4.0)
    assert_near(run.q[-1, 0], 2 / 3, 1e-12)
    assert [(e.kind, round(e.t, 12)) for e in run.events] == [("slip", 1.0), ("stick", round(7 / 3, 12))]


def driven(duration: float, size: float, w: float, c: float) -> list[tuple[float, float, float]]:
    """(start, x, sign) of the slips of 1 kg driven by size sin(w t) against friction c, each to its stop."""
    t, x, found = 0.0, 0.0, []
    while t < duration:
        force = size * np.sin(w * t)
        if abs(force) <= c:  # held: until the drive exceeds c
            edge = np.arcsin(c / size)
            candidates = [(n * np.pi + edge) / w for n in range(int(w * t / np.pi) - 1, int(w * t / np.pi) + 3)]
            t = min(a for a in candidates if a > t + 1e-12)
            if t >= duration:
                break
        sign = np.sign(np.sin(w * t))
        found.append((t, x, sign))
        speed = lambda s, t=t, sign=sign: size / w * (np.cos(w * t) - np.cos(w * s)) - sign * c * (s - t)  # noqa: E731
        grid = t + np.linspace(1e-3, 2 * np.pi / w, 400)
        after = int(np.argmax(sign * speed(grid) <= 0))
        stop = brentq(speed, grid[after - 1], grid[after], xtol=1e-15)
        x += place(stop, t, sign, size, w, c)
        t = stop
    return found


def place(s: float, t: float, sign: float, size: float, w: float, c: float) -> float:
    """How far a slip that started at t has come at s."""
    return (size / w * np.cos(w * t) * (s - t) - size / w**2 * (np.sin(w * s) - np.sin(w * t))
            - sign * c * (s - t) ** 2 / 2)  # fmt: skip


def test_a_hundred_seconds_of_driven_stick_slip() -> None:
    size, w, c = 5.0, 3.0, 3.0
    effects = [E.DryFriction({"x": c}), E.Torque({"x": E.Sine(size, w)})]
    run = solved(slider(), effects, 100.0, accuracy=1e-8, samples_per_second=20)
    slips = driven(100.0, size, w, c)
    assert len(slips) > 90
    start, x, sign = slips[-1]
    assert len(times(run, "slip")) == len(slips)
    assert_near(times(run, "slip"), [s for s, _, _ in slips], 1e-8)
    at = np.searchsorted(run.t, start) + 2
    moved = place(run.t[at], start, sign, size, w, c)
    assert abs(run.q[at, 0] - x - moved) <= run.error[at]


def arm_pieces(q: list[float], v: list[float], c: np.ndarray, s: np.ndarray, end: float) -> tuple[np.ndarray, list]:
    """(state at the end, events) of the bundled arm with friction: Lagrange's equations by solve_ivp with events."""

    def accelerate(x: np.ndarray, slip: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(a, the torques that hold those of slip 0)."""
        q1, q2, v1, v2 = x
        m = np.array([[7 / 3 + np.cos(q2), 1 / 3 + np.cos(q2) / 2], [1 / 3 + np.cos(q2) / 2, 1 / 3]])
        h = np.array([-np.sin(q2) * (v1 * v2 + v2**2 / 2) + G * (2.5 * np.cos(q1) + np.cos(q1 + q2) / 2),
                      np.sin(q2) * v1**2 / 2 + G * np.cos(q1 + q2) / 2])  # fmt: skip
        free = slip != 0
        a, tau = np.zeros(2), -slip * c
        if free.any():
            a[free] = np.linalg.solve(m[np.ix_(free, free)], (tau - h)[free])
        return a, np.where(free, 0.0, m @ a + h)

    def settle(x: np.ndarray, slip: np.ndarray) -> np.ndarray:
        """Hold what is at rest, but for what needs more than s, the worst first."""
        slip = np.where(x[2:] == 0, 0.0, slip)
        while True:
            held = accelerate(x, slip)[1]
            over = np.where(slip == 0, np.abs(held) - s, -1.0)
            worst = int(np.argmax(over))
            if over[worst] <= 1e-10:
                return slip
            slip[worst] = -np.sign(held[worst])

    x, t, slip, noted = np.array([*q, *v]), 0.0, np.sign(v), []
    slip = settle(x, slip)
    while t < end:
        watch = []
        for k in range(2):

            def event(_t: float, x: np.ndarray, k: int = k, slip: np.ndarray = slip) -> float:
                return slip[k] * x[2 + k] if slip[k] else s[k] - abs(accelerate(x, slip)[1][k])

            event.terminal, event.direction = True, -1
            watch.append(event)
        found = solve_ivp(lambda _t, x, slip=slip: np.concatenate([x[2:], accelerate(x, slip)[0]]), (t, end), x,
                          "DOP853", events=watch, rtol=1e-12, atol=1e-13)  # fmt: skip
        t, x = found.t[-1], found.y[:, -1].copy()
        hit = [k for k in range(2) if found.t_events[k].size]
        if not hit:
            break
        k = hit[0]
        before = slip.copy()
        if slip[k]:
            x[2 + k] = 0.0
            slip = settle(x, slip)
        else:
            slip[k] = -np.sign(accelerate(x, slip)[1][k])
        if (before[k] == 0) != (slip[k] == 0):
            noted.append((t, "stick" if slip[k] == 0 else "slip", k))
    return x, noted


def test_both_joints_of_the_arm_stick_slip_and_reverse() -> None:
    c, s = np.array([2.0, 0.5]), np.array([4.0, 1.5])
    names = ("shoulder", "elbow")
    effect = E.DryFriction(dict(zip(names, c, strict=True)), dict(zip(names, s, strict=True)))
    start = [0.9, 0.4], [1.0, 0.0]
    x, noted = arm_pieces(*start, c, s, 12.0)
    run = tl.simulate(tl.Scene(robot("arm"), *start, effects=[E.Gravity(), effect]), 12.0, accuracy=1e-8)
    assert_near(run.q[-1], x[:2], 1e-8)
    ours = [(e.kind, e.what) for e in run.events if e.kind in ("stick", "slip")]
    assert ours == [(kind, names[k]) for _, kind, k in noted]
    assert len(ours) >= 4
    reported = [e.t for e in run.events if e.kind in ("stick", "slip")]
    assert_near(reported, [t for t, _, _ in noted], 1e-6)


def test_the_energy_lost_is_the_friction_over_the_way_in_a_closed_loop() -> None:
    """A slider-crank in gravity with friction on its slide: E falls by c times the way, and it ends at rest."""
    given = tl.load_scene("crankshaft")
    start = {"crank_joint": 8.0, "rod_joint": -8.0 * (1 + 0.1 / 0.3)}
    effects = [E.Gravity((0.0, -9.81, 0.0)), given.effects[0], E.DryFriction({"slide": 0.8}, {"slide": 1.1})]
    v = [start.get(n, 0.0) for n in given.robot.joint_names]
    run = solved(given.base, effects, 2.0, given.q, v, samples_per_second=4000)
    slide = np.asarray(run.columns()["q.slide"])
    way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(slide)))])
    assert way[-1] > 0.2
    turns = 4 * np.abs(np.diff(slide)).max() * 0.8  # a reversal between two samples hides some way
    assert_near(run.energy[0] - run.energy, 0.8 * way, turns)


def test_one_of_two_coupled_joints_with_friction() -> None:
    """1 kg and 2 kg move as one: 3 x'' = t - 2 from t = 2 on; the friction of a joint that does not move on its own."""
    effects = [E.Coupling("one", "two", 1.0), E.DryFriction({"two": 2.0}), E.Torque({"one": E.Polynomial((0.0, 1.0))})]
    run = solved(sliders(), effects, 4.0)
    expected = np.fmax(run.t - 2, 0) ** 3 / 18
    assert_near(run.q, expected[:, None], 1e-9)
    assert_near(times(run, "slip"), [2.0], 1e-9)


@pytest.mark.parametrize("ratio", [1.0, -2.0, 0.5])
@pytest.mark.parametrize("static", [(2.0, 1.0), (3.0, 2.5)], ids=["as kinetic", "above kinetic"])
def test_coupled_joints_with_friction_hold_what_both_can(ratio: float, static: tuple[float, float]) -> None:
    """1 kg and 2 kg: (1 + 2 r^2) x'' = t - c_1 - |r| c_2 from t = s_1 + |r| s_2 on, and before that they rest."""
    friction = E.DryFriction({"one": 2.0, "two": 1.0}, dict(zip(("one", "two"), static, strict=True)))
    effects = [E.Coupling("two", "one", ratio), friction, E.Torque({"one": E.Polynomial((0.0, 1.0))})]
    run = solved(sliders(), effects, 9.0)
    begin, brake, mass = static[0] + abs(ratio) * static[1], 2.0 + abs(ratio), 1 + 2 * ratio**2
    late, first = np.fmax(run.t, begin) - brake, begin - brake
    expected = ((late**3 - first**3) / 6 - first**2 * (late - first) / 2) / mass
    assert_near(run.q, expected[:, None] * [1.0, ratio], 1e-9)
    assert_near(times(run, "slip")[:1], [begin], 1e-9)


@pytest.mark.parametrize("load", [-4.49, 4.49])
def test_coupled_joints_rest_under_a_load_that_one_of_them_alone_does_not_hold(load: float) -> None:
    effects = [E.Coupling("two", "one", -0.5), E.DryFriction({"one": 3.0, "two": 3.0}), E.Torque({"one": load})]
    run = solved(sliders(), effects, 1.0)
    assert np.all(run.q == 0)
    assert not run.events


def test_joints_of_a_four_bar_with_friction_hold_what_all_can() -> None:
    """A parallelogram, whose angles change alike: the load at its crank is that of all three when it begins to slip."""
    given = tl.load_scene("four-bar")
    static = {"left": 0.5, "left_top": 0.6, "middle": 0.7}
    effects = [*given.effects[1:], E.Torque({"left": E.Polynomial((0.0, 4.0))}),
               E.DryFriction(dict.fromkeys(static, 0.3), static)]  # fmt: skip
    run = solved(given.base, effects, 0.5, given.q)
    assert_near(times(run, "slip"), [sum(static.values()) / 4.0], 1e-9)
    assert np.all(run.v[run.t < 0.45] == 0)


def test_friction_of_a_joint_that_follows_two_others() -> None:
    """x_3 = x_1 + x_2, held up to s_1 + min(s_2, s_3); which give way first is told where s is the kinetic friction."""
    three = tl.load_robot(robot_of(
        *(link(name) for name in "abc"), joint("one", "prismatic", "ground", "a", "1 0 0"),
        joint("two", "prismatic", "a", "b", "1 0 0"), joint("three", "prismatic", "ground", "c", "1 0 0")))  # fmt: skip
    kinetic = {"one": 1.0, "two": 2.0, "three": 4.0}
    effects = [E.PointLoop("b", "c"), E.Torque({"one": E.Polynomial((0.0, 1.0))})]
    run = solved(three, [*effects, E.DryFriction(kinetic)], 5.0)
    expected = np.fmax(run.t - 3.0, 0.0) ** 3 / 6
    assert_near(run.columns()["q.one"], expected, 1e-9)
    assert_near(run.columns()["q.three"], 0.0, 1e-12)
    with refusal(AccuracyError, code="indeterminate-forces", match="static friction of joint 'one'"):
        solved(three, [*effects, E.DryFriction(kinetic, {"one": 1.5})], 5.0)


def test_friction_of_nothing_is_no_friction() -> None:
    run = solved(slider(), [E.JointSpring({"x": 4.0}), E.DryFriction({"x": 0.0})], 10.0, [1.0])
    assert_near(run.q[:, 0], np.cos(2 * run.t), 1e-9)
