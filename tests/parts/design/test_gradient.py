"""gradient: within its bars of sensitivities and of differences of runs, through events and loops."""

import numpy as np
import pytest

import twolink as tl
from tests.refusals import refusal
from tests.simulation.test_sensitivities import CONSTANTS, EIGHT, EVENTS, GRAVITY, differences, moved
from twolink.errors import AccuracyError, SceneError
from twolink.parts.design.objectives import NotFollowedError, named_objective, variation_by
from twolink.scenes.parameters import named_parameters, scene_with

BOTH = {k * side: side * weight for k, weight in EIGHT for side in (1, -1)}  # steps, and weights of what is there


def slope(value, step: float, about: float = 0.0) -> float:
    """A derivative, by differences of exact values."""
    return float(sum(weight * value(about + k * step) for k, weight in BOTH.items())) / step


def require_slope(found: tl.Gradient, name: str, truth, doubt: float = 1e-7, column=slice(None)) -> None:
    """The derivatives by a name are within their bars of the truth, which has a doubt of its own."""
    off = np.abs(found.by[name][column] - truth) - found.error[name][column]
    assert np.all(off <= doubt * (1.0 + np.abs(truth)))


def bent(run: tl.Trajectory) -> float:
    """A number of the last sample that is not linear in it."""
    return float(run.q[-1, 0] * run.v[-1, 1] + np.sin(run.q[-1, 1]))


