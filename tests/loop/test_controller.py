"""Sampled controllers: exact loops, delays, rates and thresholds; and what is refused."""

import itertools
import math
import re
from fractions import Fraction

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import twolink as tl
from tests.loop.loops import exact_pd, pd, slider
from twolink.errors import AccuracyError, ControllerError, SceneError

E = tl.effects


@pytest.mark.parametrize(("period", "delay"), [("1/20", "0"), ("1/20", "1/50"), ("1/30", "1/20"), ("1/8", "3/8")])
def test_double_integrator_with_hold_and_delay_is_exact(period: str, delay: str) -> None:
    """Against rational arithmetic from instant to instant: the delay is in seconds, and may be several periods."""
    tick, late = Fraction(period), Fraction(delay)
    control = E.Controller(pd, period=tick, delay=float(late))
    times = [Fraction(k, 10) for k in range(41)]
    scene = tl.Scene(slider(), [1.0], effects=[control])
    run = tl.simulate(scene, 4.0, accuracy=1e-9, t_eval=[float(t) for t in times])
    exact = exact_pd(Fraction(1), tick, late, times)
    off = np.abs(run.q[:, 0] - [float(q) for q, _ in exact])
    assert off.max() < 1e-12
    assert (off <= run.error).all()
    assert np.abs(run.v[:, 0] - [float(v) for _, v in exact]).max() < 1e-12
    between = np.array([0.013, 1.237])
    assert np.abs(run.at(between)[0] - tl.simulate(scene, 4.0, accuracy=1e-9, t_eval=between).q).max() < 1e-13


def test_each_world_has_its_own_controller() -> None:
    """Worlds of other starts and delays against rational arithmetic; a state that is changed in place is a world's."""
    scene = tl.Scene(slider(), [1.0], effects=[E.Controller(pd, period=0.05)])
    starts, delays = [1.0, -0.5, 2.0], [0.0, 0.02, 0.075]
    worlds = tl.simulate_many(scene, 2.0, q=np.array(starts)[:, None], parameters={"effects.0.delay": delays})
    for q, late, end, bar in zip(starts, delays, worlds.q[:, 0], worlds.error, strict=True):
        exact = exact_pd(Fraction(q), Fraction(1, 20), Fraction(late).limit_denominator(1000), [Fraction(2)])
        assert abs(end - float(exact[-1][0])) < min(1e-12, bar)
    counting = E.Controller(lambda _, __, s: (s.append(1) or [len(s) * 0.01], s), period=0.1, state=[])
    same = tl.simulate_many(tl.Scene(slider(), effects=[counting]), 1.0, q=np.zeros((3, 1)))
    assert np.ptp(same.q) == 0.0
    assert same.q[0, 0] == pytest.approx(sum(0.01 * 0.01 * k * (0.5 + 10 - k) for k in range(1, 11)), abs=1e-14)


def test_worlds_have_noise_of_their_own_by_the_seed() -> None:
    law = E.Controller(lambda _, y, s: (-4.0 * y.encoder, s), period=0.05, inputs=("encoder",))
    scenes = [tl.Scene(slider(), [1.0], effects=[E.Encoder(("rail",), period=0.05, noise=1e-3, seed=seed), law])
              for seed in (1, 2)]  # fmt: skip
    ends = [tl.simulate(scene, 0.5, accuracy=1e-6).q[-1, 0] for scene in scenes]
    worlds = tl.simulate_many(scenes[0], 0.5, parameters={"effects.0.seed": [1, 2, 2]})
    assert worlds.q[:, 0] == pytest.approx([*ends, ends[1]], abs=1e-14)
    assert abs(ends[0] - ends[1]) > 1e-5


def test_a_controller_that_fails_in_a_world_is_named() -> None:
    control = E.Controller(lambda _, y, s: ([1.0 / float(y.q[0] - 2.0)], s), period=0.1)
    with pytest.raises(ControllerError, match=r"world 1, effects\[0\] at t = 0 s.*ZeroDivisionError") as refused:
        tl.simulate_many(tl.Scene(slider(), effects=[control]), 1.0, q=[[0.0], [2.0]])
    assert refused.value.code == "controller-failed"
    assert "Traceback" in refused.value.data["traceback"]


