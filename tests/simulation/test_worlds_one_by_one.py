"""Worlds with events, loops and tables, and worlds that differ in numbers of effects: each is what `simulate` gives."""

import math
from collections.abc import Mapping

import numpy as np
import pytest
import scipy.linalg

import twolink as tl
from tests.effects.bodies import bouncing
from tests.near import assert_near
from twolink import effects
from twolink.algorithms.mechanism import nominal
from twolink.errors import SceneError
from twolink.scenes.parameters import scene_with

ARM = tl.load_robot("two_link")
DAMPED = (effects.Gravity(), effects.JointDamping(damping={"shoulder": 0.1, "elbow": 0.1}))
TABLE = effects.Torque({"elbow": effects.Sampled(times=(0.0, 0.7, 2.0), values=(0.0, 1.5, 0.0))})
RUBBING = tl.Scene(ARM, effects=[*DAMPED, TABLE, effects.DryFriction(kinetic={"shoulder": 1.0, "elbow": 0.5})])


def check(worlds: tl.Worlds, i: int, scene: tl.Scene, duration: float) -> tl.Trajectory:
    """World i is the scene's own run, as far as their error bars tell."""
    alone = tl.simulate(scene, duration, accuracy=1e-8, samples_per_second=1 / duration)
    assert np.abs(scene.robot.difference(worlds.q[i], alone.q[-1])).max() <= worlds.error[i] + alone.error[-1]
    return alone


def test_each_world_has_events_of_its_own() -> None:
    q = np.random.default_rng(1).uniform(-1, 1, (4, 2))
    worlds = tl.simulate_many(RUBBING, q=q, duration=2.0, samples_per_second=2)
    assert worlds.within_accuracy.all()
    assert len({tuple(event.t for event in events) for events in worlds.events}) == 4
    for i, start in enumerate(q):
        alone = check(worlds, i, tl.Scene(ARM, start, effects=RUBBING.effects), 2.0)
        assert [event.kind for event in worlds.events[i]] == [event.kind for event in alone.events]
        assert_near([event.t for event in worlds.events[i]], [event.t for event in alone.events], 1e-5)
        assert [event["t"] for event in worlds.to_dict()["events"][i]] == [event.t for event in worlds.events[i]]
        assert_near(worlds.samples_q[:, i], np.array([alone.at(t)[0] for t in worlds.samples_t]), 2e-6)


def test_a_world_with_events_is_the_same_beside_any_others() -> None:
    q = np.random.default_rng(2).uniform(-1, 1, (3, 2))
    together, alone = (tl.simulate_many(RUBBING, q=some, duration=1.0) for some in (q, q[1]))
    assert np.array_equal(together.q[1], alone.q[0])
    assert np.array_equal(together.v[1], alone.v[0])


def test_balls_bounce_from_heights_of_their_own() -> None:
    heights = [0.5, 1.0, 1.7]
    worlds = tl.simulate_many(tl.load_scene("bouncing-ball"), q=[[h] for h in heights], duration=0.9, accuracy=1e-9)
    assert_near(worlds.q[:, 0], [bouncing(np.array([0.9]), h, 0.6)[0] for h in heights], 1e-9)
    assert [len(events) for events in worlds.events] == [2, 1, 1]
    assert worlds.cost.steps == worlds.steps.sum() > worlds.steps.max()


def test_a_start_below_the_plane_is_refused_with_its_world() -> None:
    with pytest.raises(SceneError, match=r"world 1: .* below the plane"):
        tl.simulate_many(tl.load_scene("bouncing-ball"), q=[[1.0], [-0.5]])


