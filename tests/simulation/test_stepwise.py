"""tl.Simulation: step by step as in one run, held torques against a closed form, events, saving, errors."""

import math

import numpy as np
import pytest

import twolink as tl
from tests.effects.bodies import slider
from tests.near import assert_near

E = tl.effects
SWING = tl.load_scene("arm-swing")


def test_steps_of_any_length_are_the_motion_within_the_bar() -> None:
    run = tl.simulate(SWING, 2.0, accuracy=1e-12)
    sim = tl.Simulation(SWING, accuracy=1e-8, verify=True)
    for dt in np.random.default_rng(0).dirichlet(np.ones(300)) * 2.0:
        state = sim.step(dt)
    assert_near(state.t, 2.0, 1e-12)
    assert np.abs(state.q - run.q[-1]).max() < sim.error < 1e-7
    assert math.isnan(tl.Simulation(SWING).error)


@pytest.mark.parametrize(("speed", "largest"), [(0.0, 1e-9), (30.0, 1e-5)])
def test_short_steps_are_the_motion_within_the_bar(speed: float, largest: float) -> None:
    """Slow ones, beside which a formula of lower order is enough, and fast ones, which need finer steps at times."""
    scene = SWING.with_start(SWING.q, np.array([speed, -2.0 * speed]))
    exact, sim = tl.simulate(scene, 2.0, accuracy=1e-11), tl.Simulation(scene, verify=True)
    for _ in range(2000):
        state = sim.step(1e-3)
    assert np.abs(state.q - exact.q[-1]).max() < sim.error < largest


def test_held_torques_push_a_cart_as_the_closed_form_says() -> None:
    """x'' = u / m with u held for 0.1 s: x and v by rational steps."""
    sim, x, v = tl.Simulation(tl.Scene(slider(), [0.5], [0.0])), 0.5, 0.0
    for k in range(50):
        u = math.sin(k)
        state = sim.step(0.1, [u])
        x, v = x + 0.1 * v + 0.005 * u, v + 0.1 * u
        assert_near(state.q[0], x, 1e-13)
        assert_near(state.v[0], v, 1e-13)
    assert_near(sim.step(0.1).v[0], v + 0.1 * u, 1e-13)  # they go on


def test_it_stands_at_an_event_or_at_the_limit() -> None:
    scene = tl.Scene(slider(), [0.0], [1.0])
    for event in (
        E.JointReaches("x", 0.3),
        E.FrameReaches("x_link", 0.3, direction=(1, 0, 0)),
        lambda at: at.q[0] - 0.3,
    ):
        sim = tl.Simulation(scene)
        assert sim.run_until(event, 5.0, [2.0])
        assert_near(sim.t, (math.sqrt(1.0 + 4.0 * 0.3) - 1.0) / 2.0, 1e-14)
        assert_near(sim.state.q[0], 0.3, 1e-14)
        assert not sim.run_until(E.JointReaches("x", -9.0), 0.5)
        assert sim.t == pytest.approx((math.sqrt(2.2) - 1.0) / 2.0 + 0.5)


def test_another_state_begins_anew() -> None:
    sim = tl.Simulation(SWING, verify=True)
    sim.step(1.0, [3.0, 1.0])
    sim.set_state([0.2, 0.4], [0.0, 0.0], t=7.0)
    state = sim.step(0.5)
    run = tl.simulate(tl.Scene(SWING.base, [0.2, 0.4], effects=SWING.effects), 0.5, accuracy=1e-11)
    assert state.t == pytest.approx(7.5)
    assert_near(state.q, run.q[-1], 1e-8)


def test_a_state_that_was_set_does_not_follow_the_callers_array() -> None:
    sim, q = tl.Simulation(SWING), np.array([0.3, -0.2])
    sim.set_state(q)
    saved = sim.save()
    q[:] = np.nan
    sim.step(0.1)
    other = tl.Simulation(SWING)
    other.restore(saved)
    assert np.array_equal(other.state.q, [0.3, -0.2])
    assert np.array_equal(other.step(0.1).q, sim.state.q)


def test_states_of_effects_and_free_bodies() -> None:
    sim = tl.Simulation(tl.load_scene("heavy-top"))
    assert_near(np.linalg.norm(sim.step(0.5).q), 1.0, 1e-14)
    block = tl.load_scene("stick-slip")
    run = tl.simulate(block, 0.2, accuracy=1e-10)
    sim = tl.Simulation(block, accuracy=1e-8)
    state = sim.step(0.2)
    assert_near(state.q, run.q[-1], 1e-6)
    assert set(state.z) == set(run.states)


@pytest.mark.parametrize(
    ("make", "part"),
    [
        (lambda: tl.Simulation("arm-swing"), "expected a Scene"),
        (lambda: tl.Simulation(SWING, contact="stepped"), "no contact, stops"),
        (lambda: tl.Simulation(SWING, step=0.0), "step"),
        (lambda: tl.Simulation(SWING).step(0.0), "above 0"),
        (lambda: tl.Simulation(SWING).step(math.nan), "above 0"),
        (lambda: tl.Simulation(SWING).step(0.1, [1.0]), "tau"),
        (lambda: tl.Simulation(SWING).step(0.1, [[1.0, 2.0], [3.0, 4.0]]), "tau"),
        (lambda: tl.Simulation(SWING).step(0.1, "abc"), "tau"),
        (lambda: tl.Simulation(SWING).step("abc"), "above 0"),
        (lambda: tl.Simulation(SWING).set_state([[0.1, 0.2]]), "expected shape"),
        (lambda: tl.Simulation(SWING).set_state("abc"), "real numbers"),
        (lambda: tl.Simulation(SWING).set_state(t=math.nan), "finite"),
        (lambda: tl.Simulation(SWING).run_until(1.0, 1.0), "a condition or a function"),
        (lambda: tl.Simulation(SWING).restore(None), "another scene"),
        (lambda: tl.Simulation(tl.load_scene("heavy-top")).set_state([0, 0, 0, 0, 0, 0, 2.0]), "length 1"),
        (lambda: tl.Simulation(SWING).run_until(E.JointReaches("shoulder", 0.0), math.nan), "above 0"),
        (lambda: tl.Simulation(SWING).run_until(E.JointReaches("shouldr", 0.0), 1.0), "shouldr"),
        (lambda: tl.Simulation(SWING).step(0.1, [1.0, math.nan]), "tau"),
        (lambda: tl.Simulation(SWING).restore(tl.Simulation(tl.load_scene("heavy-top")).save()), "another scene"),
    ],
)
def test_refusals(make: object, part: str) -> None:
    with pytest.raises(tl.errors.TwolinkError, match=part):
        make()
