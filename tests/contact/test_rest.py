"""Bodies at rest: their steps are those of the contact problem, and end with the forces that held them."""

import itertools
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import twolink as tl
from tests.effects.bodies import G, above, free_bodies, spheres, stepped
from tests.near import assert_near, assert_within
from twolink.contact import stepping
from twolink.contact.rest import RestingSteps
from twolink.contact.solver import stepper_of
from twolink.contact.steps import Step, plan_steps
from twolink.simulation import stepped_run

E = tl.effects
MASS, EDGE, MU = 2.0, 0.2, 0.4


def cubes(count: int, *effects: tl.effects.Effect, speed: float = 0.0) -> tl.Scene:
    """A tower of cubes, the lowest of which may slide."""
    names = [f"b{k}" for k in range(count)]
    robot = free_bodies(*names, mass=MASS, inertia=MASS * EDGE**2 / 6)
    q = np.concatenate([above(EDGE * (k + 0.5)) for k in range(count)])
    v = np.zeros(6 * count)
    v[::6] = speed
    contact = E.Contact(("self", "ground"), MU, shapes={name: (E.Box((EDGE,) * 3),) for name in names})
    return tl.Scene(robot, q, v, [E.Gravity((0.0, 0.0, -G)), contact, *effects])


def run_of(scene: tl.Scene, duration: float = 1.0, step: float = 0.01) -> tl.Trajectory:
    return stepped(scene, duration, step, samples=50)


def solved(run: tl.Trajectory) -> dict[str, int]:
    return run.contact_record["solvers"]


def test_a_tower_at_rest_is_solved_for_once_and_carries_its_weight() -> None:
    run = run_of(cubes(5))
    assert solved(run)["rest"] > 90
    assert np.array_equal(run.q, np.tile(run.q[0], (len(run.t), 1)))
    assert not run.v.any()
    forces = run.contact_forces["b0 - ground"]
    assert forces[:, 2] == pytest.approx(5 * MASS * G, rel=1e-9)


def test_a_cube_slides_to_rest_as_the_contact_problem_says(monkeypatch: pytest.MonkeyPatch) -> None:
    scene, v0 = cubes(1, speed=1.0), 1.0
    run = run_of(scene)
    assert solved(run)["rest"] > 50
    assert_near(run.q[-1, 0], v0**2 / (2 * MU * G), 1e-4)
    monkeypatch.setattr(stepping, "steps_at_rest", lambda *_: None)
    every = run_of(scene)
    assert "rest" not in solved(every)
    assert_near(run.q, every.q, 1e-9)


@pytest.mark.parametrize("wakes", [0.3, 0.505])
def test_a_force_that_begins_wakes_what_rests(wakes: float) -> None:
    """A cube is pushed at its foot with twice what friction holds: x'' = mu g from then on."""
    size = 2 * MU * MASS * G
    push = E.FrameWrench("b0", (E.Sampled((0.0, wakes), (0.0, size), interpolation="hold"), 0.0, 0.0),
                         point=(0.0, 0.0, -EDGE / 2))  # fmt: skip
    run = run_of(cubes(1, push), 0.8, 0.005)
    assert 0 < solved(run)["rest"] < 0.7 * 160
    x = 0.5 * MU * G * np.maximum(run.t - wakes, 0.0) ** 2
    assert_near(run.q[:, 0], x, 1e-9)


def test_bodies_that_may_move_do_not_rest() -> None:
    """A ball on a plane may roll: what is slower than any number is not at rest."""
    robot = free_bodies("ball", mass=MASS, inertia=0.4 * MASS * 0.01)
    contact = E.Contact(("ground",), MU, shapes=spheres("ball"))
    scene = tl.Scene(robot, above(0.1), effects=[E.Gravity((0.0, 0.0, -G)), contact])
    assert "rest" not in solved(run_of(scene, 0.2))


