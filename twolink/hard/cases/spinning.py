"""Free bodies that spin: fast, unstably, for hours, and a wheel after a million turns."""

from __future__ import annotations

import math

import numpy as np

from twolink.dynamics import Robot
from twolink.hard import truths
from twolink.hard.case import Motion, Track, Truth, at
from twolink.hard.high_precision import stored
from twolink.scenes import load_scene

WHEEL_RATE = 2 * math.pi * 1000.0


def _turned(t: np.ndarray) -> np.ndarray:
    """(cos, sin) of the wheel's angle, reduced in many digits."""
    import mpmath as mp

    with mp.workdps(truths.DIGITS):
        angles = [mp.mpf(WHEEL_RATE) * mp.mpf(float(x)) for x in t]
        return np.array([[float(mp.cos(a)), float(mp.sin(a))] for a in angles])


def unit_quaternion(robot: Robot, track: Track) -> np.ndarray:
    """How far from 1 the quaternion's length is."""
    del robot
    return np.asarray(np.abs(np.linalg.norm(track.q[:, 3:7], axis=1) - 1.0))


CASES = (
    Motion(
        name="dzhanibekov", group="spinning",
        title="Dzhanibekov: a box spun about its middle axis turns over, again and again",
        why="The middle axis is unstable: each turn-over multiplies the error before it. Methods that treat the "
            "gyroscopic term explicitly gain energy, and turn at the wrong time or not at all.",
        scene=lambda: load_scene("spinning-top"), duration=100.0, samples=2.0,
        truth=Truth("Euler's equations with a quaternion in 200 bits, every 5 s",
                    truths.of_configuration(truths.at_known_times(*stored("dzhanibekov"))), doubt=1e-14),
        settings=at(1e-3, 1e-6, 1e-9),
    ),
    Motion(
        name="fast-spin", group="spinning",
        title="A flywheel at 10,000 rad/s, tumbling a little",
        why="It turns by 20 rad within MuJoCo's default step of 2 ms, and precesses by 20 more: sampled too rarely, a "
            "rotation looks like another one.",
        scene="flywheel", duration=1.0, samples=100.0,
        truth=Truth("closed form of the symmetric free body: two rotations, in 60 digits",
                    truths.of_configuration(truths.symmetric_top(1.0, 2.0, 1.0, 1e4)), doubt=1e-13),
        settings=at(1e-3, 1e-6, 1e-9),
    ),
    Motion(
        name="tumbling-3h", group="spinning", slow=True,
        title="A free body that tumbles for three hours",
        why="Quaternions drift off the unit sphere, and the phase of 10,000 turns adds up.",
        scene="tumbler", duration=10_800.0, samples=0.05,
        truth=Truth("closed form of the symmetric free body: two rotations, in 60 digits",
                    truths.of_configuration(truths.symmetric_top(1.0, 2.0, 3.0, 4.0)), doubt=1e-11),
        settings=at(1e-3, 1e-6, 1e-9), may_refuse=1e-9,
    ),
    Motion(
        name="quaternion-stays-unit", group="spinning",
        title="The quaternion's length after 600 s of tumbling",
        why="A quaternion that is integrated as four numbers leaves the unit sphere, and the rotation shears.",
        scene="tumbler", duration=600.0, samples=1.0, peers=(),
        truth=Truth("it is 1", unit_quaternion, "length of the quaternion, less 1", exact=False, bar=lambda _: 1e-15),
        settings=at(1e-3, 1e-6, 1e-9),
    ),
    Motion(
        name="million-turns", group="spinning", slow=True,
        title="A wheel after a million turns",
        why="6.3 million rad: an angle that counts turns loses digits to its own size, and so does the sine of it.",
        scene="wheel", duration=1000.0, samples=0.1,
        truth=Truth("closed form, w t, reduced in 60 digits",
                    truths.of_configuration(_turned), doubt=1e-13),
        settings=at(1e-3, 1e-6, 1e-8), may_refuse=1e-8,
    ),
)  # fmt: skip
