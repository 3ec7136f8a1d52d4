"""Sampled controllers with stops, dry friction and contacts, against arithmetic of 60 digits and closed forms."""

import math
from decimal import Decimal
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest

import twolink as tl
from tests.loop.loops import slider
from tests.loop.quadruped import KD, KP, TARGET, quadruped
from tests.loop.switched import exact_switched_slider
from twolink.errors import AccuracyError, ControllerError, SceneError

E = tl.effects
G = 9.81
STOP = {"rail": (-50.0, 0.6)}
SWITCHES = {
    "bounces": ({"stop": "0.6", "restitution": "0.5"}, [E.JointStops(STOP, restitution=0.5)]),
    "rests at the stop": ({"stop": "0.6"}, [E.JointStops(STOP)]),
    "sticks and slips": ({"friction": "1.5"}, [E.DryFriction({"rail": 1.5})]),
    "all": (
        {"stop": "0.6", "restitution": "0.5", "friction": "1.5"},
        [E.JointStops(STOP, restitution=0.5), E.DryFriction({"rail": 1.5})],
    ),
}


@pytest.mark.some(4)
@pytest.mark.parametrize("switches", SWITCHES)
@pytest.mark.parametrize(
    ("kp", "kd", "target", "period"), [(40, 2, "0.5", "0.01"), (8, 1, "0.75", "0.05"), (300, 3, "0.55", "0.002")]
)
def test_a_sampled_law_on_a_slider_is_exact(switches: str, kp: int, kd: int, target: str, period: str) -> None:
    """Impacts, rest, stick and slip between ticks and at them; the bar holds."""
    exact_of, effects = SWITCHES[switches]
    times, aim = [f"{k / 20:.2f}" for k in range(41)], float(target)

    def update(t: float, y: object, state: object) -> tuple[np.ndarray, object]:
        return -kp * (y.q - aim) - kd * y.v + (3.0 if int(2.0 * t + 1e-9) % 2 else -3.0), state

    exact = exact_switched_slider(
        lambda t, q, v: -kp * (q - Decimal(target)) - kd * v + (3 if int(2 * t) % 2 else -3), ("0.1", "0"), period,
        times, **exact_of,
    )  # fmt: skip
    scene = tl.Scene(slider(), [0.1], effects=[E.Controller(update, period=float(period)), *effects])
    run = tl.simulate(scene, 2.0, accuracy=1e-8, t_eval=[float(t) for t in times])
    off = np.abs(run.q[:, 0] - [float(q) for q, _ in exact])
    assert off.max() < 1e-12
    assert (off <= run.error).all()
    assert np.abs(run.v[:, 0] - [float(v) for _, v in exact]).max() < 1e-11
    assert run.certificate is not None
    assert run.bound == "verified"
    between = np.array([0.013, 0.737, 1.511])
    again = tl.simulate(scene, 2.0, accuracy=1e-8, t_eval=between)
    assert np.abs(run.at(between)[0] - again.q).max() < 1e-12


@pytest.mark.some(2)
@pytest.mark.parametrize(
    "fields", [{}, {"hold": "first"}, {"delay": 0.017}, {"jitter": 0.004, "seed": 3}, {"limit": {"rail": 0.5}}]
)
def test_a_stop_that_is_never_reached_changes_nothing(fields: dict) -> None:
    """Two controllers and a late, noisy, rounded encoder: the same as in columns."""
    encoder = E.Encoder(("rail",), period=0.003, noise=1e-3, delay=0.004, quantum=1e-4)
    one = E.Controller(lambda _, y, s: (-4.0 * y.encoder - 2.0 * y.v + s, 0.99 * s), period=0.01, state=np.ones(1),
                       inputs=("encoder", "v"), **fields)  # fmt: skip
    other = E.Controller(lambda _, y, s: (-y.q, s), period=1 / 70)
    without = tl.Scene(slider(), [1.0], effects=[one, other, encoder])
    within = without.with_effects([*without.effects, E.JointStops({"rail": (-50.0, 50.0)})])
    runs = [tl.simulate(scene, 0.4, method="dop853") for scene in (without, within)]
    assert np.abs(runs[0].q - runs[1].q).max() < 1e-12
    assert np.abs(runs[0].tau - runs[1].tau).max() < 1e-11
    for mine, theirs in zip(*(run.sensors["encoder"] for run in runs), strict=True):
        np.testing.assert_array_equal(mine, theirs)


