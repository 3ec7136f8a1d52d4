"""Sensitivities to what decides events: friction, stops, contacts, releases; within their own bars of differences."""

import numpy as np
import pytest

import twolink as tl
from tests.effects.bodies import planar
from tests.refusals import refusal
from tests.simulation.test_sensitivities import TWO, differences, moved, require_within_bars
from twolink import effects as fx
from twolink.effects.conditions import FrameReaches, JointReaches
from twolink.errors import AccuracyError, SceneError
from twolink.robots.collisions import AnyShape
from twolink.scenes.parameters import effect_numbers, with_number

ARM = tl.load_robot("two_link")
GRAVITY = fx.Gravity()
LOAD = fx.Payload("forearm", 1.0, (0.0, 0.0, 0.3))
CONTACT = ["1.friction", "1.restitution"]
SINE = fx.Torque({"elbow": fx.Sine(2.0, 5.0)})


def arm(*effects: tl.effects.Effect) -> tl.Scene:
    return tl.Scene(ARM, [0.2, 0.4], [0.3, -1.0], [GRAVITY, *effects])


def disk(height: float, **contact: float) -> tl.Scene:
    """A disk that falls beside a plane."""
    contacts = [GRAVITY, fx.PlaneContact("body", radius=0.2, **contact)]
    return tl.Scene(planar(0.02), [0.0, 0.2 + height, 0.0], [1.0, 0.0, 3.0], contacts)


def touching(shape: AnyShape, other: AnyShape | None = None) -> tl.Scene:
    """The arm, with a shape at its forearm that hits the plane z = -0.8, or another shape of the base."""
    shapes = {"forearm": (shape,)} | ({} if other is None else {"base": (other,)})
    pair = ("forearm", fx.Plane(height=-0.8) if other is None else "base")
    return arm(fx.Contact((pair,), 0.1, 0.5, shapes=shapes))


def changed(scene: tl.Scene, name: str, shift: float) -> tl.Scene:
    """The scene with another number in an effect."""
    _, place, *path = name.split(".")
    effects = list(scene.effects)
    effects[int(place)] = with_number(effects[int(place)], path, effect_numbers(scene)[name] + shift)
    return scene.with_effects(effects)


CASES = {
    "kinetic": (arm(fx.DryFriction({"elbow": 2.0, "shoulder": 0.5})), 1.3, ["1.kinetic.elbow"]),
    "static": (arm(fx.DryFriction({"elbow": 2.0}, {"elbow": 2.5})), 1.3, ["1.static.elbow", "1.kinetic.elbow"]),
    "stops": (arm(fx.JointStops({"elbow": (-0.3, 0.8)}, 0.6)), 1.3, ["1.restitution", "1.limits.elbow.0"]),
    "rest": (arm(fx.JointStops({"elbow": (-0.3, 0.8)}), SINE), 1.3, ["1.limits.elbow.0", "2.inputs.elbow.amplitude"]),
    "time": (arm(fx.Release(LOAD, at=0.51)), 1.0, ["1.at", "1.of.mass"]),
    "condition": (arm(fx.Release(LOAD, when=JointReaches("shoulder", -0.5))), 1.3, ["1.when.value"]),
    "height": (arm(fx.Release(SINE, when=FrameReaches("forearm", 0.1))), 1.0,
               ["1.when.value", "1.of.inputs.elbow.amplitude"]),
    "caught": (arm(fx.Detent("elbow", 99.0, (-0.2,), 9.0)), 1.3, ["1.positions.0"]),
    "breakaway": (tl.load_scene("detent"), 2.3, ["3.torque"]),
    "bounces": (disk(0.1, friction=0.05, restitution=0.6), 0.5, ["1.friction", "1.restitution", "1.height"]),
    "rolls": (disk(0.1, friction=0.2), 0.3, ["1.friction"]),
    "capsule on plane": (touching(fx.Capsule(0.05, 0.3, (0.8, 0.0, 0.0), (0.0, 1.5, 0.0))), 1.0, CONTACT),
    "corner on plane": (touching(fx.Box((0.2, 0.1, 0.1), (0.9, 0.0, 0.0))), 1.0, CONTACT),
    "sphere on box": (touching(fx.Sphere(0.05, (1.0, 0.0, 0.0)), fx.Box((1.0, 1.0, 0.2), (1.7, 0.0, -0.9))), 1.0,
                      CONTACT),
    "sphere on sphere": (touching(fx.Sphere(0.05, (1.0, 0.0, 0.0)), fx.Sphere(0.4, (1.6, 0.0, -0.9))), 1.0, CONTACT),
}  # fmt: skip


SLOW = ("rolls", "capsule on plane", "sphere on box")


@pytest.mark.some(1)
@pytest.mark.parametrize("case", [pytest.param(c, marks=pytest.mark.slow) if c in SLOW else c for c in CASES])
def test_what_decides_events(case: str) -> None:
    scene, duration, names = CASES[case]
    names = [f"effects.{name}" for name in names]
    s = tl.sensitivities(scene, wrt=names, duration=duration, accuracy=1e-6, samples_per_second=20)
    assert s.run.events
    for name in names:
        truth = differences(scene, lambda shift, n=name: changed(scene, n, shift), 2e-5, duration, 20, TWO, "rk45")
        assert np.abs(truth).max() > 1e-3
        require_within_bars(s, name, truth, 1e-6)


