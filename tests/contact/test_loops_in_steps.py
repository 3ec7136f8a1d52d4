"""Contacts that are stepped on robots with loops: a rod that a loop makes a pendulum, with a ball at its end."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import twolink as tl
from tests.effects.bodies import G, planar, stepped
from tests.near import assert_near

E = tl.effects
L, PIN, RADIUS = 0.5, 1.0, 0.1  # m: from the pin to the centre of mass, the pin's height, the ball's radius
START = 0.4  # rad


def pendulum(height: float) -> tl.Scene:
    """The rod swings down from rest, above a plane of this height, from which its end does not bounce."""
    contact = E.Contact((("body", E.Plane(height=height)),), shapes={"body": (E.Sphere(RADIUS, (L, 0.0, 0.0)),)})
    loop = E.PointLoop("body", point_a=(-L, 0.0, 0.0), point_b=(0.0, 0.0, PIN))
    q = [L * math.cos(START), PIN + L * math.sin(START), START]
    return tl.Scene(planar(), q, effects=[E.Gravity(), loop, contact])


def angle(t: np.ndarray, lowest: float = -math.inf) -> np.ndarray:
    """(I + m l^2) th'' = -m g l cos th, and rest at the lowest angle."""

    def rate(_: float, y: np.ndarray) -> list[float]:
        return [y[1], -G * L * math.cos(y[0]) / (0.1 + L**2)]

    end = solve_ivp(rate, (0.0, t[-1] + 1e-9), [START, 0.0], "DOP853", rtol=1e-11, atol=1e-12, t_eval=t).y[0]
    fallen = np.maximum.accumulate(end < lowest)
    return np.where(fallen, lowest, end)


def run_of(height: float, step: float) -> tl.Trajectory:
    return stepped(pendulum(height), 1.0, step)


def test_a_loop_holds_a_rod_and_does_no_work() -> None:
    """Of second order; the loop stays closed, as it does not by itself."""
    runs = [run_of(-9.0, step) for step in (0.01, 0.005)]
    off = [np.abs(run.q[:, 2] - angle(run.t)).max() for run in runs]
    assert off[0] / off[1] == pytest.approx(4.0, rel=0.1)
    assert off[1] < 1e-3
    lost = [np.abs(run.energy - run.energy[0]).max() for run in runs]
    assert lost[0] / lost[1] == pytest.approx(4.0, rel=0.2)
    for run in runs:
        ends = run.q[:, :2] - L * np.stack([np.cos(run.q[:, 2]), np.sin(run.q[:, 2])], axis=1)
        gap = np.abs(ends - [0.0, PIN]).max()
        assert gap <= run.contact_record["overlap"] * (1 + 1e-9) < 4e-5


def test_a_rod_in_a_loop_falls_on_the_ground_and_rests() -> None:
    """Its end is at rest where sin th = -0.4; the loop and the ground share its weight: half of it on either."""
    lowest = -math.asin(0.4)
    run = run_of(PIN - 0.4 - RADIUS, 0.01)
    assert_near(run.q[:, 2], angle(run.t, lowest), 2e-2)
    assert_near(run.q[-1, 2], lowest, 1e-9)
    assert_near(run.v[-1], 0.0, 1e-9)
    assert run.contact_forces["body - plane"][-1, 2] == pytest.approx(G / 2, rel=1e-9)


def test_explain_counts_the_rows_of_loops() -> None:
    assert "2 rows of loops hold" in repr(tl.explain(pendulum(0.5), duration=0.1, contact="stepped"))
