"""Guards that begin at 0, and zeros and minima by evaluations in batches."""

import math
from collections.abc import Callable

import numpy as np
import pytest

import twolink as tl
from tests.effects.bodies import slider, times
from tests.effects.cases import E
from twolink.integrate.hybrid.locating import Guard
from twolink.integrate.hybrid.roots import crossing, lowest

T = np.array([0.0, 0.1, 0.2, 0.3])


def guard(first: float, *, side: float | None = 1.0, fired: bool = False) -> Guard:
    made = Guard(("test", 0), lambda snapshot: snapshot, print, 0.0, side=side)
    made.begin(first, 1e-13, fired=fired)
    return made


def test_a_guard_away_from_0_gives_its_values() -> None:
    values = np.array([3.0, 2.0, 1.0, -1.0])
    assert np.array_equal(guard(3.0).observe(T, values), values)
    assert np.array_equal(guard(-3.0, side=-1.0).observe(T, -values), values)


def test_a_guard_that_begins_at_0_counts_from_where_it_has_moved_away() -> None:
    """Its zero at the start is no event; the next one, between 0.2 and 0.3, is."""
    seen = guard(1e-14).observe(T, np.array([1e-14, 1e-14, 0.4, -0.2]))
    assert np.all(np.isinf(seen[:2]))
    assert seen[2] > 0 > seen[3]


def test_a_guard_that_stays_within_its_noise_never_fires() -> None:
    assert np.all(np.isinf(guard(0.0).observe(T, np.array([0.0, -5e-14, 5e-14, -9e-14]))))


def test_a_guard_whose_zero_was_an_event_does_not_fire_again_at_once() -> None:
    """Located up to slope x rounding, its value may lie on the wrong side by more than what counts as 0."""
    values = np.array([-4e-12, -3e-12, 0.4, -0.2])
    assert np.all(guard(values[0], fired=True).observe(T, values)[:3] > 0)
    assert guard(values[0]).observe(T, values)[0] < 0


def test_a_guard_of_unknown_side_takes_the_first_sign_that_it_sees() -> None:
    one = guard(0.0, side=None)
    assert one.observe(T, np.array([0.0, -1.0, -2.0, 1.0]))[3] < 0
    assert one.side == -1.0


@pytest.mark.parametrize(("f", "a", "b", "zero"), [
    (lambda t: math.pi / 8 - t, 0.0, 1.0, math.pi / 8),
    (np.cos, 1.0, 2.0, math.pi / 2),
    (lambda t: (0.7 - t) ** 3, 0.0, 1.0, 0.7),
    (lambda t: np.where(t < 0.3, 1.0, -1.0), 0.0, 1.0, 0.3),
    (lambda t: np.where(t < 0.1, np.inf, np.exp(-40 * t) - math.exp(-20.0)), 0.0, 1.0, 0.5),
])  # fmt: skip
def test_the_crossing_is_found_to_the_resolution(
    f: Callable[[np.ndarray], np.ndarray], a: float, b: float, zero: float
) -> None:
    batches = []

    def counted(t: np.ndarray) -> np.ndarray:
        batches.append(len(t))
        return np.asarray(f(t))

    ends = np.array([a, b])
    found = crossing(counted, ends, np.asarray(f(ends)), 1e-15)
    assert found == pytest.approx(zero, abs=1e-5 if zero == 0.7 else 4e-15)
    assert len(batches) <= 27


def test_a_smooth_crossing_takes_few_batches() -> None:
    batches = []

    def counted(t: np.ndarray) -> np.ndarray:
        batches.append(len(t))
        return np.asarray(np.cos(t))

    points = np.linspace(1.4, 1.65, 6)
    crossing(counted, points, np.cos(points), 1e-15)
    assert len(batches) <= 4


@pytest.mark.parametrize("middle", [0.123456, 0.5, 0.9])
def test_the_lowest_point_of_a_dip_is_found(middle: float) -> None:
    point, value = lowest(lambda t: (t - middle) ** 2 - 1e-9, 0.0, 1.0)
    assert point == pytest.approx(middle, abs=2e-6)
    assert value == pytest.approx(-1e-9, abs=1e-11)


def test_a_drive_at_its_limit_of_effort_is_not_refused_as_events_without_end() -> None:
    """A fast target drives a pendulum from one limit to the other. The limit is left where the demand says so."""
    robot = tl.load_robot("friction_pendulum")
    drive = E.JointPD({"axle": E.Sine(1.0, 20.0)}, {"axle": 100.0}, {"axle": 4.0}, {}, {"axle": 10.0})
    run = tl.simulate(tl.Scene(robot, effects=[E.Gravity(), drive]), 1.0, accuracy=1e-3, samples_per_second=2000)
    demand = 100 * (np.sin(20 * run.t) - run.q[:, 0]) - 4 * run.v[:, 0]
    inside = np.abs(demand) < 10
    changes = np.flatnonzero(np.diff(inside.astype(int)))
    assert len(changes) >= 12
    assert len(times(run, "limit")) == len(changes)
    assert np.abs(times(run, "limit") - run.t[changes]).max() < 2e-3


@pytest.mark.parametrize("stiffness", [1e6, 1e8])
def test_a_watch_on_a_velocity_beside_a_stiff_spring_is_noted_once_a_crossing(stiffness: float) -> None:
    """x = cos(w t): the velocity passes 0 at multiples of pi / w, with a slope of stiffness times x."""
    w, robot = math.sqrt(stiffness), slider()
    watch = E.Watch("turn", when=E.JointReaches("x", 0.0, of="velocity"))
    scene = tl.Scene(robot, [1e-3], [-1e-3 * w], [E.JointSpring({"x": stiffness}), watch])
    run = tl.simulate(scene, 20.0 / w, accuracy=1e-9)
    expected = math.pi * np.arange(1, 7) / w - math.pi / 4 / w
    np.testing.assert_allclose([e.t for e in run.events], expected, rtol=0, atol=1e-5 / w)
