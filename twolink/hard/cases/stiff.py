"""Stiff springs and dampers, and steps too long for them."""

from __future__ import annotations

import math

import numpy as np

from twolink.dynamics import Robot
from twolink.hard import truths
from twolink.hard.case import Motion, Track, Truth, at

STIFF_W = 1e5  # rad/s: 1e10 N/m on 1 kg
CREEP_D, CREEP_K = 1e8, 1e8
RIGID_W0 = math.sqrt(0.75 * 9.81)  # two rods as one: m g c / I = 6 g / 8


def _creep(t: np.ndarray) -> np.ndarray:
    """m x'' + d x' + k x = 0 from x = 1 at rest, overdamped: by its two rates."""
    import mpmath as mp

    with mp.workdps(truths.DIGITS):
        d, k = mp.mpf(CREEP_D), mp.mpf(CREEP_K)
        root = mp.sqrt(d * d / 4 - k)
        slow, fast = -k / (d / 2 + root), -(d / 2 + root)
        return np.array([[float((fast * mp.exp(slow * x) - slow * mp.exp(fast * x)) / (fast - slow))] for x in
                         map(mp.mpf, t.tolist())])  # fmt: skip


def spin_kept(robot: Robot, track: Track) -> np.ndarray:
    """The governor's angular momentum about its shaft, relative change: nothing turns it."""
    momentum = np.einsum("nj,nj->n", robot.mass_matrix(track.q)[:, 0, :], track.v)
    return np.asarray(np.abs(momentum / momentum[0] - 1.0))


CASES = (
    Motion(
        name="stiff-spring", group="stiff",
        title="A spring of 1e10 N/m on 1 kg, for 3,200 periods",
        why="100,000 rad/s: steps beyond 20 microseconds are unstable for explicit methods, and methods that damp it "
            "away give a wrong answer that looks calm.",
        scene="stiff-spring", duration=0.2, samples=500.0, size=1.0,
        truth=Truth("closed form, cos(w t)", truths.of_configuration(truths.column(truths.oscillation(1.0, STIFF_W))),
                    quantity="error of q [m]", doubt=1e-13),
        settings=at(1e-3, 1e-6, 1e-9),
    ),
    Motion(
        name="stiff-elbow", group="stiff",
        title="A two-link arm whose elbow is a spring of 1e10 N m/rad",
        why="The fast mode, at 2.5e5 rad/s, has no amplitude to speak of, yet forbids long steps; the slow one is a "
            "rigid pendulum.",
        scene="stiff-elbow", duration=0.5, samples=100.0,
        truth=Truth("the rigid pendulum, in closed form; the elbow gives by 1e-9 rad",
                    truths.of_configuration(truths.column(truths.swing(1.0, RIGID_W0), factors=(1.0, 0.0))),
                    doubt=1e-8),
        settings=at(1e-3, 1e-5, 1e-7),
    ),
    Motion(
        name="stiff-damper", group="stiff",
        title="A spring of 1e8 N/m creeps through a damper of 1e8 N s/m",
        why="One mode dies within 1e-8 s, the other takes 1 s. An explicit method takes 3e7 steps a second for what "
            "a dozen points draw.",
        scene="stiff-damper", duration=3.0, samples=20.0,
        truth=Truth("closed form: two exponentials, in 60 digits", truths.of_configuration(_creep),
                    quantity="error of q [m]", doubt=1e-14),
        settings=at(1e-3, 1e-6, 1e-9),
    ),
    Motion(
        name="governor", group="stiff",
        title="IFToMM A05: the flyball governor, 10 s",
        why="Spring-dampers of 8e5 N/m and 4e4 N s/m hold a light slider: rates of 27,000 1/s beside a swing of 1 Hz.",
        scene="governor", duration=10.0, samples=10.0, peers=(),
        truth=Truth("angular momentum about the shaft is kept", spin_kept, "relative change of L_z", exact=False,
                    bar=lambda accuracy: 10 * accuracy),
        settings=at(1e-3, 1e-5, 1e-7),
    ),
    Motion(
        name="step-too-long", group="stiff",
        title="Steps too long for a method of fixed steps",
        why="1,000 rad/s at steps of 3 ms: Runge and Kutta's method multiplies each step's error by 1.6, and after "
            "1 s the numbers mean nothing, long before they overflow.",
        scene="spring-1000", duration=0.2, samples=50.0,
        truth=Truth("closed form, cos(w t)", truths.of_configuration(truths.column(truths.oscillation(1.0, 1000.0))),
                    quantity="error of q [m]", doubt=1e-14),
        settings=(*at(1e-3, method="rk4", step=3e-3), *at(1e-3, method="semi-implicit-euler", step=2.1e-3),
                  *at(1e-3, method="rk4")),
        may_refuse=1.0,
    ),
)  # fmt: skip
