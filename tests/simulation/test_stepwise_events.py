"""tl.Simulation with stops, friction and contacts: as in one run, and as arithmetic of 60 digits says."""

from decimal import Decimal

import numpy as np
import pytest

import twolink as tl
from tests.effects.bodies import stepped
from tests.loop.loops import slider
from tests.loop.quadruped import TARGET, quadruped
from tests.loop.switched import exact_switched_slider
from tests.near import assert_near

E = tl.effects
ARM = tl.load_robot("two_link")
STOP = E.JointStops({"rail": (-50.0, 0.6)}, restitution=0.5)


def test_a_bouncing_ball_comes_to_rest_as_in_one_run() -> None:
    scene = tl.load_scene("bouncing-ball")
    sim = tl.Simulation(scene, accuracy=1e-9, verify=True)
    for dt in np.random.default_rng(0).dirichlet(np.ones(60)) * 2.0:
        state = sim.step(dt)
    assert np.abs(state.q).max() < sim.error < 1e-9  # it rests on the ground
    run = tl.simulate(scene, 2.0, accuracy=1e-10)  # it follows lower bounces
    for events in (sim.events, run.events):
        assert [event.kind for event in events] == ["impact"] * (len(events) - 1) + ["rest"]
    assert_near(sim.events[-1].t, run.events[-1].t, 1e-9)
    both = len(sim.events) - 1
    assert 20 < both < len(run.events)
    times = [event.t for event in run.events[:both]]
    assert_near([event.t for event in sim.events[:both]], times, 1e-9)