def test_a_controller_inside_another_effect_is_refused() -> None:
    control = E.Controller(lambda _, y, s: (-y.q, s))
    for effect in (E.Engage(control, at=0.2), E.Release(control, at=0.2)):
        with pytest.raises(SceneError, match="inside another effect"):
            tl.simulate(tl.Scene(slider(), [1.0], effects=[effect]), 0.5)


def test_an_integral_that_grows_breaks_static_friction_at_the_tick_that_it_should() -> None:
    """u_k = ki T e (k + 1) with e constant: it slips at the first tick where u > 1.5, and moves as the exact one."""
    period, ki, aim = 0.02, 4.0, 1.0

    def update(_: float, y: object, state: float) -> tuple[list[float], float]:
        state += ki * period * (aim - y.q[0])
        return [state], state

    friction = E.DryFriction({"rail": 0.8}, {"rail": 1.5})
    scene = tl.Scene(slider(), [0.0], effects=[E.Controller(update, period=period, state=0.0), friction])
    run = tl.simulate(scene, 2.0, accuracy=1e-9)
    first = next(event for event in run.events if event.kind == "slip")
    tick = math.ceil(1.5 / (ki * period * aim) - 1e-9) - 1  # u = 0.08 (k + 1) > 1.5
    assert first.t == pytest.approx(tick * period, abs=1e-12)
    after = (run.t > first.t) & (run.t <= first.t + period)
    drive = ki * period * aim * (tick + 1) - 0.8
    assert run.q[after, 0] == pytest.approx(drive * (run.t[after] - first.t) ** 2 / 2, abs=1e-13)


@pytest.mark.slow
def test_a_panda_is_pressed_on_its_stop() -> None:
    """The joint rests where its stop is; the stop gives what Pinocchio's inverse dynamics leaves of the controller."""
    panda = tl.load_robot("panda")
    upper, start = panda.model.upperPositionLimit[0], tl.scene_of(panda).q.copy()
    start[0] = upper - 0.02
    aim = start + np.append(0.5, np.zeros(8))

    def update(_: float, y: object, state: object) -> tuple[np.ndarray, object]:
        wanted = 100.0 * (aim - y.q) - 20.0 * y.v
        return panda.mass_matrix(y.q) @ wanted + panda.bias(y.q, y.v), state

    effects = [E.Gravity(), E.JointDamping(), E.JointStops(), E.Controller(update, period=2e-3)]
    run = tl.simulate(tl.Scene(panda, start, effects=effects), 0.2, accuracy=1e-6)
    assert run.error.max() < 1e-6
    assert next(event for event in run.events if event.kind == "impact").what == "panda_joint1"
    assert run.q[-1, 0] == upper
    assert run.v[-1, 0] == run.acceleration[-1, 0] == 0.0
    model, data = panda.model, panda.model.createData()
    inverse = pin.rnea(model, data, run.q[-1], run.v[-1], run.acceleration[-1])
    assert run.tau[-1] == pytest.approx(inverse, abs=1e-9)
    assert run.t[-2] == pytest.approx(0.195)  # a tick was at 0.194
    u, _ = update(0.0, SimpleNamespace(**dict(zip("qv", run.at(0.194), strict=True))), None)
    by_stop = run.tau[-2] + model.damping * run.v[-2] - u
    assert by_stop[0] < -1.0
    assert by_stop[1:] == pytest.approx(np.zeros(8), abs=1e-9)


