"""Stops of joints: closed forms, and the balance of momentum and energy at impacts."""

import math

import numpy as np
import pytest

import twolink as tl
from tests.effects.bodies import kinds, slider, sliders, solved, times
from tests.effects.cases import E, robot
from tests.near import assert_agree, assert_near
from twolink.errors import AccuracyError

STOP = {"x": (-1.0, 1.0)}


def test_bounces_between_two_stops_are_a_triangle_wave() -> None:
    run = solved(slider(), [E.JointStops(STOP, restitution=1.0)], 30.0, v=[0.7])
    way = 0.7 * run.t + 1.0
    assert_near(run.q[:, 0], 1.0 - np.abs(way % 4.0 - 2.0), 1e-9)
    assert len(times(run, "impact")) == 10


def test_without_restitution_and_without_load_it_stays_at_the_stop() -> None:
    run = solved(slider(), [E.JointStops(STOP)], 3.0, v=[1.0])
    assert_near(run.q[:, 0], np.fmin(run.t, 1.0), 1e-12)
    assert_near(run.events[0].energy, 0.5, 1e-12)


@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_starting_at_the_stop_at_rest_it_stays(restitution: float) -> None:
    for load in (0.0, 2.0):
        run = solved(slider(), [E.JointStops(STOP, restitution=restitution), E.Torque({"x": load})], 3.0, [1.0])
        assert np.all(run.q == 1.0)
        assert np.all(run.v == 0.0)


def test_resting_under_load_and_leaving_when_the_load_reverses() -> None:
    """Pressed by 1 - t: at the stop till t = 1, then -(t - 1)^3 / 6."""
    effects = [E.JointStops(STOP, restitution=0.5), E.Torque({"x": E.Polynomial((1.0, -1.0))})]
    run = solved(slider(), effects, 2.5, [1.0])
    assert_near(run.q[:, 0] - 1 + np.fmax(run.t - 1, 0) ** 3 / 6, 0.0, 1e-12)
    assert [(e.kind, e.t) for e in run.events] == [("leave", pytest.approx(1.0, abs=1e-12))]


def test_a_touch_without_room_is_not_promised() -> None:
    """Whether it touches decides over sqrt(2 rounding) of the phase, 25 times."""
    effects = [E.JointSpring({"x": 4.0}), E.JointStops({"x": (-1.0, 1.0)}, restitution=1.0)]
    scene = tl.Scene(slider(), v=[2.0], effects=effects)
    with pytest.raises(AccuracyError, match="cannot be kept") as refused:
        tl.simulate(scene, 20.0, accuracy=1e-9)
    assert_near(tl.simulate(scene, 20.0, accuracy=1e-3).q[:, 0], np.sin(2 * refused.value.run.t), 1e-3)


@pytest.mark.parametrize("room", [1e-9, -1e-9])
def test_a_grazing_touch(room: float) -> None:
    """An oscillation of amplitude 1 between stops there, but for 1e-9: each touch before the end skips 2 acos(stop)."""
    effects = [E.JointSpring({"x": 4.0}), E.JointStops({"x": (-1.0 - room, 1.0 + room)}, restitution=1.0)]
    run = solved(slider(), effects, 20.0, v=[2.0], accuracy=1e-6)
    half = math.pi / 2 - math.acos(min(1.0, 1.0 + room))
    touches = np.floor((2 * run.t + half) / (2 * half))
    expected = (-1) ** touches * np.sin(2 * run.t - touches * 2 * half)
    assert_near(run.q[:, 0], expected, 1e-6)
    assert not times(run, "rest").size


def test_two_stops_hit_at_the_same_instant() -> None:
    both = {"one": (-1.0, 1.0), "two": (-1.0, 1.0)}
    for load, e in ((0.0, 0.5), (3.0, 0.0)):
        effects = [E.JointStops(both, restitution=e), E.Torque({"one": load, "two": 2 * load})]
        run = solved(sliders(), effects, 2.0, v=[1.0, 1.0])
        hit = times(run, "impact")
        assert_near(hit[:2], [1.0, 1.0] if not load else [(math.sqrt(7) - 1) / 3] * 2, 1e-12)
        assert_near(run.q[-1], [0.5, 0.5] if not load else [1.0, 1.0], 1e-9)


def test_friction_and_a_stop_in_the_same_joint() -> None:
    """From 3 m/s against 1 N: sqrt(7) at the stop, half of it back, at rest after 7/8 m."""
    run = solved(slider(), [E.JointStops(STOP, restitution=0.5), E.DryFriction({"x": 1.0})], 4.0, v=[3.0])
    assert_near(run.q[-1, 0], 1 - 7 / 8, 1e-12)
    assert_near(times(run, "impact"), [3 - math.sqrt(7)], 1e-12)
    assert_near(times(run, "stick"), [3 - math.sqrt(7) / 2], 1e-12)


