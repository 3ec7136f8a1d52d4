"""Events of several joints and contacts at one instant, at the ends of runs, and changes of the state."""

import gc
import math
import weakref

import numpy as np
import pytest

import twolink as tl
from tests.effects.bodies import G, planar, slider, sliders, times
from tests.effects.cases import E

RAMP, FALLING = E.Polynomial((0.0, 1.0)), E.Polynomial((1.0, -1.0))
BOTH = E.JointStops({"one": (-1.0, 1.0), "two": (-1.0, 1.0)})
COUPLED = E.Coupling("one", "two", 1.0)
ENDS = {
    "a coupled spring with friction in both": (
        sliders, [1.0, 1.0], 1.5 * math.pi, [-0.1, -0.1],
        [COUPLED, E.JointSpring({"one": 300.0}), E.DryFriction({"one": 4.0, "two": 5.0})]),
    "coupled stops on both": (sliders, [1.0, 1.0], 2.0, [1 - 1 / 18] * 2, [COUPLED, BOTH, E.Torque({"one": FALLING})]),
    "two joints slip at once": (
        sliders, None, 2.0, [1 / 6, 1 / 12],
        [E.DryFriction({"one": 1.0, "two": 1.0}), E.Torque({"one": RAMP, "two": RAMP})]),
    "two stops let go at once": (
        sliders, [1.0, 1.0], 2.0, [1 - 1 / 6, 1 - 1 / 12], [BOTH, E.Torque({"one": FALLING, "two": FALLING})]),
    "a rod is lifted off both feet at once": (
        planar, None, 2.0, [0, G / 6, 0],
        [E.Gravity(), E.FrameWrench("body", (0.0, 0.0, E.Polynomial((0.0, G)))),
         *(E.PlaneContact("body", point=(s, 0.0, 0.0)) for s in (0.5, -0.5))]),
    "a kick at the beginning overcomes friction": (
        slider, None, 2.0, [2 / 3], [E.DryFriction({"x": 3.0}), E.Watch("k", at=0.0, then=lambda q, v: (q, v + 2))]),
    "what friction held against is released at the beginning": (
        slider, None, 1.0, [1.0], [E.DryFriction({"x": 1.0}), E.Torque({"x": 3.0}),
                                   E.Release(E.FrameWrench("x_link", (-3.0, 0.0, 0.0)), at=0.0)]),
}  # fmt: skip


@pytest.mark.parametrize("case", ENDS)
def test_what_happens_at_one_instant_leads_to_the_exact_end(case: str) -> None:
    robot, start, duration, end, effects = ENDS[case]
    run = tl.simulate(tl.Scene(robot(), start, effects=effects), duration, accuracy=1e-9)
    assert run.q[-1] == pytest.approx(end, abs=1e-9)


@pytest.mark.parametrize("c", [(1.0, 2.0), (2.0, 1.0)])
def test_coupled_joints_with_friction_in_both_slip_at_the_sum(c) -> None:
    effects = [E.Coupling("one", "two", 1.0), E.DryFriction({"one": c[0], "two": c[1]}), E.Torque({"one": RAMP})]
    run = tl.simulate(tl.Scene(sliders(), effects=effects), 5.0, accuracy=1e-9)
    assert np.abs(run.q - (np.fmax(run.t - 3, 0) ** 3 / 18)[:, None]).max() < 1e-9


def test_friction_in_every_joint_of_a_four_bar_takes_its_torque_times_the_angles() -> None:
    bundled = tl.load_scene("four-bar")
    friction = E.DryFriction(dict.fromkeys(bundled.robot.joint_names, 0.2))
    scene = tl.Scene(bundled.base, bundled.q, bundled.v, [*bundled.effects, friction])
    run = tl.simulate(scene, 0.5, accuracy=1e-6, samples_per_second=4000)
    angles = [np.asarray(run.columns()[f"q.{name}"]) for name in bundled.robot.joint_names]
    turned = sum(np.abs(np.diff(np.unwrap(angle))).sum() for angle in angles)
    assert turned > 1.0
    assert run.energy[0] - run.energy[-1] == pytest.approx(0.2 * turned, rel=1e-4)


@pytest.mark.slow
def test_bars_of_fixed_steps_hold_where_pieces_are_shorter_than_steps() -> None:
    effects = [E.JointSpring({"x": 300.0}), E.Torque({"x": -9.81}), E.JointStops({"x": (0.9, 10.0)}, restitution=0.9)]
    scene = tl.Scene(slider(), [1.0], effects=effects)
    truth = tl.simulate(scene, 2.0, accuracy=1e-10, samples_per_second=50)
    run = tl.simulate(scene, 2.0, method="rk4", step=0.2, samples_per_second=50)
    assert np.all(np.abs(run.q - truth.q).max(1) <= run.error + truth.error)