@pytest.mark.parametrize("beside", [[], [E.JointStops(STOP)]], ids=["alone", "a stop"])
def test_a_quantized_encoder_that_differs_is_named(beside: list[tl.effects.Effect]) -> None:
    """q = 0.3 t reaches half a quantum at a tick."""
    law = E.Controller(lambda _, y, s: (-1.0 * y.encoder, s), period=0.1, inputs=("encoder",))
    encoder = E.Encoder(("rail",), period=0.1, quantum=0.3)
    scene = tl.Scene(slider(), v=[0.3], effects=[law, encoder, *beside])
    with pytest.raises(AccuracyError) as refused:
        tl.simulate(scene, 2.0)
    assert refused.value.run.events[0].kind == "ambiguous-tick"
    assert refused.value.run.events[0].t == pytest.approx(0.5)
    assert refused.value.data["trusted_until"] <= 0.6


def test_what_an_event_ends_has_its_readings_up_to_there() -> None:
    watch = E.Watch("half", when=E.JointReaches("rail", 0.5), stop=True)
    encoder = E.Encoder(("rail",), name="angle", period=0.1)
    control = E.Controller(lambda _, y, s: (0.0 * y.angle, s), period=0.1, inputs=("angle",))
    run = tl.simulate(tl.Scene(slider(), [0.0], [1.0], effects=[encoder, control, watch]), 3.0)
    assert run.end == pytest.approx(0.5)
    assert run.sensors["angle"].t[-1] <= 0.5
    assert run.error[-1] < 1e-6


def test_a_controller_that_fails_keeps_the_run_so_far() -> None:
    def update(t: float, y: object, state: object) -> tuple[np.ndarray, object]:
        return 1.0 / (0.3 - t) * y.q, state

    for scene, options in (
        (tl.Scene(slider(), [0.1], effects=[E.Controller(update, period=0.1), E.JointStops(STOP)]), {}),
        (_on_ground(update), {"contact": "stepped", "step": 0.01}),
    ):
        with pytest.raises(ControllerError, match="ZeroDivisionError") as refused:
            tl.simulate(scene, 1.0, **options)
        assert refused.value.run.t[-1] == pytest.approx(0.3)
        assert refused.value.run.interrupted


BALL = """<robot name="ball"><link name="base"/><link name="ball"><inertial><mass value="2"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="up" type="prismatic">
<parent link="base"/><child link="ball"/><axis xyz="0 0 1"/><limit lower="-99" upper="99" effort="9" velocity="9"/>
</joint></robot>"""


def _on_ground(update: object, height: float = 0.6) -> tl.Scene:
    ground = E.Contact((("ball", "ground"),), shapes={"ball": (E.Sphere(0.1),)})
    return tl.Scene(tl.load_robot(BALL), [height], effects=[E.Gravity(), E.Controller(update, period=0.1), ground])


def test_a_ball_leaves_the_ground_at_the_tick_that_lifts_it() -> None:
    """u = 2 g + 4 from t = 0.5 on lifts 2 kg with 2 m/s^2; before it rests. Located and stepped."""

    def update(t: float, _: object, state: object) -> tuple[list[float], object]:
        return [2.0 * G + 4.0 if t > 0.45 else 5.0], state

    located = tl.simulate(_on_ground(update, 0.1), 1.0, accuracy=1e-9, contact="located")
    late = np.maximum(located.t - 0.5, 0.0)
    assert np.abs(located.q[:, 0] - 0.1 - late**2).max() < 1e-12
    assert [(event.kind, event.t) for event in located.events if event.t] == [("leave", 0.5)]
    stepped = tl.simulate(_on_ground(update, 0.1), 1.0, contact="stepped", step=0.02)
    assert stepped.bound == "estimated"
    assert np.abs(stepped.q[:, 0] - 0.1 - np.maximum(stepped.t - 0.5, 0.0) ** 2).max() < 1e-9
    assert stepped.tau[-1, 0] == pytest.approx(2.0 * G + 4.0)
    weight = next(iter(stepped.contact_forces.values()))
    assert weight[20, 2] == pytest.approx(2.0 * G - 5.0, abs=1e-9)
    for contact in ("located", "stepped"):
        sim = tl.Simulation(_on_ground(update, 0.1), contact=contact, step=0.02, verify=True)
        heights = [sim.step(0.05).q[0] for _ in range(20)]
        assert heights == pytest.approx([0.1 + max(0.0, 0.05 * k - 0.5) ** 2 for k in range(1, 21)], abs=1e-9)


