"""Locating events and what becomes of the accuracy there: orders, error bars, ties, endings."""

import math

import numpy as np
import pytest

import twolink as tl
from tests.effects.bodies import G, bouncing, planar, slider, times
from tests.effects.cases import E
from tests.effects.test_dry_friction import spring_and_friction

SPRING_AND_FRICTION = (E.JointSpring({"x": 100.0}), E.DryFriction({"x": 3.0}))


def bounce(e: float = 0.5) -> tl.Scene:
    return tl.Scene(planar(), [0, 1.0, 0], effects=[E.Gravity(), E.PlaneContact("body", restitution=e)])


@pytest.mark.parametrize(("method", "order"), [("rk4", 4), ("semi-implicit-euler", 1)])
def test_methods_of_fixed_steps_keep_their_order_across_events(method: str, order: int) -> None:
    scene = tl.Scene(slider(), [1.0], effects=SPRING_AND_FRICTION)
    errors = []
    for step in (0.01, 0.005, 0.0025):
        run = tl.simulate(scene, 4.0, method=method, step=step, verify=False, samples_per_second=25)
        errors.append(np.abs(run.q[:, 0] - spring_and_friction(run.t, 1.0, 10.0, 0.03)).max())
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.abs(rates - order).max() < 0.3


@pytest.mark.parametrize("method", ["auto", "rk45", "dop853", "esdirk43", "rk4"])
def test_error_bars_hold_for_every_method(method: str) -> None:
    scene = tl.Scene(slider(), [1.0], effects=SPRING_AND_FRICTION)
    run = tl.simulate(scene, 4.0, accuracy=1e-5, method=method)
    assert np.all(np.abs(run.q[:, 0] - spring_and_friction(run.t, 1.0, 10.0, 0.03)) <= run.error)
    assert run.error[-1] <= 1e-5


@pytest.mark.parametrize("method", ["taylor", "scipy-dop853"])
def test_methods_that_cannot_locate_say_so(method: str) -> None:
    with pytest.raises(tl.errors.SceneError, match="does not locate events"):
        tl.simulate(tl.Scene(slider(), [1.0], effects=SPRING_AND_FRICTION), 1.0, method=method)


@pytest.mark.parametrize("e", [0.3, 0.8])
def test_infinitely_many_bounces_end_where_their_sum_does(e: float) -> None:
    ends = math.sqrt(2 / G) * (1 + e) / (1 - e)
    run = tl.simulate(bounce(e), ends + 0.5, accuracy=1e-9)
    assert times(run, "rest")[0] == pytest.approx(ends, abs=1e-9)
    assert np.all(np.abs(run.q[:, 1] - bouncing(run.t, 1.0, e)) <= run.error)
    assert np.all(run.v[run.t > ends] == 0)


def test_the_same_again_and_without_verification() -> None:
    first, again = tl.simulate(bounce(), 2.0), tl.simulate(bounce(), 2.0)
    alone = tl.simulate(bounce(), 2.0, verify=False)
    assert np.array_equal(first.q, again.q)
    assert np.array_equal(first.v, again.v)
    assert first.events == again.events
    assert alone.error is None
    assert np.abs(alone.q[:, 1] - bouncing(alone.t, 1.0, 0.5)).max() < 1e-6


def test_the_samples_asked_for_change_nothing() -> None:
    many, few = (
        tl.simulate(bounce(), 2.0, accuracy=1e-9, samples_per_second=1000),
        tl.simulate(bounce(), 2.0, accuracy=1e-9, samples_per_second=10),
    )
    assert np.abs(many.q[::100] - few.q).max() < 1e-12
    assert [e.kind for e in many.events] == [e.kind for e in few.events]


def test_an_event_at_a_sample() -> None:
    """A stop hit at t = 1 exactly, which is a sample."""
    scene = tl.Scene(slider(), v=[1.0], effects=[E.JointStops({"x": (-1.0, 1.0)}, restitution=0.5)])
    run = tl.simulate(scene, 2.0, accuracy=1e-9)
    assert np.abs(run.q[:, 0] - np.where(run.t < 1, run.t, 1.5 - run.t / 2)).max() < 1e-12
    assert np.all(np.diff(run.t) > 0)
    assert len(run.events) == 1


