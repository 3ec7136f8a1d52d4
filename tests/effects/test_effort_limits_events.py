"""Limits of effort, where they begin and cease to act: found, and no loss of accuracy there."""

import math

import numpy as np
import pytest

import twolink as tl
from tests.effects.bodies import slider, times
from tests.effects.cases import E, robot


def spring_of_limited_force(t: np.ndarray, k: float, most: float) -> tuple[np.ndarray, list[float]]:
    """x of 1 kg from 1 m at rest under -k x, but within +-most, and when the limit begins or ceases to act."""
    edge, w = most / k, math.sqrt(k)
    free = math.sqrt(2 * (1 - edge) / most)  # until the limit ceases
    speed = most * free
    inner = 2 * math.atan2(edge * w, speed) / w  # through the middle to -edge
    quarter = free + inner / 2
    s = t % (4 * quarter)
    mirror = np.where(s > 2 * quarter, 4 * quarter - s, s)
    u = np.minimum(mirror, 2 * quarter - mirror)
    middle = (speed**2 / k + edge**2) ** 0.5 * np.sin(w * (quarter - u))
    x = np.where(u < free, 1 - most * u**2 / 2, middle) * np.where(mirror > quarter, -1.0, 1.0)
    ends = [n * 2 * quarter + side for n in range(20) for side in (free, free + inner)]
    return x, ends


@pytest.mark.parametrize("accuracy", [1e-3, 1e-6, 1e-9])
def test_a_saturated_spring(accuracy: float) -> None:
    pd = E.JointPD(target={"x": 0.0}, kp={"x": 20.0}, effort={"x": 3.0})
    run = tl.simulate(tl.Scene(slider(), [1.0], effects=[pd]), 5.0, accuracy=accuracy)
    x, ends = spring_of_limited_force(run.t, 20.0, 3.0)
    assert np.all(np.abs(run.q[:, 0] - x) <= run.error)
    assert run.error[-1] <= accuracy
    assert times(run, "limit") == pytest.approx([t for t in ends if t < 5], abs=10 * accuracy)


def test_a_limit_that_is_never_reached_is_no_event() -> None:
    effects = [E.JointPD({"x": 0.0}, {"x": 4.0}, effort={"x": 4.5})]
    run = tl.simulate(tl.Scene(slider(), [1.0], effects=effects), 5.0, accuracy=1e-9)
    assert not run.events
    assert np.abs(run.q[:, 0] - np.cos(2 * run.t)).max() < 1e-9


def test_a_limit_that_is_just_touched_changes_nothing() -> None:
    effects = [E.JointPD({"x": 0.0}, {"x": 4.0}, effort={"x": 4.0})]
    run = tl.simulate(tl.Scene(slider(), [0.0], [2.0], effects), 10.0, accuracy=1e-9)
    assert np.abs(run.q[:, 0] - np.sin(2 * run.t)).max() < 1e-9


@pytest.mark.slow
def test_limits_on_the_arm_against_small_steps() -> None:
    """Events change the effort, not the result: a second way by small steps that know nothing of events."""
    target, effort = {"shoulder": 0.5, "elbow": -0.5}, {"shoulder": 30.0, "elbow": 8.0}
    drive = E.JointPD(target, {"shoulder": 200.0, "elbow": 80.0}, {"shoulder": 20.0, "elbow": 8.0}, effort=effort)
    effects = [E.Gravity(), drive]
    scene = tl.Scene(robot("arm"), [-1.0, 0.5], effects=effects)
    run = tl.simulate(scene, 2.0, accuracy=1e-8)
    other = tl.simulate(scene, 2.0, method="scipy-dop853", tolerance=1e-10)
    assert len(times(run, "limit")) >= 2
    assert np.abs(run.q - other.q).max() < 1e-6