@pytest.fixture(scope="module")
def swing() -> tl.Gradient:
    names = ["q", "v", *CONSTANTS]
    return tl.gradient(tl.load_scene("arm-swing"), objective=bent, wrt=names, duration=2.0, accuracy=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("name", CONSTANTS)
def test_constants_agree_with_worlds_that_have_others(swing: tl.Gradient, name: str) -> None:
    scene, step = tl.load_scene("arm-swing"), 0.01
    value = tl.sensitivities(scene, wrt=[name], duration=0.01).values[name]
    worlds = tl.simulate_many(scene, parameters={name: [value + k * step for k in BOTH]}, duration=2.0,
                              accuracy=1e-12, verify=False)  # fmt: skip
    ends = worlds.q[:, 0] * worlds.v[:, 1] + np.sin(worlds.q[:, 1])
    truth = ends @ list(BOTH.values()) / step
    require_slope(swing, name, truth, 1e-8)
    assert swing.error[name][0] <= 1e-9 * max(1.0, abs(truth))


def test_the_start_agrees_with_sensitivities(swing: tl.Gradient) -> None:
    s = tl.sensitivities(tl.load_scene("arm-swing"), wrt=["q", "v"], duration=2.0, accuracy=1e-9)
    q, v = s.run.q[-1], s.run.v[-1]
    for name in ("q", "v"):
        truth = s.q[name][-1, 0] * v[1] + q[0] * s.v[name][-1, 1] + np.cos(q[1]) * s.q[name][-1, 1]
        doubt = (abs(v[1]) + abs(q[0]) + 1.0) * s.error[name][-1]
        assert (np.abs(swing.by[name] - truth) <= swing.error[name] + doubt).all()
    assert swing.objective == pytest.approx(bent(s.run), abs=1e-7)
    assert "gravity.z" in str(swing)


@pytest.mark.some(1)
@pytest.mark.parametrize("case", ["stops", "stick and slip", "release at an angle"])
def test_it_goes_back_through_events(case: str) -> None:
    scene = tl.Scene(tl.load_robot("two_link"), [0.2, 0.4], [0.3, -1.0], [GRAVITY, EVENTS[case]])
    weights = np.array([0.6, -0.8, 0.3, 0.5])
    found = tl.gradient(scene, objective=lambda run: float(weights @ np.concatenate([run.q[-1], run.v[-1]])),
                        wrt=["q", "v.elbow", "gravity.z"], duration=1.3, accuracy=1e-7)  # fmt: skip
    assert found.run.events
    for name, column, entry in (("q", 0, 0), ("q", 1, 1), ("v.elbow", 0, 3)):
        truth = differences(scene, lambda shift, k=entry: moved(scene, k, shift), 1e-4, 1.3, 20)[-1] @ weights
        require_slope(found, name, truth, 1e-8, column)
    forward = tl.sensitivities(scene, wrt=["gravity.z"], duration=1.3, accuracy=1e-7)
    truth = weights @ np.concatenate([forward.q["gravity.z"][-1], forward.v["gravity.z"][-1]])
    doubt = np.abs(weights).sum() * forward.error["gravity.z"][-1]
    assert abs(found.by["gravity.z"] - truth) <= found.error["gravity.z"] + doubt


def test_loops_are_followed() -> None:
    scene = tl.load_scene("crank-spring")
    end = lambda run: float(run.q[-1].sum() + run.v[-1, 0])  # noqa: E731
    found = tl.gradient(scene, objective=end, wrt=["v"], duration=1.0, accuracy=1e-8)
    s = tl.sensitivities(scene, wrt=["v"], duration=1.0, accuracy=1e-8, samples_per_second=20)
    truth = s.q["v"][-1].sum(axis=0) + s.v["v"][-1, 0]
    assert np.abs(truth).max() > 0.1
    assert (np.abs(found.by["v"] - truth) <= found.error["v"] + (len(s.q["v"][-1]) + 1) * s.error["v"][-1]).all()


def test_all_samples_count_with_slopes_or_without() -> None:
    scene = tl.load_scene("arm-swing")

    def spread(run: tl.Trajectory) -> float:
        return float((run.q**2).sum())

    asked = {"objective": spread, "wrt": ["v", "forearm.mass"], "duration": 0.5, "accuracy": 1e-8}
    plain, given = (tl.gradient(scene, **asked, samples_per_second=40, slopes=slopes)
                    for slopes in (None, lambda run: (2 * run.q, 0 * run.v)))  # fmt: skip
    s = tl.sensitivities(scene, wrt=["v", "forearm.mass"], duration=0.5, accuracy=1e-9, samples_per_second=40)
    for name in ("v", "forearm.mass"):
        truth = 2.0 * np.einsum("nk,nkp->p", s.run.q, s.q[name])
        for found in (plain, given):
            require_slope(found, name, truth, 1e-8)


def test_what_the_objective_itself_takes_from_constants_counts() -> None:
    """The energy at the end is that at the start: its derivative by a mass is known."""
    scene = tl.load_scene("arm-swing")
    found = tl.gradient(scene, objective="energy", wrt=["forearm.mass", "upper_arm.mass"], duration=0.5, accuracy=1e-8)
    for name in found.by:
        truth = slope(lambda mass, name=name: tl.simulate(scene_with(scene, {name: mass}), 0.01).energy[0], 0.02, 1.0)
        assert found.by[name][0] == pytest.approx(truth, abs=1e-7)


HELD = tl.effects.JointPD({"elbow": 0.2}, kp={"elbow": 30.0}, kd={"elbow": 2.0})
STATES = {
    "integral": tl.effects.PID({"elbow": 0.2}, kp={"elbow": 30.0}, ki={"elbow": 50.0}, kd={"elbow": 2.0}),
    "current": tl.effects.DCMotor(HELD, resistance={"elbow": 1.2}, inductance={"elbow": 0.05}, constant={"elbow": 0.5}),
}


@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("objective", ["effort", "state", "early"])
def test_states_of_effects_move_with_the_start(state: str, objective: str) -> None:
    """By differences of runs: a torque and a state change with the start by way of the states of effects, too."""
    sample = {"state": -1, "early": 40}
    function = named_objective("effort", tl.load_robot("two_link")) if objective == "effort" else (
        lambda run: float(run.states[f"elbow.{state}"][sample[objective]]))  # fmt: skip

    def scene(shift: float) -> tl.Scene:
        return tl.Scene(tl.load_robot("two_link"), [1.2, 0.5 + shift], [0.3, -0.2], [GRAVITY, STATES[state]], 0.5)

    found = tl.gradient(scene(0.0), objective=function, wrt=["q.elbow"])
    truth = slope(lambda shift: function(tl.simulate(scene(shift), accuracy=1e-11)), 1e-3)
    assert abs(truth) > 0.01
    require_slope(found, "q.elbow", truth)


def test_slopes_leave_states_of_effects_to_differences() -> None:
    scene = tl.Scene(tl.load_robot("two_link"), [1.2, 0.5], [0.3, -0.2], [GRAVITY, STATES["current"]], 0.3)

    def mixed(run: tl.Trajectory) -> float:
        return float((run.q**2).sum() + (run.states["elbow.current"] ** 2).sum())

    asked = {"objective": mixed, "wrt": ["q", "v.elbow"], "samples_per_second": 40}
    plain, given = (tl.gradient(scene, **asked, slopes=slopes) for slopes in (None, lambda run: (2 * run.q, 0 * run.v)))
    for name in plain.by:
        apart = np.abs(plain.by[name] - given.by[name])
        assert (apart <= plain.error[name] + given.error[name] + 1e-8 * (1.0 + np.abs(plain.by[name]))).all()


@pytest.mark.parametrize("effect", [tl.effects.Torque({"elbow": 2.0}), tl.effects.JointDamping({"elbow": 0.3})])
def test_the_torque_of_a_joints_damping_counts(effect: tl.effects.Effect) -> None:
    scene = tl.Scene(tl.load_robot("two_link"), [1.2, 0.5], [0.3, -0.2], [GRAVITY, effect], 0.5)
    name, effort = "elbow.damping", named_objective("effort", scene.robot)
    truth = slope(lambda d: effort(tl.simulate(scene_with(scene, {name: d}), accuracy=1e-11)), 1e-2, 1.0)
    require_slope(tl.gradient(scene_with(scene, {name: 1.0}), objective="effort", wrt=[name]), name, truth)
    assert abs(tl.gradient(scene, objective="effort", wrt=[name]).by[name][0]) > 0.1


def test_states_of_effects_that_are_not_known_are_no_numbers() -> None:
    """Sensitivities have none: an optimization then takes differences of runs."""
    scene = tl.Scene(tl.load_robot("two_link"), [1.2, 0.5], effects=[GRAVITY, STATES["current"]], duration=0.1)
    s = tl.sensitivities(scene, wrt=["q.elbow"])
    variation = variation_by(s, scene, named_parameters(scene, ["q.elbow"], "wrt")[0])
    for asked in (lambda run: run.tau[-1, 1], lambda run: run.states["elbow.current"][-1]):
        with pytest.raises(NotFollowedError):
            variation.derivative([asked])
    assert variation.derivative([lambda run: run.q[-1, 1]]) == pytest.approx(s.q["q.elbow"][-1, 1], abs=1e-9)


def test_what_is_not_followed_is_named() -> None:
    landed = tl.effects.Watch("landed", when=tl.effects.FrameReaches("ball", 0.2), stop=True)
    ball = tl.Scene(tl.load_scene("bouncing-ball").base, [1.0], [0.5], [GRAVITY, landed])
    with refusal(SceneError, code="gradient-end"):
        tl.gradient(ball, objective="time", wrt=["v"], duration=2.0)
    loaded = tl.load_scene("arm-swing")
    loaded = loaded.with_effects([*loaded.effects, tl.effects.Payload("forearm", 1.0, (0.0, 0.0, 0.3))])
    with refusal(SceneError, code="gradient-objective"):
        tl.gradient(loaded, objective="energy", wrt=["effects.1.mass"], duration=0.1)
    sliders = tl.Scene(tl.load_robot("two_link"), effects=[GRAVITY, tl.effects.DryFriction({"elbow": 100.0})])
    with refusal(AccuracyError, code="sensitivity-undefined"):
        tl.gradient(sliders, objective=bent, wrt=["v"], duration=0.3)
    with pytest.raises(SceneError, match="finite number"):
        tl.gradient(tl.load_scene("arm-swing"), objective=lambda run: run.q, wrt=["v"], duration=0.1)
