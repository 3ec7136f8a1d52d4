"""Controllers and sensors in a simulation that goes step by step: their ticks are those of a run."""

from fractions import Fraction

import numpy as np
import pytest

import twolink as tl
from tests.loop.loops import exact_pd, pd, slider

E = tl.effects


def counting(_: float, y: object, ticks: int) -> tuple[list[float], int]:
    """A law with a state of its own."""
    return [-4.0 * y.encoder[0] - 0.1 * ticks], ticks + 1


NOISY = (E.Encoder(("rail",), period=0.05, delay=0.02, noise=0.01, seed=3),
         E.Controller(counting, period=0.1, delay=0.03, state=0, inputs=("encoder",)))  # fmt: skip


@pytest.mark.parametrize("verify", [False, True])
def test_ticks_fall_anywhere_in_a_step(verify: bool) -> None:
    """The sampled double integrator in rational arithmetic, by steps of 7 ms, which no tick is an end of."""
    control = E.Controller(pd, period=Fraction(1, 20), delay=0.02)
    sim = tl.Simulation(tl.Scene(slider(), [1.0], effects=[control]), verify=verify)
    times = [Fraction(7 * k, 1000) for k in range(1, 60)]
    exact = exact_pd(Fraction(1), Fraction(1, 20), Fraction(1, 50), times)
    for q, v in exact:
        state = sim.step(0.007)
        assert state.q[0] == pytest.approx(float(q), abs=1e-12)
        assert state.v[0] == pytest.approx(float(v), abs=1e-12)
    assert sim.error < 1e-12 or not verify


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_noise_delays_and_states_are_those_of_a_run(friction: float) -> None:
    effects = [*NOISY, *([E.DryFriction({"rail": friction})] if friction else [])]
    scene = tl.Scene(slider(), [1.0], effects=effects, duration=1.0)
    run, sim = tl.simulate(scene, accuracy=1e-10), tl.Simulation(scene, accuracy=1e-9)
    for _ in range(40):
        sim.step(0.025)
    assert sim.state.q == pytest.approx(run.q[-1], abs=1e-9)
    assert len(sim.events) == len(run.events)


def test_torques_add_to_those_of_controllers() -> None:
    spring = tl.Scene(slider(), [1.0], effects=[E.Controller(pd, period=0.05)])
    sim, other = tl.Simulation(spring), tl.Scene(slider(), [1.0], effects=[
        E.Controller(lambda t, y, s: (pd(t, y, s)[0] + 1.5, s), period=0.05)])  # fmt: skip
    assert sim.step(0.5, [1.5]).q == pytest.approx(tl.simulate(other, 0.5).q[-1], abs=1e-12)


def test_another_state_begins_the_controllers_anew() -> None:
    """Ticks stay at multiples of the period: from 0.125 s on the next one is at 0.2 s."""
    sim = tl.Simulation(tl.Scene(slider(), [1.0], effects=[E.Controller(pd, period=0.1)]))
    sim.step(0.5)
    sim.set_state([1.0], [0.0], t=0.125)
    assert sim.step(0.075).q[0] == pytest.approx(1.0, abs=1e-14)
    assert sim.step(0.1).q[0] == pytest.approx(1.0 - 0.5 * 4.0 * 0.1**2, abs=1e-14)


@pytest.mark.parts
def test_an_environment_has_an_inner_loop() -> None:
    """Actions at 20 Hz are what a controller at 200 Hz drives to."""
    pytest.importorskip("gymnasium")
    from twolink.gym import Environment

    control = E.Controller(pd, period=0.005)
    scene = tl.Scene(slider(), [1.0], effects=[control], duration=1.0)
    world = Environment(scene, lambda state, _: -float(state.q[0] ** 2), period=0.05)
    world.reset(seed=1)
    for _ in range(10):
        seen, *_ = world.step(np.zeros(1))
    assert seen[0] == pytest.approx(tl.simulate(scene, 0.5).q[-1, 0], abs=1e-6)


def test_a_controller_that_fails_says_when() -> None:
    def law(t: float, _: object, state: object) -> tuple[list[float], object]:
        return [1.0 / (t < 0.25)], state

    sim = tl.Simulation(tl.Scene(slider(), [1.0], effects=[E.Controller(law, period=0.1)]))
    with pytest.raises(tl.errors.ControllerError, match="division by zero"):
        sim.step(1.0)
    assert sim.t == pytest.approx(0.3)


def test_after_an_event_that_ends_the_motion_no_controller_is_called() -> None:
    called = []
    control = E.Controller(lambda t, _, s: (called.append(t), ([0.0], s))[1], period=0.1)
    watch = E.Watch("half", when=E.JointReaches("rail", 0.25), stop=True)
    sim = tl.Simulation(tl.Scene(slider(), [0.0], [1.0], effects=[control, watch]))
    assert sim.step(1.0).t == pytest.approx(0.25)
    assert sorted(set(called)) == pytest.approx([0.0, 0.1, 0.2])