def test_a_controller_that_fails_in_a_world_leaves_its_motion_so_far() -> None:
    control = E.Controller(lambda t, _, s: ([2.0 / (t < 0.25)], s), period=0.1)
    with pytest.raises(ControllerError, match=r"world 0, effects\[0\] at t = 0.3 s") as refused:
        tl.simulate_many(tl.Scene(slider(), effects=[control]), 1.0, q=[[0.5], [2.0]])
    run = refused.value.run
    assert isinstance(run, tl.Trajectory)
    assert 0.2 < run.end <= 0.3
    assert run.at(0.2)[0][0] == pytest.approx(0.5 + 0.2**2, abs=1e-12)  # 2 N on 1 kg


def pid(_: float, y: object, state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    e = np.array([0.5, -0.3]) - y.q
    state = state + 0.01 * e
    return 40.0 * e + 30.0 * state - 8.0 * y.v, state


def test_pid_on_the_arm_against_an_independent_integration() -> None:
    """SciPy's DOP853 at 1e-13 on Pinocchio's forward dynamics, from instant to instant; a second, slower controller."""
    bundled = tl.load_scene("arm-swing")
    names = bundled.robot.joint_names
    push = E.Controller(lambda t, _, s: ([math.sin(3.0 * t)], s), period=Fraction(1, 30), outputs=names[1:])
    control = E.Controller(pid, period=0.01, delay=0.013, state=np.zeros(2), limit={names[0]: 15.0})
    scene = tl.Scene(bundled.base, bundled.q, bundled.v, [*bundled.effects, control, push])
    run = tl.simulate(scene, 2.0, accuracy=1e-9, t_eval=[0.0, 1.0, 2.0])
    robot, x, state = scene.robot, np.concatenate([scene.q, scene.v]), np.zeros(2)
    held, slow, queue = np.zeros(2), np.zeros(2), []
    late = Fraction(13, 1000)
    instants = sorted({Fraction(k, 100) + d for k in range(199) for d in (0, late)}
                      | {Fraction(k, 30) for k in range(61)} | {Fraction(199, 100)})  # fmt: skip
    for begin, end in itertools.pairwise(instants):
        if (begin * 100).denominator == 1:
            e = np.array([0.5, -0.3]) - x[:2]
            state = state + 0.01 * e
            u = 40.0 * e + 30.0 * state - 8.0 * x[2:]
            queue.append((begin + late, np.array([np.clip(u[0], -15.0, 15.0), u[1]])))
        if (begin * 30).denominator == 1:
            slow = np.array([0.0, math.sin(3.0 * float(begin))])
        while queue and queue[0][0] == begin:
            held = queue.pop(0)[1]
        tau = held + slow

        def rate(_: float, x: np.ndarray, tau: np.ndarray = tau) -> np.ndarray:
            return np.concatenate([x[2:], robot.forward_dynamics(x[:2], x[2:], tau)])

        x = solve_ivp(rate, (float(begin), float(end)), x, "DOP853", rtol=1e-13, atol=1e-13).y[:, -1]
        if end in (1, 2):
            off = np.abs(run.q[int(end)] - x[:2]).max()
            assert off < min(1e-11, run.error[int(end)])
    assert run.tau[0] == pytest.approx([0.0, 0.0])


def test_ticks_are_exact_and_every_solution_has_its_own_state() -> None:
    seen = []

    def update(t: float, _: object, calls: int) -> tuple[list[float], int]:
        seen.append((t, calls))
        return [0.1], calls + 1

    tl.simulate(tl.Scene(slider(), effects=[E.Controller(update, period=1e-3, state=0)]), 0.5, verify=False)
    times = dict.fromkeys(t for t, _ in seen)
    assert list(times) == [k / 1000 for k in range(501)]
    assert all(calls == round(1000 * t) for t, calls in seen)


@pytest.mark.parametrize("verify", [False, True])
@pytest.mark.parametrize("duration", [0.1 * 3, np.nextafter(0.3, 0.0), 0.3])
@pytest.mark.parametrize("friction", [0.0, 0.1])
def test_a_tick_at_the_end_but_for_rounding_is_at_the_end(friction: float, duration: float, verify: bool) -> None:
    """0.1 * 3 is above 0.3, where there is a tick: nothing is left behind it, and no sample is missing."""
    effects = [] if friction == 0.0 else [E.DryFriction({"rail": friction})]
    law = E.Controller(lambda _t, y, _: (1.0 - 2.0 * y.q - y.v, None), period=Fraction(1, 1000))
    scene, times = tl.Scene(slider(), effects=[*effects, law], duration=duration), np.linspace(0.0, duration, 31)
    run = tl.simulate(scene, t_eval=times, verify=verify)
    np.testing.assert_array_equal(run.t, times)
    later = tl.simulate(scene, 0.31, t_eval=[0.0, 0.3], verify=verify)
    np.testing.assert_allclose(run.q[-1], later.q[-1], atol=1e-14)


def test_jitter_is_the_same_in_every_run_of_a_seed() -> None:
    def times(seed: int) -> list[float]:
        seen: list[float] = []
        control = E.Controller(lambda t, _, s: (seen.append(t), ([0.0], s))[1], period=0.01, jitter=0.004, seed=seed)
        tl.simulate(tl.Scene(slider(), effects=[control]), 0.2, verify=False)
        return sorted(set(seen))

    late = np.array(times(1)) - 0.01 * np.arange(len(times(1)))
    assert times(1) == times(1) != times(2)
    assert (late >= 0.0).all()
    assert (late < 0.004).all()
    assert np.ptp(late) > 0.002


def test_first_order_hold_goes_on_at_the_last_rate() -> None:
    """u_k = t_k: from the second tick on the ramp u = t itself, q = t^3 / 6 but for the first period."""
    control = E.Controller(lambda t, _, s: ([t], s), period=0.1, hold="first")
    run = tl.simulate(tl.Scene(slider(), effects=[control]), 1.0, accuracy=1e-9, t_eval=[0.1, 1.0])
    v = (1.0 - 0.01) / 2
    assert run.v[:, 0] == pytest.approx([0.0, v], abs=1e-12)


def test_what_goes_on_at_a_rate_stays_within_the_limit_until_a_late_tick() -> None:
    """Ticks are up to a period and the jitter apart."""
    control = E.Controller(lambda t, _, s: ([2.5 * np.sin(30.0 * t)], s), period=0.02, jitter=0.018, hold="first",
                           limit={"rail": 2.0})  # fmt: skip
    run = tl.simulate(tl.Scene(slider(), effects=[control]), 1.0, samples_per_second=5000, verify=False)
    assert np.abs(run.tau).max() == pytest.approx(2.0, rel=1e-12)


def test_a_threshold_that_falls_differently_is_named_and_widens_the_bar() -> None:
    """q reaches 0.5 at a tick, on one side or the other by rounding alone."""
    law = E.Controller(lambda _, y, s: ([0.0 if y.q[0] < 0.5 else -1.0], s), period=0.1)
    with pytest.raises(AccuracyError) as refused:
        tl.simulate(tl.Scene(slider(), [0.2], [0.3], effects=[law]), 3.0)
    run = refused.value.run
    assert [event.kind for event in run.events][:1] == ["ambiguous-tick"]
    assert run.events[0].t == pytest.approx(1.0)
    late = np.where(run.t > 1.0, 0.5 * 1.0 * np.minimum(run.t - 1.0, 0.1) ** 2, 0.0)
    assert (run.error[run.t > 1.1] > late[run.t > 1.1]).all()
    assert refused.value.data["trusted_until"] <= 1.1


@pytest.mark.parametrize(
    ("update", "code", "part"),
    [
        (lambda t, _, s: (1.0 / (0.3 - t), s), "controller-failed", "ZeroDivisionError"),
        (lambda *_: ([1.0, 2.0], None), "controller-answer", "shape"),
        (lambda t, _, s: ([math.nan if t > 0.2 else 0.0], s), "controller-answer", "'rail'"),
        (lambda *_: [0.0], "controller-answer", "returns"),
        (lambda *_: ("much", None), "controller-answer", "much"),
        (lambda *_: (np.random.default_rng().normal(size=1), None), "controller-not-repeatable", "another answer"),
        (lambda _, y, s: (y.nothing, s), "controller-failed", "nothing"),
        (lambda _, y, s: (-200.0 * y.v, s), "unstable-loop", "'rail' moves at"),
    ],
)
def test_a_controller_that_fails_is_named_with_its_time(update: object, code: str, part: str) -> None:
    with pytest.raises(ControllerError, match=r"effects\[0\] at t = ") as refused:
        tl.simulate(tl.Scene(slider(), v=[1.0], effects=[E.Controller(update, period=0.1)]), 1.0)
    error = refused.value
    assert error.code == code
    assert part in str(error)
    assert error.run.t[-1] == pytest.approx(error.data["t"])
    assert ("Traceback" in error.data.get("traceback", "")) == (code == "controller-failed")


@pytest.mark.parametrize(("tolerance", "period"), [(1e-6, 0.1), (1e-5, 0.001)])
def test_a_controller_that_fails_at_once_is_named(tolerance: float, period: float) -> None:
    """Before a step has been tried."""
    answers = itertools.count(1.0)
    one = E.Controller(lambda *_: ([next(answers)], None), period=period)
    with pytest.raises(ControllerError, match="gives another answer") as refused:
        tl.simulate(tl.Scene(slider(), effects=[one]), 1.0, method="dop853", tolerance=tolerance)
    assert refused.value.run.t.tolist() == [0.0]


@pytest.mark.parametrize(
    ("fields", "where"),
    [
        ({"update": 3}, "update"),
        ({"period": 0.0}, "period"),
        ({"delay": -1.0}, "delay"),
        ({"jitter": 0.1, "period": 0.1}, "jitter"),
        ({"inputs": ("q", "elephant")}, "inputs"),
        ({"outputs": "rail"}, "outputs"),
        ({"outputs": ("road",)}, "outputs"),
        ({"outputs": ("rail", "rail")}, "outputs"),
        ({"limit": {"road": 1.0}}, "limit"),
        ({"hold": "second"}, "hold"),
    ],
)
def test_fields_that_do_not_fit_are_refused(fields: dict, where: str) -> None:
    with pytest.raises(SceneError) as refused:
        tl.Scene(slider(), effects=[E.Controller(**{"update": pd, **fields})])
    assert refused.value.where == f"effects[0].{where}"


class Ramp:
    """An open loop: u = t."""

    def __call__(self, t: float, *_: object) -> tuple[list[float], None]:
        return [t], None


@pytest.mark.parametrize("vectorized", [False, True])
@pytest.mark.parametrize("law", [lambda t, _, s: (t, s), lambda t, _, s: ([t if t < 9.0 else 0.0], s), Ramp()])
def test_an_open_loop_needs_no_inputs(law: object, *, vectorized: bool) -> None:
    """u = t, held for 0.1 s, in a program, in rows and in calls for each: q after n ticks is a sum of parabolas."""
    if vectorized:
        law = lambda t, y, s: (np.full((len(y.q), 1), t), s)  # noqa: E731
    scene = tl.Scene(slider(), effects=[E.Controller(law, period=0.1, inputs=(), vectorized=vectorized)])
    q = sum(0.1 * k * (0.1 * (1.0 - 0.1 * (k + 1)) + 0.005) for k in range(10))
    assert tl.simulate(scene, 1.0).q[-1, 0] == pytest.approx(q, abs=1e-12)
    assert tl.simulate_many(scene, 1.0, q=[[0.0], [1.0]]).q[:, 0] == pytest.approx([q, 1.0 + q], abs=1e-12)
    steps = tl.Simulation(scene)
    assert steps.step(1.0).q[0] == pytest.approx(q, abs=1e-12)


@pytest.mark.parametrize("periods", [0, 3])
@pytest.mark.parametrize("share", [0.95, 1.2])
def test_an_unstable_loop_is_said_with_its_rate(periods: int, share: float) -> None:
    """v_{n+1} = v_n - k T v_{n-m}: the largest |root| of z^(m+1) = z^m - k T, on both sides of the limit."""
    period = 0.02
    gain = share * 2 * math.sin(math.pi / (2 * (2 * periods + 1))) / period
    control = E.Controller(lambda _, y, s: (-gain * y.v, s), period=period, delay=periods * period)
    scene = tl.Scene(slider(), v=[1e-3], effects=[control])
    rate = math.log(np.abs(np.roots([1.0, -1.0, *[0.0] * (periods - 1), gain * period] if periods else
                                    [1.0, gain * period - 1.0])).max()) / period  # fmt: skip
    end = 120 * (periods + 1) * period if rate < 0.0 else 18.0 / rate
    run = tl.simulate(scene, end, tolerance=1e-6, method="dop853")
    said = [event for event in run.events if event.kind == "unstable-loop"]
    assert len(said) == (rate > 0.0) == (share > 1.0)
    for event in said:
        assert float(re.search(r"at ([\d.]+) 1/s", event.detail)[1]) == pytest.approx(rate, rel=0.2)
        assert 0.0 < event.t < 0.5 * run.end
        assert "unstable-loop effects[0]" in str(event)
        assert "unstable loop from" in run.text()


def test_what_grows_without_an_unstable_loop_is_not_called_so() -> None:
    """A path that begins at rest, a torque that grows and sees nothing, and drift that nothing holds."""

    def follow(t: float, y: object, state: object) -> tuple[np.ndarray, object]:
        z = min(t / 3.0, 1.0)
        return 40.0 * (z**3 * (10.0 - 15.0 * z + 6.0 * z * z) - y.q) - 12.0 * y.v, state

    for update in (follow, lambda t, y, s: (12.0 * t * t + 0.0 * y.q, s), lambda _, y, s: (0.3 + 1e-9 * y.v, s)):
        run = tl.simulate(tl.Scene(slider(), v=[0.1], effects=[E.Controller(update, period=0.01)]), 3.0)
        assert not run.events


@pytest.mark.parametrize("method", ["rk4", "rk45", "dop853", "esdirk43"])
def test_any_method_of_steps_goes_from_tick_to_tick(method: str) -> None:
    """The same loop, exact by all: between ticks q is a parabola. Samples and dense output are between ticks."""
    control = E.Controller(pd, period=0.05, delay=0.02)
    times = [Fraction(0), Fraction(1, 50), Fraction(1, 16), Fraction(1, 8)]
    scene = tl.Scene(slider(), [1.0], effects=[control])
    exact = exact_pd(Fraction(1), Fraction(1, 20), Fraction(1, 50), times)
    run = tl.simulate(scene, 0.125, method=method, t_eval=[float(t) for t in times])
    assert run.q[:, 0] == pytest.approx([float(q) for q, _ in exact], abs=1e-12)
    assert run.v[:, 0] == pytest.approx([float(v) for _, v in exact], abs=1e-12)
    last = exact_pd(Fraction(1), Fraction(1, 20), Fraction(1, 50), [Fraction(3, 32)])
    assert run.at(3 / 32)[0][0] == pytest.approx(float(last[0][0]), abs=1e-12)
    assert run.error.max() < 1e-6


@pytest.mark.parametrize(
    "use",
    [
        lambda s: tl.sensitivities(s, wrt=["q"]),
        pytest.param(lambda s: tl.linearize(s), marks=pytest.mark.parts),
        lambda s: tl.simulate(s, method="taylor"),
        lambda s: tl.simulate(s, method="scipy-dop853"),
        lambda s: tl.simulate(s, method="taylor", precision="extended"),
        lambda s: tl.simulate(s, precision="quad"),
        lambda s: tl.accuracy_study(s),
        lambda s: s.save("/tmp/never-written.toml"),
    ],
)
def test_what_does_not_follow_ticks_says_so(use: object) -> None:
    """Never a result without the controller."""
    with pytest.raises(SceneError):
        use(tl.Scene(slider(), [1.0], effects=[E.Controller(pd, period=0.1)], duration=1.0))


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_the_energy_book_has_the_work_of_held_torques(friction: float) -> None:
    """The sum of u times the way between two ticks, which begins 0.03 s after a tick."""
    effects = [E.Controller(pd, period=0.1, delay=0.03), *([E.DryFriction({"rail": friction})] if friction else [])]
    scene = tl.Scene(slider(), [1.0], effects=effects, duration=1.0)
    times = np.union1d(np.linspace(0.0, 1.0, 11), np.arange(10) * 0.1 + 0.03)
    run = tl.simulate(scene, accuracy=1e-9, t_eval=times)
    book = tl.energy_book(scene, run)
    assert np.abs(book.residual).max() < 1e-9
    (q, v), acting = run.at(0.1 * np.arange(10)), np.append(0.1 * np.arange(10) + 0.03, 1.0)
    exact = float((-4.0 * q - 2.0 * v)[:, 0] @ np.diff(run.at(acting)[0][:, 0]))
    assert book.work["controller"][-1] == pytest.approx(exact, abs=1e-9)
    assert exact > 0.1


@pytest.mark.parametrize("delay", [0.0, 0.013])
def test_a_controller_inside_a_geared_motor_is_exact(delay: float) -> None:
    """Voltages held from tick to tick, on a cart that a motor drives: the matrix exponential of (q, v, i) and u."""
    r, coil, k, n, rotor, period = 1.2, 0.01, 0.5, 3.0, 0.2, 0.01
    law = lambda q, i: 4.0 * (1.0 - q) - 0.1 * i  # noqa: E731
    control = E.Controller(
        lambda _, y, s: (law(y.q, y.current), s), period=period, delay=delay, inputs=("q", "current")
    )
    motor = E.DCMotor(control, resistance={"rail": r}, inductance={"rail": coil}, constant={"rail": k})
    gear = E.Gear(motor, {"rail": n}, inertia={"rail": rotor})
    current = E.StateSensor(("rail.current",), name="current", period=period)
    scene = tl.Scene(slider(), effects=[gear, current])
    times = [0.0, 0.5, 1.0]
    run = tl.simulate(scene, 1.0, accuracy=1e-9, t_eval=times)
    mass, whole = 1.0 + n * n * rotor, np.zeros((4, 4))
    whole[:3] = [[0, 1, 0, 0], [0, 0, n * k / mass, 0], [0, -n * k / coil, -r / coil, 1 / coil]]
    late = Fraction(delay).limit_denominator(1000)
    instants = sorted({Fraction(j, 100) + d for j in range(101) for d in (Fraction(0), late)})
    x, waiting, kept = np.zeros(4), [], {}
    for begin, end in itertools.pairwise([*instants, Fraction(2)]):
        if (begin * 100).denominator == 1:
            kept[float(begin)] = x.copy()
            waiting.append((begin + late, law(x[0], x[2])))
        if waiting and waiting[0][0] == begin:
            x[3] = waiting.pop(0)[1]
        x = expm(whole * float(end - begin)) @ x
    exact = np.array([kept[t] for t in times])
    assert np.abs(run.q[:, 0] - exact[:, 0]).max() < 1e-11
    assert np.abs(run.states["rail.current"] - exact[:, 2]).max() < 1e-10
    assert run.sensors["current"].values[50, 0] == pytest.approx(exact[1, 2], abs=1e-10)
    assert {share.effect: share.operations for share in tl.explain(scene).shares}["state-sensor"] == 0


@pytest.mark.parametrize("switch", [E.Engage, E.Release])
def test_a_sensor_reads_states_of_what_begins_or_ends(switch: type) -> None:
    """The integral of a constant error, 0.5 a second, while it acts: from 0.4 s on, or until then."""
    pid = E.PID({"rail": 1.0}, {"rail": 0.0}, {"rail": 0.5})
    sensor = E.StateSensor(("rail.integral",), name="integral", period=0.2)
    heavy = E.Payload("cart", 1e9)  # so that it hardly moves
    run = tl.simulate(tl.Scene(slider(), effects=[switch(pid, at=0.4), sensor, heavy]), 1.0)
    acted = np.clip(np.arange(6) * 0.2 - 0.4, 0.0, None) if switch is E.Engage else np.clip(np.arange(6) * 0.2, 0, 0.4)
    assert run.sensors["integral"].values[:, 0] == pytest.approx(0.5 * acted, abs=1e-6)


def test_a_state_that_no_effect_has_is_refused() -> None:
    with pytest.raises(SceneError, match=r"effects\[0\].names: there is no state 'rail.current'"):
        tl.Scene(slider(), effects=[E.StateSensor(("rail.current",))])


@pytest.mark.parametrize("seed", [1.5, -1, True])
def test_a_seed_is_a_whole_number(seed: object) -> None:
    with pytest.raises(SceneError, match="seed: expected a whole number from 0"):
        tl.Scene(slider(), [1.0], effects=[E.Controller(pd, jitter=1e-4, seed=seed)])
    with pytest.raises(SceneError, match="seed: expected a whole number from 0"):
        tl.Scene(slider(), [1.0], effects=[E.Encoder(("rail",), noise=0.1, seed=seed)])
    with pytest.raises(tl.errors.QueryError, match="seed: expected a whole number from 0"):
        slider().random_state(3, seed=seed)
