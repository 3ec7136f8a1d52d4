"""Any sequence of step, save, restore, set_state and run_until is, to the bit, its own history from fresh.

The history of a simulation is what it has done since its start, or since the last set_state, but for what a restore has
undone; saving is no part of it. A fresh simulation that does only that has the same time, state, error and events.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import twolink as tl
from tests.effects.bodies import bouncing
from tests.loop.loops import slider
from tests.near import assert_near

E = tl.effects
STOP, FRICTION = E.JointStops({"rail": (-0.4, 0.6)}, restitution=0.5), E.DryFriction({"rail": 0.5})
BOX = """<robot name="lift"><link name="ground"/><link name="box"><inertial><mass value="1"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial><collision><geometry>
<box size="0.2 0.2 0.2"/></geometry></collision></link><joint name="z" type="prismatic"><parent link="ground"/>
<child link="box"/><axis xyz="0 0 1"/><limit lower="-5" upper="5" effort="100" velocity="100"/></joint></robot>"""
State = tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]
Make = Callable[[bool], tl.Simulation]
Action = tuple[Any, ...]


def law(_: float, y: Any, state: float) -> tuple[list[float], float]:
    """A proportional law with an integral and the encoder's reading, which is late and noisy."""
    off = float(y.encoder[0]) - 0.1
    return [-8.0 * off - 0.5 * state], state + 0.01 * off


def controlled(joint: str) -> list[tl.effects.Effect]:
    encoder = E.Encoder((joint,), name="encoder", period=0.01, delay=0.013, noise=1e-3, quantum=1e-3)
    return [encoder, E.Controller(law, period=0.02, delay=0.005, jitter=0.002, state=0.0, inputs=("encoder",),
                                  outputs=(joint,))]  # fmt: skip


def free_body(shape: Any, height: float) -> tl.Scene:
    """A body over the ground, or on it, that turns: it bounces, slides, and rolls."""
    world = tl.Scene(tl.load_robot("world"), effects=[E.Gravity()], duration=1.0)
    scene = world.with_object(shape, (0, 0, height), mass=1.0)
    contact = E.Contact(("ground",), friction=0.3, restitution=0.4)
    return tl.Scene(scene.robot, scene.q, [0.3, 0, 0, 0, 1.0, 0], [*scene.effects, contact], 1.0)


def box(*effects: tl.effects.Effect, restitution: float = 0.0) -> tl.Scene:
    contact = E.Contact((("box", "ground"),), friction=0.5, restitution=restitution)
    return tl.Scene(tl.load_robot(BOX), [0.13], effects=[E.Gravity(), contact, *effects], duration=1.0)


def rail(*effects: tl.effects.Effect) -> tl.Scene:
    return tl.Scene(slider(), [0.1], [1.0], effects=effects, duration=1.0)


def simulations(scene: tl.Scene, **options: Any) -> Make:
    return lambda verify: tl.Simulation(scene, verify=verify, **options)


SWING = tl.load_scene("arm-swing")
STEPPED: dict[str, Any] = {"contact": "stepped", "step": 4e-3}
KINDS: dict[str, Make] = {
    "smooth": simulations(SWING),
    "smooth, controlled": simulations(SWING.with_effects([*SWING.effects, *controlled("elbow")])),
    "located": simulations(rail(STOP, FRICTION)),
    "located, controlled": simulations(rail(STOP, FRICTION, *controlled("rail"))),
    "located contact": simulations(tl.load_scene("bouncing-ball")),
    "stepped, to rest": simulations(box(), **STEPPED),
    "stepped, bouncing": simulations(box(restitution=0.6), **STEPPED),
    "stepped, controlled": simulations(box(*controlled("z")), **STEPPED),
    "stepped, free": simulations(free_body(E.Box((0.2,) * 3), 0.13), **STEPPED),
}


def act(sim: tl.Simulation, action: Action) -> None:
    """Do one thing of a history."""
    kind, *arguments = action
    getattr(sim, kind)(*arguments)


def seen(sim: tl.Simulation) -> tuple[Any, ...]:
    """What is compared, to the bit."""
    t, q, v, z = sim.state
    return t, q.tolist(), v.tolist(), z, str(sim.error), tuple(sim.events)