def test_friction_holds_at_the_stop_until_the_load_away_exceeds_it() -> None:
    """Pressed by 1 - t with friction 2: held until t = 3, then -(t - 3)^3 / 6 as it loads by t - 1 - 2."""
    effects = [E.JointStops(STOP), E.DryFriction({"x": 2.0}), E.Torque({"x": E.Polynomial((1.0, -1.0))})]
    run = solved(slider(), effects, 4.0, [1.0])
    assert_near(run.q[:, 0] - 1 + np.fmax(run.t - 3, 0) ** 3 / 6, 0.0, 1e-9)


@pytest.mark.parametrize("e", [0.0, 0.6, 1.0])
def test_the_balance_of_momentum_and_energy_at_the_elbows_stop(e: float) -> None:
    """M dv = (0, p), v_2 -> -e v_2: by the arm's own mass matrix, with p from the second row of its inverse."""
    arm = robot("arm")
    effects = [E.Gravity(), E.JointStops({"elbow": (-1.0, 1.0)}, restitution=e)]
    start = [0.3, 0.4], [0.5, 3.0]
    hit = tl.simulate(tl.Scene(arm, *start, effects=effects), 0.4, accuracy=1e-10).events[0]
    before = tl.simulate(tl.Scene(arm, *start, effects=[E.Gravity()]), hit.t, accuracy=1e-11)
    after = tl.simulate(tl.Scene(arm, *start, effects=effects), hit.t + 1e-7, accuracy=1e-10)
    mass = arm.mass_matrix(before.q[-1])
    column = np.linalg.inv(mass)[:, 1]
    expected = before.v[-1] - column * (1 + e) * before.v[-1, 1] / column[1]
    assert hit.kind == "impact"
    assert_near(before.q[-1, 1], 1.0, 1e-9)
    assert_near(after.v[-1], expected, 1e-5)
    lost = (before.v[-1] @ mass @ before.v[-1] - expected @ mass @ expected) / 2
    assert_near(hit.energy, lost, 1e-8)


def test_an_impact_in_a_closed_loop_moves_everything_that_hangs_together() -> None:
    """1 kg and 2 kg coupled: the stop of one of them turns both round; 3 kg lose (1 - e^2) of their energy."""
    effects = [E.Coupling("one", "two", 1.0), E.JointStops({"two": (-1.0, 1.0)}, restitution=0.5)]
    run = solved(sliders(), effects, 1.2, v=[2.0, 2.0])
    expected = np.where(run.t < 0.5, 2 * run.t, 1.5 - run.t)
    assert_near(run.q, expected[:, None], 1e-9)
    assert_near(run.events[0].energy, 0.5 * 3 * 4 * 0.75, 1e-9)


def test_a_loop_rests_at_a_stop_under_load_and_leaves() -> None:
    effects = [E.Coupling("one", "two", 1.0), E.JointStops({"two": (-1.0, 1.0)}),
               E.Torque({"one": E.Polynomial((1.0, -1.0))})]  # fmt: skip
    run = solved(sliders(), effects, 2.0, [1.0, 1.0])
    assert_near(run.q - 1 + (np.fmax(run.t - 1, 0) ** 3 / 18)[:, None], 0.0, 1e-9)


def test_an_arm_between_elastic_stops_is_chaotic_and_keeps_its_energy() -> None:
    arm = robot("arm")
    effects = [E.Gravity(), E.JointStops({"shoulder": (-2.5, 0.5), "elbow": (-1.0, 1.0)}, restitution=1.0)]
    scene = tl.Scene(arm, [0.3, 0.4], effects=effects)
    run = tl.simulate(scene, 3.0, accuracy=1e-6)
    assert len(times(run, "impact")) >= 6
    assert np.ptp(run.energy) < 1e-5
    assert np.all(run.q[:, 1] >= -1 - 1e-12)
    assert np.all(run.q[:, 1] <= 1 + 1e-12)
    finer = tl.simulate(scene, 3.0, accuracy=1e-8)
    assert_agree(run, finer)
    again = solved(arm, effects, 3.0, [0.3, 0.4], accuracy=1e-6)
    assert np.array_equal(run.q, again.q)
    assert run.events == again.events


def test_the_stops_of_the_urdf() -> None:
    """The slider's joint ends at +-99 m."""
    run = solved(slider(), [E.JointStops(restitution=1.0)], 2.0, [98.0], [1.0])
    assert_near(run.q[-1, 0], 98.0, 1e-9)
    assert kinds(run) == ["impact"]


@pytest.mark.parametrize(("q", "way"), [(1.1, "upper"), (-1.0 - 1e-6, "lower")])
def test_a_start_beyond_a_stop_is_refused(q: float, way: str) -> None:
    with pytest.raises(tl.errors.SceneError, match="beyond its stop at") as caught:
        tl.simulate(tl.Scene(slider(), [q], effects=[E.JointStops(STOP)]), 1.0)
    assert caught.value.where == "q"
    assert ("1" if way == "upper" else "-1") in str(caught.value)