def test_a_watch_whose_then_goes_back_is_noted_once() -> None:
    saw = E.Watch("k", when=E.JointReaches("x", 1.0), then=lambda q, v: (q - 1, v))
    run = tl.simulate(tl.Scene(slider(), [0.0013], [1.0], [saw]), 3.5, accuracy=1e-9)
    assert times(run, "watch") == pytest.approx([0.9987, 1.9987, 2.9987])
    assert run.q[-1, 0] == pytest.approx(0.5013)


@pytest.mark.parametrize(
    "scene",
    [
        lambda t: tl.Scene(slider(), effects=[E.JointStops({"x": (-1.0, 1.0)}), E.Watch("k", at=0.5, then=t)]),
        lambda t: tl.Scene(planar(), [0, 1.0, 0], effects=[E.PlaneContact("body"), E.Watch("k", at=0.5, then=t)]),
    ],
)
def test_then_beyond_a_stop_or_a_plane_is_refused(scene) -> None:
    with pytest.raises(tl.errors.SceneError):
        tl.simulate(scene(lambda q, v: (q - 2, v)), 1.0, accuracy=1e-9)


def test_a_stop_that_is_hit_at_the_very_end_is_an_event() -> None:
    stops = E.JointStops({"x": (-1.0, 1.0)}, restitution=0.5)
    run = tl.simulate(tl.Scene(slider(), v=[1.0], effects=[stops]), 1.0, accuracy=1e-9)
    assert run.t[-1] == 1.0
    assert run.q[-1, 0] == pytest.approx(1.0, abs=1e-12)
    assert times(run, "impact") == pytest.approx([1.0], abs=1e-12)


def test_a_start_within_rounding_below_the_plane_counts_as_on_it() -> None:
    """Thrown up at 1 m/s, it flies 2 v / g and bounces without loss, four times in 0.9 s."""
    plane = E.PlaneContact("body", restitution=1.0)
    run = tl.simulate(tl.Scene(planar(), [0, -5e-10, 0], [0, 1.0, 0], [E.Gravity(), plane]), 0.9, accuracy=1e-8)
    flight = 2.0 / G
    s = run.t % flight
    assert np.abs(run.q[:, 1] - (s - 0.5 * G * s**2)).max() < 2e-8
    assert times(run, "impact") == pytest.approx(flight * np.arange(1, 5), abs=1e-8)


@pytest.mark.some(1)
@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
def test_a_rod_that_falls_flat_bounces_flat(e) -> None:
    feet = [E.PlaneContact("body", point=(s, 0.0, 0.0), restitution=e) for s in (0.5, -0.5)]
    run = tl.simulate(tl.Scene(planar(), [0, 0.1, 0], effects=[E.Gravity(), *feet]), 0.2, accuracy=1e-9)
    t, v = math.sqrt(0.2 / G), e * math.sqrt(0.2 * G)
    late = 0.2 - t
    assert run.q[-1] == pytest.approx([0, max(0.0, v * late - G * late**2 / 2) if e else 0.0, 0], abs=1e-8)


def test_friction_of_an_impact_does_not_push_where_it_slides_to() -> None:
    """The normal impulse turns the slip of the leaning rod round: friction must oppose the slip it ends with, too."""
    angle = 0.7
    contact = E.PlaneContact("body", point=(-0.5, 0.0, 0.0), restitution=0.5, friction=0.15)
    arm = 0.5 * np.array([math.cos(angle), math.sin(angle)])
    before = np.array([1.0, -2.0, 0.3])
    run = tl.simulate(
        tl.Scene(planar(), [0, float(arm[1]), angle], before, [E.Gravity(), contact]),
        1e-7,
        accuracy=1e-10,
        samples_per_second=1e7,
    )
    p, slip = (run.v[-1] - before)[0], run.v[-1] @ [1, 0, arm[1]]
    assert p * slip <= 0


def test_numpy_numbers_in_effects_give_the_bits_of_plain_ones() -> None:
    """Down a slope of 0.3 rad without friction: g sin(0.3) t^2 / 2 along it."""
    a = np.float64(0.3)
    normals = [(-np.sin(a), np.float64(0.0), np.cos(a)), (-math.sin(0.3), 0.0, math.cos(0.3))]
    runs = [tl.simulate(tl.Scene(planar(), effects=[E.Gravity(), E.PlaneContact("body", normal=n)]), 0.5, accuracy=1e-9)
            for n in normals]  # fmt: skip
    assert np.array_equal(runs[0].q, runs[1].q)
    way = runs[0].q[:, 0] * math.cos(0.3) + runs[0].q[:, 1] * math.sin(0.3)
    assert np.abs(way + 0.5 * G * math.sin(0.3) * runs[0].t ** 2).max() < 1e-9


def test_scenes_are_forgotten_when_nobody_needs_them() -> None:
    scene = tl.Scene(slider(), v=[1.0], effects=[E.DryFriction({"x": 1.0})])
    tl.simulate(scene, 0.1, verify=False)
    gone = weakref.ref(scene)
    del scene
    gc.collect()
    assert gone() is None