def action_of(sim: tl.Simulation, draw: np.random.Generator, start: State) -> Action:
    """A step, a search for an event, or another state."""
    kind, tau = draw.choice(["step", "step", "step", "run_until", "set_state"]), None
    if draw.random() < 0.3:
        tau = draw.normal(size=sim.scene.robot.nv).tolist()
    if kind == "step":
        return "step", float(draw.choice([1e-3, 4e-3, 0.0137, 0.05, 0.2])), tau
    if kind == "run_until":
        level, entry = float(sim.state.v[-1]) + 0.2 * draw.normal(), -1
        return "run_until", lambda state: float(state.v[entry]) - level, float(draw.choice([0.03, 0.2])), tau
    return "set_state", start[0], (draw.uniform(0.3, 1.0) * start[1]).tolist(), float(draw.choice([0.0, 0.25]))


def same_as_its_history(make: Make, verify: bool, seed: int, length: int) -> None:
    """Do a random sequence, and then its history from fresh, in a new simulation and in one that restores it."""
    draw, sim = np.random.default_rng(seed), make(verify)
    start: State = (sim.state.q, sim.state.v)
    history: list[Action] = []
    saved = [(sim.save(), list(history))]
    for _ in range(length):
        kind = draw.choice(["act", "act", "act", "save", "restore"])
        if kind == "save":
            saved.append((sim.save(), list(history)))
        elif kind == "restore":
            kept, before = saved[draw.integers(len(saved))]
            sim.restore(kept)
            history = list(before)
        else:
            action = action_of(sim, draw, start)
            act(sim, action)
            history = [action] if action[0] == "set_state" else [*history, action]
    fresh = make(verify)
    for action in history:
        act(fresh, action)
    assert seen(sim) == seen(fresh), history
    other = make(verify)
    other.restore(sim.save())
    for one in (sim, fresh, other):
        one.step(0.03)
    assert seen(sim) == seen(fresh) == seen(other), history


@pytest.mark.some(18)
@pytest.mark.parametrize("seed", range(300))
def test_300_random_sequences_are_their_histories_from_fresh(seed: int) -> None:
    """The first 18 have each kind, with its bar and without."""
    kinds = [(make, verify) for make in KINDS.values() for verify in (False, True)]
    same_as_its_history(*kinds[seed % len(kinds)], seed, 12)


def test_short_steps_go_on_the_same_behind_another_start() -> None:
    for seed in (73, 91, 109):
        same_as_its_history(KINDS["smooth"], True, seed, 12)


def test_a_ball_that_rolls_goes_on_the_same() -> None:
    for seed in range(3):
        same_as_its_history(simulations(free_body(E.Sphere(0.1), 0.1), **STEPPED), True, seed, 8)


def test_what_came_to_rest_falls_again_where_it_is_restored() -> None:
    """Free fall: z = z0 - g t^2 / 2, and the height of 0.12 m after sqrt(2 (z0 - 0.12) / g), seen in steps of 1/64."""
    sim = KINDS["stepped, to rest"](False)
    start = sim.save()
    sim.step(1.0)
    assert_near(sim.state.q[0], 0.1, 1e-9)
    sim.restore(start)
    assert_near(sim.step(0.01).q[0], 0.13 - 0.5 * 9.81 * 0.01**2, 1e-12)
    sim.restore(start)
    assert sim.run_until(lambda state: float(state.q[0]) - 0.12, 60.0)
    assert sim.t == pytest.approx(math.sqrt(2 * 0.01 / 9.81), rel=1e-9)


@pytest.mark.parametrize(("step", "dt"), [
    (5e-3, 0.02), (2.5e-3, 0.01), (5e-3, 1 / 300), (1.25e-3, 0.02),
    *(pytest.param(*pair, marks=pytest.mark.slow)
      for pair in [(5e-3, 0.01), (2.5e-3, 0.02), (2.5e-3, 1 / 300), (1.25e-3, 0.01), (1.25e-3, 1 / 300)]),
])  # fmt: skip
def test_the_bar_covers_bounces_that_no_step_follows(step: float, dt: float) -> None:
    """Both solutions lie on the ground while the body still bounces: their distance shows nothing then."""
    sim = tl.Simulation(box(restitution=0.6), contact="stepped", step=step, verify=True)
    while sim.t < 0.45:
        off = abs(sim.step(dt).q[0] - 0.1 - bouncing(np.array([sim.t]), 0.03, 0.6)[0])
        assert off <= sim.error + 1e-15
    assert sim.error < 5e-3


def test_a_simulation_with_other_arguments_restores_nothing() -> None:
    make = KINDS["stepped, to rest"]
    with pytest.raises(tl.errors.SceneError, match="other arguments"):
        make(True).restore(make(False).save())