@pytest.mark.slow
def test_limits_of_effort_are_reached_and_left() -> None:
    """Torques have corners there, no jumps; where a piece ends, rounding does not decide on which side it is."""
    drive = fx.JointPD({"elbow": fx.Sine(1.0, 4.0)}, {"elbow": 30.0}, {"elbow": 2.0}, effort={"elbow": 1.5})
    scene, duration = arm(drive), 0.6
    s = tl.sensitivities(
        scene, wrt=["effects.1.effort.elbow", "v.elbow"], duration=duration, accuracy=1e-7, samples_per_second=10
    )
    assert {event.detail for event in s.run.events} == {"reached", "left"}
    for name in s.q:

        def make(shift: float, name: str = name) -> tl.Scene:
            return moved(scene, 3, shift) if name == "v.elbow" else changed(scene, name, shift)

        truth = differences(scene, make, 1e-4, duration, 10, TWO, "scipy-dop853")
        assert np.abs(truth).max() > 1e-2
        require_within_bars(s, name, truth, 1e-6)
        assert s.error[name][-1] <= 1e-7 * max(1.0, np.abs(truth).max())


def test_what_effects_change_of_the_robot() -> None:
    """A payload's mass, gravity and a rotor's ratio act through the robot's constants."""
    effects = [LOAD, fx.Rotor({"elbow": 1e-3}, {"elbow": 20.0}),
               fx.JointPD({"elbow": 1.5}, {"elbow": 9.0}, effort={"elbow": 4.0})]  # fmt: skip
    scene = arm(*effects)
    names = [f"effects.{name}" for name in ("0.field.2", "1.mass", "1.com.2", "2.ratio.elbow", "3.effort.elbow")]
    s = tl.sensitivities(scene, wrt=names, duration=0.4, accuracy=1e-7, samples_per_second=10)
    for name in names:
        truth = differences(scene, lambda shift, n=name: changed(scene, n, shift), 1e-3, 0.4, 10, TWO, "scipy-dop853")
        assert np.abs(truth).max() > 1e-3
        require_within_bars(s, name, truth, 1e-5)


def test_a_joint_that_friction_holds_keeps_its_derivatives_when_another_is_hit() -> None:
    """The elbow sticks at an angle that depends on the start, and stays there while the shoulder meets its stop."""
    effects = [fx.DryFriction({"elbow": 3.0}, {"elbow": 500.0}), fx.Torque({"shoulder": 2.0}),
               fx.JointStops({"shoulder": (-9.0, 0.3)}, 0.5)]  # fmt: skip
    scene = tl.Scene(ARM, [0.2, 0.4], [0.0, 1.0], effects)
    s = tl.sensitivities(scene, wrt=["v.elbow"], duration=0.39, accuracy=1e-7, samples_per_second=10)
    assert [event.kind for event in s.run.events][:2] == ["stick", "impact"]
    truth = differences(scene, lambda shift: moved(scene, 3, shift), 1e-4, 0.39, 10, TWO)
    assert abs(truth[-1, 1]) > 0.1
    require_within_bars(s, "v.elbow", truth, 1e-6)


def test_a_start_at_rest_with_friction_has_no_derivative_by_its_velocity() -> None:
    """Pushed up, the arm is braked by gravity and friction before it falls; pushed down, friction keeps its side."""
    scene = tl.Scene(ARM, [0.2, 0.4], [0.0, -1.0], [GRAVITY, fx.DryFriction({"shoulder": 0.5})])
    with refusal(
        AccuracyError,
        code="sensitivity-undefined",
        match=r"by a start that would move shoulder, .*at rest with friction",
    ):
        tl.sensitivities(scene, wrt=["v.shoulder"], duration=0.3, accuracy=1e-6)
    assert (
        tl.sensitivities(scene, wrt=["q.shoulder", "v.elbow"], duration=0.3, accuracy=1e-6).error["q.shoulder"].max()
        < 1e-5
    )


def test_what_has_no_derivative_is_named() -> None:
    """Two releases at one time; a stop that holds a joint at the start; how a loop closes."""
    both = arm(fx.Release(LOAD, at=0.1), fx.Release(SINE, at=0.1))
    rests = tl.Scene(ARM, [-1.57, -0.3], effects=[fx.JointStops({"elbow": (-0.3, 0.8)}), fx.Torque({"elbow": -9.0})])
    for scene, name in ((both, "effects.1.at"), (rests, "effects.0.limits.elbow.0")):
        with refusal(AccuracyError, code="sensitivity-undefined"):
            tl.sensitivities(scene, wrt=[name], duration=0.2)
    with refusal(SceneError, code="sensitivities-lengths"):
        tl.sensitivities(tl.load_scene("crank-spring"), wrt=["effects.0.point_a.0"], duration=0.1)


@pytest.mark.parametrize(("at", "stop", "what"), [(0.0, False, "start"), (0.5, True, "end"), (1.0, False, "end")])
@pytest.mark.parts
def test_a_state_that_changes_at_the_start_or_the_end_has_no_derivatives(at: float, stop: bool, what: str) -> None:
    """They would be those of the state before `then`, beside the run's state after it: 10.06 for 7.77."""
    kick = tl.effects.Watch("kick", at=at, then=lambda q, v: (q, 0.5 * v + q[0]), stop=stop)
    scene = tl.Scene(tl.load_robot("two_link"), [1.2, 0.5], effects=[tl.effects.Gravity(), kick], duration=1.0)
    for ask in (tl.sensitivities, lambda scene: tl.gradient(scene, objective=lambda run: float(run.v[-1, 0]))):
        with refusal(tl.errors.AccuracyError, code="sensitivity-undefined", match=f"at the {what} of the run"):
            ask(scene)