@pytest.mark.parametrize("verify", [False, True])
def test_torques_from_call_to_call_with_a_stop_and_dry_friction(verify: bool) -> None:
    """The law is computed by the caller; the bar holds; what is saved goes on with the same bits."""
    exact = exact_switched_slider(
        lambda t, q, v: -40 * (q - Decimal("0.5")) - 2 * v + (3 if int(2 * t) % 2 else -3), ("0.1", "0"), "0.01",
        [f"{k / 100:.2f}" for k in range(300)], stop="0.6", restitution="0.5", friction="1.5",
    )  # fmt: skip
    sim = tl.Simulation(tl.Scene(slider(), [0.1], effects=[STOP, E.DryFriction({"rail": 1.5})]), verify=verify)
    seen: list[float] = []
    for again in (False, True):
        for k in range(120 if again else 0, 300):
            state = sim.state
            if k == 120 and not again:
                saved = sim.save()
            seen.append(state.q[0])
            sim.step(0.01, -40.0 * (state.q - 0.5) - 2.0 * state.v + (3.0 if (k // 50) % 2 else -3.0))
        error, kinds = sim.error, {event.kind for event in sim.events}
        sim.restore(saved)
    assert seen[120:300] == seen[300:]
    off = np.abs(np.array(seen[:300]) - [float(q) for q, _ in exact]).max()
    assert off < 1e-12
    assert not verify or off < error < 1e-9
    assert {"impact", "slip", "stick"} <= kinds


def test_it_stands_at_an_event_after_a_bounce() -> None:
    """At 0.3 on the way back from the stop at 0.6, with half the speed: v^2 = 4 / 4 + 2 * 2 * 0.3."""
    sim = tl.Simulation(tl.Scene(slider(), [0.0], [2.0], effects=[STOP]))
    assert sim.run_until(lambda at: at.v[0], 1.0)
    assert [event.kind for event in sim.events] == ["impact"]
    assert sim.run_until(E.JointReaches("rail", 0.3), 1.0, [-2.0])
    assert_near(sim.state.v[0], -np.sqrt(1.0 + 4.0 * 0.3), 1e-12)
    sim.set_state([0.0], [1.0], t=3.0)
    assert not sim.events
    assert sim.step(0.1).q[0] == pytest.approx(0.1)


def test_a_motion_that_an_event_ends_goes_no_farther() -> None:
    watch = E.Watch("half", when=E.JointReaches("rail", 0.5), stop=True)
    sim = tl.Simulation(tl.Scene(slider(), [0.0], [1.0], effects=[watch]))
    assert sim.step(1.0).t == pytest.approx(0.5)
    with pytest.raises(tl.errors.SceneError, match="ended the motion"):
        sim.step(0.1)


@pytest.mark.slow
def test_a_quadruped_stands_the_same_with_its_controller_outside_and_inside() -> None:
    scene, law = quadruped()
    control = E.Controller(law, period=1e-3, outputs=tuple(TARGET))
    run = stepped(scene.with_effects([*scene.effects, control]), 0.1, 1e-3)
    sim = tl.Simulation(scene, contact="stepped", verify=True)
    for _ in range(100):
        state = sim.state
        sim.step(1e-3, np.append(np.zeros(6), law(0.0, state, None)[0]))
    assert_near(sim.state.q, run.q[-1], 1e-6)  # compiled steps solve for impulses by another method
    assert 0.0 < sim.error < 1e-2


@pytest.mark.parametrize("kind", [E.Release, E.Engage])
@pytest.mark.parts
def test_what_is_timed_before_the_start_has_happened(kind: type) -> None:
    """Begun behind the time, the motion is that of the scene without the trigger: with the effect, or without it."""
    own = E.Payload("forearm", 3.0, (0.5, 0.0, 0.0)) if kind is E.Release else E.Torque({"elbow": 5.0})
    always = [E.Gravity()] if kind is E.Release else [E.Gravity(), own]
    scene = tl.Scene(ARM, [1.2, 0.5], effects=[E.Gravity(), kind(own, at=1.0)])
    plain = tl.Scene(ARM, [1.2, 0.5], effects=always)
    sim = tl.Simulation(scene)
    sim.set_state(t=5.0)
    assert_near(sim.step(0.2).q, tl.simulate(plain, 0.2).q[-1], 1e-6)
    assert_near(tl.linearize(scene, t=5.0).a, tl.linearize(plain).a, 1e-12)
    run = tl.simulate(scene, 2.0, t_eval=[0.0, 1.5])
    assert_near(tl.linearize(scene, run.q, run.v, t=run.t).a[1], run.acceleration[1], 1e-9)


@pytest.mark.parts
def test_a_curve_ends_a_simulation() -> None:
    curve = E.Bezier((0.0, 0.0, 0.0, 2.0, 2.0, 2.0), 0.5)
    scene = tl.Scene(ARM, effects=[E.Torque({"elbow": curve})], duration=0.5)
    sim = tl.Simulation(scene)
    assert_near(sim.step(0.5).q, tl.simulate(scene).q[-1], 1e-6)
    for ask in (lambda: sim.step(0.1), lambda: tl.linearize(scene, t=1.0)):
        with pytest.raises(tl.errors.SceneError, match="a curve ends at 0"):
            ask()
    assert sim.t == 0.5


def test_a_curve_beside_events_is_followed_and_ends() -> None:
    torque = E.Torque({"elbow": E.Bezier((0.0, 0.0, 0.0, 2.0, 2.0, 2.0), 0.5)})
    scene = tl.Scene(ARM, effects=[torque, E.JointStops({"elbow": (-0.1, 0.05)}, restitution=0.5)], duration=0.5)
    sim, run = tl.Simulation(scene, accuracy=1e-9), tl.simulate(scene, accuracy=1e-9)
    for _ in range(5):
        state = sim.step(0.1)
    assert [event.kind for event in sim.events] == [event.kind for event in run.events] != []
    assert_near(state.q, run.q[-1], 1e-7)
    with pytest.raises(tl.errors.SceneError, match=r"a curve ends at 0\.5 s, the run at 0\.6"):
        sim.step(0.1)


def test_an_event_before_the_end_of_a_curve_is_found() -> None:
    curve = E.Bezier((0.0, 0.0, 0.0, 2.0, 2.0, 2.0), 1.0)
    scene = tl.Scene(ARM, effects=[E.Torque({"elbow": curve})], duration=1.0)
    sim = tl.Simulation(scene)
    assert sim.run_until(lambda state: state.t - 0.95, 10.0)
    assert_near(sim.t, 0.95, 1e-9)
    with pytest.raises(tl.errors.SceneError, match="a curve ends at 1 s"):
        sim.run_until(lambda state: state.t - 1.5, 10.0)
    assert sim.t == 1.0


def test_a_search_ends_where_the_scene_ends_the_motion() -> None:
    """The rail reaches 0.5 after 0.25 s at 2 m/s, and ends there, before the event that is looked for."""
    end = E.Watch("end", when=E.JointReaches("rail", 0.5), stop=True)
    sim = tl.Simulation(tl.Scene(slider(), [0.0], [2.0], effects=[end]))
    assert not sim.run_until(E.JointReaches("rail", 0.6), 1.0)
    assert (sim.ended, sim.t) == (True, pytest.approx(0.25))
    with pytest.raises(tl.errors.SceneError, match="an event has ended the motion"):
        sim.run_until(E.JointReaches("rail", 0.6), 1.0)