def test_a_rest_of_other_lengths_has_the_same_forces() -> None:
    steps = []
    found = stepping.steps_at_rest

    def seen(*arguments: Any) -> RestingSteps | None:
        resting = found(*arguments)
        steps.extend([] if resting is None else [(resting.rest.step, step) for step in resting])
        return resting

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stepping, "steps_at_rest", seen)
        tl.simulate(cubes(2), 0.5, contact="stepped", step=0.01, verify=False, t_eval=[0.0, 0.1, 0.103, 0.5])
    assert len({round(step.h, 6) for _, step in steps}) > 1
    for one, step in steps:
        assert isinstance(step, Step)
        assert step.on_first / step.h == pytest.approx(one.on_first / one.h, rel=1e-12)


@pytest.mark.parametrize("native", [True, False])
def test_nothing_rests_while_a_gap_closes(native: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Fingers that meet a box late in a step close the gap in the next one, in which nothing has a velocity."""
    if not native:
        monkeypatch.setattr(stepping, "take_steps", lambda *_: None)
    stepper = stepper_of(tl.load_scene("grasp"))
    plan = plan_steps(stepper.equations, np.array([0.0, 0.06]), 0.005, 0)
    q, v, memory = stepper.begin
    for k in range(len(plan.t)):
        step = stepper.run(plan, range(k, k + 1), q, v, memory)[0]
        q, v, memory = step.q, step.v, step.memory
    points = stepper.detector.points(stepper.bodies.places(q, v)[0], 0.01)
    touching = np.isin(points.key, memory.keys)
    assert touching.sum() == 12
    assert np.abs(points.gap[touching]).max() < 1e-8


def test_a_first_estimate_that_is_small_by_chance_is_held_against_a_next_one() -> None:
    """A block slides to rest: two step sizes place its stop alike by chance, 1.3e-5 m off, and agree to 2e-7 m."""
    slope, mu, g, speed = np.arcsin(0.06096217687101231), 0.787, 9.75, 1.43
    normal, along = np.array([np.sin(slope), 0.0, np.cos(slope)]), np.array([np.cos(slope), 0.0, -np.sin(slope)])
    turned = pin.Quaternion(pin.rpy.rpyToMatrix(0.0, slope, 0.0)).coeffs()
    scene = tl.Scene(tl.load_robot("world")).with_object(E.Box((0.4, 0.4, 0.1)), mass=1.0, name="block")
    scene = scene.with_effects([E.Gravity((0.0, 0.0, -g)), E.Contact((("block", E.Plane(tuple(normal))),), mu)])
    scene = scene.with_start([*(0.05 * normal), *turned], [-speed, *np.zeros(5)])
    run = tl.simulate(scene, 1.092, contact="stepped", samples_per_second=60 / 1.092)
    slowing = g * (mu * np.cos(slope) + np.sin(slope))
    t = np.minimum(run.t, speed / slowing)
    exact = 0.05 * normal - np.outer(speed * t - 0.5 * slowing * t**2, along)
    assert_within(run.q[:, :3], exact, run.error + 1e-12)
    assert run.error[-1] < 1e-6


def test_a_first_estimate_stands_where_no_next_one_comes(monkeypatch: pytest.MonkeyPatch) -> None:
    """There is no time for it, or its run fails; the accuracy is kept."""
    scene = tl.Scene(tl.load_robot("world")).with_object(E.Box((0.4, 0.4, 0.1)), mass=1.0, name="block")
    scene = scene.with_effects([E.Gravity(), E.Contact((("block", E.Plane((0.0, 0.0, 1.0))),), 0.5)])
    scene = scene.with_start([0.0, 0.0, 0.05, 0.0, 0.0, 0.0, 1.0], [1.0, *np.zeros(5)])
    run = tl.simulate(scene, 1.0, contact="stepped", accuracy=1e-2, patience=1e-3)
    assert 1e-6 < run.error[-1] < 1e-2
    solve, calls = stepped_run.solve_stepped, itertools.count()

    def failing(*given: Any) -> Any:
        if next(calls) > 1:
            raise tl.errors.AccuracyError("no", where="here", code="chaos")
        return solve(*given)

    monkeypatch.setattr(stepped_run, "solve_stepped", failing)
    np.testing.assert_array_equal(tl.simulate(scene, 1.0, contact="stepped", accuracy=1e-2).q, run.q)
    assert next(calls) == 3