def test_an_event_ends_a_world_and_the_others_go_on() -> None:
    """Drawn up to there."""
    watch = effects.Watch("level", when=effects.JointReaches("height", 0.8), stop=True)
    scene = tl.load_scene("bouncing-ball")
    scene = scene.with_effects([*scene.effects, watch])
    worlds = tl.simulate_many(scene, q=[[1.0], [0.7]], duration=0.3, accuracy=1e-6, samples_per_second=20)
    fallen, one = math.sqrt(2 * 0.2 / 9.81), worlds[0]
    assert_near(worlds.events[0][-1].t, fallen, 1e-6)
    assert one.t[-1] == worlds.ends[0] == pytest.approx(fallen, abs=1e-9)
    assert_near(one.q[-1, 0], 0.8, 1e-9)
    assert np.isfinite(one.q).all()
    assert_near(worlds.q[:, 0], [0.8, 0.7 - 9.81 * 0.3**2 / 2], 1e-6)
    assert np.isfinite(worlds.samples_q[:, 0, 0]).tolist() == (worlds.samples_t <= fallen).tolist()
    assert np.isfinite(worlds.samples_q[:, 1]).all()


def test_restitution_differs_by_world() -> None:
    """A number of an effect that switches."""
    ball = tl.load_scene("bouncing-ball")
    place = next(i for i, effect in enumerate(ball.effects) if isinstance(effect, effects.PlaneContact))
    values = [0.3, 0.8]
    worlds = tl.simulate_many(ball, parameters={f"effects.{place}.restitution": values}, duration=0.6, accuracy=1e-9)
    heights = [bouncing(np.array([0.6]), 1.0, e)[0] for e in values]
    assert_near(worlds.q[:, 0], heights, 1e-9)


# A limit is a constant of the formula, so that each world has steps of its own; a payload changes the robot.
NUMBERS = {
    "damping.elbow": ([0.0, 0.1, 0.5], 1.0, lambda d: effects.JointDamping({"shoulder": 0.1, "elbow": d})),
    "effort.elbow": ([1.0, 3.0], 0.3, lambda limit: effects.JointPD({"elbow": 1.0}, {"elbow": 20.0}, {"elbow": 1.0},
                                                                    effort={"elbow": limit})),
    "mass": ([0.5, 2.0], 0.5, lambda mass: effects.Payload("forearm", mass, (1.0, 0.0, 0.0))),
}  # fmt: skip


@pytest.mark.parametrize("name", NUMBERS)
def test_numbers_of_effects_differ_by_world(name: str) -> None:
    values, duration, made = NUMBERS[name]
    scenes = [tl.Scene(ARM, effects=[effects.Gravity(), made(value)]) for value in (0.3, *values)]
    worlds = tl.simulate_many(scenes[0], parameters={f"effects.1.{name}": values}, duration=duration)
    for i, scene in enumerate(scenes[1:]):
        check(worlds, i, scene, duration)
    assert np.ptp(worlds.q, axis=0).min() > 1e-3


def test_loops_with_constants_of_their_own() -> None:
    scene = tl.Scene(ARM, effects=[effects.Gravity(), effects.Coupling("elbow", "shoulder", 1.0, offset=0.2)])
    worlds = tl.simulate_many(scene, q=[[0.0, 0.2]], parameters={"forearm.mass": [1.0, 3.0]}, duration=0.5)
    for i, mass in enumerate([1.0, 3.0]):
        own = scene_with(scene, {"forearm.mass": mass})
        check(worlds, i, tl.Scene(own.base, [0.0, 0.2], effects=own.effects), 0.5)
    assert np.ptp(worlds.q, axis=0).min() > 1e-3


@pytest.mark.slow
def test_a_scene_of_a_world_is_what_run_time_parameters_say() -> None:
    """All of them at once: the motion of the scene whose robot and effects have these numbers."""
    names = [*(f"forearm.{part}" for part in ("mass", "com.x", "com.z", "inertia.yy")), "elbow.origin.x",
             "elbow.origin.z", "elbow.armature", "elbow.damping", "gravity.x", "gravity.z"]  # fmt: skip
    scene = tl.Scene(ARM, effects=DAMPED)
    values = {name: nominal(scene.robot.model, name) + 0.1 * (i + 1) for i, name in enumerate(names)}
    values["effects.1.damping.elbow"] = 0.7
    worlds = tl.simulate_many(scene, parameters=values, duration=0.5, accuracy=1e-9)
    check(worlds, 0, scene_with(scene, values), 0.5)
    for name in values:
        some = {other: value for other, value in values.items() if other != name}
        other = tl.simulate(scene_with(scene, some), 0.1, accuracy=1e-6, method="scipy-dop853", samples_per_second=10)
        whole = tl.simulate(scene_with(scene, values), 0.1, accuracy=1e-6, method="scipy-dop853", samples_per_second=10)
        assert np.abs(other.q[-1] - whole.q[-1]).max() > 1e-4, name