def test_a_threshold_between_two_stepped_solutions_is_named() -> None:
    """Damped, the ball is elsewhere by steps half as long: a threshold between the two is ambiguous, not one above."""

    def scene(least: float) -> tl.Scene:
        on_ground = _on_ground(lambda _, y, s: ([2.0 * G + (4.0 if y.q[0] < least else 3.0)], s), 0.1)
        return on_ground.with_effects([*on_ground.effects, E.JointDamping({"up": 3.0})])

    options = {"contact": "stepped", "t_eval": [0.0, 0.8, 1.0]}
    runs = [tl.simulate(scene(9.0), 1.0, step=step, verify=False, **options) for step in (2e-3, 1e-3)]
    one, other = (run.q[1, 0] for run in runs)
    assert one != other
    between, above = 0.5 * (one + other), max(one, other) + 10.0 * abs(one - other)
    named, clear = (tl.simulate(scene(least), 1.0, step=2e-3, **options) for least in (between, above))
    assert [(event.kind, event.t) for event in named.events] == [("ambiguous-tick", pytest.approx(0.8))]
    assert not clear.events
    assert named.error[-1] > 2.0 * clear.error[-1]


@pytest.mark.slow
def test_a_quadruped_stands_on_its_feet() -> None:
    """At rest its feet carry its weight; ticks that samples and steps do not share are ends of steps."""
    scene, law = quadruped(0.0)
    times: list[float] = []

    def update(t: float, y: object, state: object) -> tuple[np.ndarray, object]:
        times.append(t)
        return law(t, y, state)

    control = E.Controller(update, period=1e-3, offset=3e-4, outputs=tuple(TARGET))
    run = tl.simulate(scene.with_effects([*scene.effects, control]), 0.8, contact="stepped", step=2e-3, verify=False)
    assert run.bound == ""
    weight = sum(inertia.mass for inertia in run.robot.model.inertias) * G
    assert sum(force[-1, 2] for force in run.contact_forces.values()) == pytest.approx(
        weight, rel=1e-2
    )  # it still sways
    kept = [t for i, t in enumerate(times) if i == 0 or t != times[i - 1]]
    assert kept == pytest.approx([3e-4 + 1e-3 * k for k in range(800)], abs=1e-15)
    wanted = KP * (np.array(list(TARGET.values())) - run.q[-1, 7:]) - KD * run.v[-1, 6:]
    assert run.tau[-1, 6:] == pytest.approx(wanted, abs=2e-3)


def test_sensors_of_forces_are_refused_beside_stepped_contacts() -> None:
    scene = _on_ground(lambda _, y, s: (0.0 * y.q, s))
    touch = E.TouchSensor("ball", name="touch")
    with pytest.raises(SceneError, match="means over steps"):
        tl.simulate(scene.with_effects([*scene.effects, touch]), 0.2, contact="stepped")
    with pytest.raises(tl.errors.SceneError, match="means over steps"):
        tl.Simulation(scene.with_effects([*scene.effects, touch]), contact="stepped").step(0.2)


def test_a_drives_controller_stands_at_a_stop() -> None:
    """A motor whose controller gives a constant voltage presses a cart against its stop: there the current is u / R."""
    control = E.Controller(lambda _, y, s: ([6.0 + 0.0 * y.current[0]], s), period=0.01, inputs=("current",))
    motor = E.DCMotor(control, resistance={"rail": 2.0}, inductance={"rail": 0.02}, constant={"rail": 0.5})
    current = E.StateSensor(("rail.current",), name="current", period=0.01)
    stops = E.JointStops({"rail": (-1.0, 0.2)})
    scene = tl.Scene(slider(), effects=[motor, stops, current])
    run = tl.simulate(scene, 2.0)
    assert run.q[-1, 0] == pytest.approx(0.2, abs=1e-9)
    assert run.states["rail.current"][-1] == pytest.approx(3.0, abs=1e-6)
    assert run.sensors["current"].values[-1, 0] == pytest.approx(3.0, abs=1e-6)