def test_two_zeros_within_a_step_are_both_found() -> None:
    """Free flight is one step: a dip of 1e-4 s below a threshold in it is seen."""
    dip = 0.5 * G * (0.5e-4) ** 2
    top = E.Watch("top", when=E.FrameReaches("body", G / 8 - dip))
    scene = tl.Scene(planar(), v=[0, G / 2, 0], effects=[E.Gravity(), top])
    found = times(tl.simulate(scene, 1.0, accuracy=1e-6), "watch")
    assert found == pytest.approx([0.5 - 0.5e-4, 0.5 + 0.5e-4], abs=1e-9)


@pytest.mark.parametrize("beyond", [1e-6, -1e-6])
def test_a_watch_near_a_turning_point_is_noted_twice_or_not_at_all(beyond: float) -> None:
    """x = cos(2 t) passes -1 + 1e-6 in both directions, 0.5 acos(1 - 1e-6) s before and after its turn."""
    end = E.Watch("end", when=E.JointReaches("x", -1.0 + beyond))
    scene = tl.Scene(slider(), [1.0], effects=[E.JointSpring({"x": 4.0}), end])
    half = 0.5 * math.acos(1 - 1e-6)
    expected = [math.pi / 2 - half, math.pi / 2 + half] if beyond > 0 else []
    assert times(tl.simulate(scene, 3.0, accuracy=1e-10), "watch") == pytest.approx(expected, abs=1e-7)


@pytest.mark.parametrize("start", [0.0, 1.0])
def test_a_watch_that_begins_at_its_value_waits_for_the_next_time(start: float) -> None:
    zero = E.Watch("zero", when=E.JointReaches("x", 0.0))
    scene = tl.Scene(slider(), v=[1.0], effects=[E.JointSpring({"x": 4.0}), zero])
    found = times(tl.simulate(scene, 4.0 + start, accuracy=1e-9), "watch")
    assert found == pytest.approx([n * math.pi / 2 for n in range(1, 3 + int(start))], abs=1e-9)


def test_tables_that_break_together_with_events() -> None:
    """Sampled loads that bend at every 0.1 s, against the same loads given as what they are."""
    knots = np.linspace(0, 4, 41)
    table = E.Sampled(knots.tolist(), (2.0 * knots).tolist(), interpolation="linear")
    runs = []
    for load in (table, E.Polynomial((0.0, 2.0))):
        effects = [E.DryFriction({"x": 3.0}), E.Torque({"x": load}), E.JointStops({"x": (-1.0, 0.5)}, restitution=0.5)]
        runs.append(tl.simulate(tl.Scene(slider(), effects=effects), 4.0, accuracy=1e-8))
    assert np.all(np.abs(runs[0].q - runs[1].q).max(axis=1) <= runs[0].error + runs[1].error)
    assert [e.kind for e in runs[0].events] == [e.kind for e in runs[1].events]
    assert [e.t for e in runs[0].events] == pytest.approx([e.t for e in runs[1].events], abs=1e-6)


def test_without_the_native_library_events_are_located(monkeypatch: pytest.MonkeyPatch) -> None:
    """By the same steps and programs, by NumPy."""
    scene = tl.load_scene("bouncing-ball")
    compiled = tl.simulate(scene, 0.5, accuracy=1e-6)
    monkeypatch.setattr("twolink.native.programs._kept", {})
    for module in ("integrate.solver", "integrate.steps.step_map", "native.machine"):
        monkeypatch.setattr(f"twolink.{module}.library", lambda: None)
    run = tl.simulate(tl.load_scene("bouncing-ball"), 0.5, accuracy=1e-6)
    assert not run.cost.compiled
    assert [e.kind for e in run.events] == [e.kind for e in compiled.events] != []
    np.testing.assert_allclose(run.q, compiled.q, rtol=0, atol=2e-6)