@pytest.mark.parametrize(("parameters", "part"), [({"effects.1.damping.elbow": [0.1, -1.0]}, "damping"),
                                                  ({"effects.1.damping.elbo": 0.1}, "effects.1.damping.elbow"),
                                                  ({"effects.7.damping.elbow": 0.1}, "no parameter")])  # fmt: skip
def test_numbers_that_no_effect_may_have(parameters: Mapping[str, float], part: str) -> None:
    with pytest.raises(SceneError, match=part):
        tl.simulate_many(tl.Scene(ARM, effects=DAMPED), parameters=parameters)


def test_worlds_of_many_contacts_are_stepped_as_one_run_is() -> None:
    scene = tl.load_scene("box-stack")
    worlds = tl.simulate_many(scene, 0.05, q=np.stack([scene.q, scene.q]))
    alone = tl.simulate(scene, 0.05, samples_per_second=20)
    assert alone.bound == "estimated"
    assert worlds.estimated
    assert worlds.to_dict()["bound"] == "estimated"
    assert "by estimates" in repr(worlds)
    np.testing.assert_array_equal(worlds.q, np.stack([alone.q[-1]] * 2))


def test_worlds_are_located_or_stepped_as_is_asked() -> None:
    can = tl.load_scene("can-on-table")
    located, stepped = (tl.simulate_many(can, 0.05, contact=how, accuracy=1e-3) for how in ("located", "stepped"))
    assert not located.estimated
    assert stepped.estimated
    assert np.abs(located.q - stepped.q).max() <= (located.error + stepped.error).max()
    with pytest.raises(SceneError, match="contact: 'rolled' is unknown"):
        tl.simulate_many(can, 0.1, contact="rolled")


@pytest.mark.parametrize("nominal_gain", [0.0, 3.0])
def test_gains_of_integrals_and_times_of_filters_differ_by_world_and_may_be_0(nominal_gain: float) -> None:
    """Without gravity: m q'' = kp e + I - kd w, I' = ki e, F w' = v - w, by the matrix exponential."""
    robot = tl.load_robot("friction_pendulum")
    kp, kd, target, end, start = 4.0, 1.5, 0.5, 1.0, -0.3
    inertia = robot.mass_matrix([0.0])[0, 0]
    pid = effects.PID({"axle": target}, {"axle": kp}, {"axle": nominal_gain}, {"axle": kd},
                      filter={"axle": 0.02 * nominal_gain})  # fmt: skip
    scene = tl.Scene(robot, [start], effects=[pid], duration=end)
    gains, times = np.array([0.0, 2.0, 0.0, 5.0]), np.array([0.0, 0.0, 0.1, 0.06])
    worlds = tl.simulate_many(scene, parameters={"effects.0.ki.axle": gains, "effects.0.filter.axle": times})
    for i, (ki, lag) in enumerate(zip(gains, times, strict=True)):
        rates = np.array([[0, 1, 0, 0],
                          [-kp / inertia, 0 if lag else -kd / inertia, 1 / inertia, -kd / inertia if lag else 0],
                          [-ki, 0, 0, 0], [0, 1 / lag if lag else 0, 0, -1 / lag if lag else 0]])  # fmt: skip
        exact = scipy.linalg.expm(end * rates) @ [start - target, 0.0, 0.0, 0.0]
        assert abs(worlds.q[i, 0] - target - exact[0]) <= worlds.error[i]
    assert worlds.within_accuracy.all()
    if not nominal_gain:
        for name in ("effects.0.ki.axle", "effects.0.filter.axle"):
            with pytest.raises(SceneError, match="is 0: the state that it is the gain or the time of is left out"):
                tl.sensitivities(scene, wrt=[name])
