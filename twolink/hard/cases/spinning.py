"""Free bodies that spin: fast, unstably, for hours, and a wheel after a million turns."""

from __future__ import annotations

import math

import mpmath as mp
import numpy as np

from twolink.dynamics import Robot
from twolink.hard import truths
from twolink.hard.case import Track

WHEEL_RATE = 2 * math.pi * 1000.0


def _quaternion_length(robot: Robot, track: Track) -> np.ndarray:
    """| |p| - 1 | of the free body's quaternion p."""
    del robot
    return np.asarray(np.abs(np.linalg.norm(track.q[:, 3:7], axis=1) - 1.0))


ERRORS = {
    "dzhanibekov": truths.stored("dzhanibekov"),
    "fast-spin": truths.configuration_error(truths.symmetric_top(1.0, 2.0, 1.0, 1e4)),
    "tumbling-3h": truths.configuration_error(truths.symmetric_top(1.0, 2.0, 3.0, 4.0)),
    "quaternion-stays-unit": _quaternion_length,
    "million-turns": truths.configuration_error(
        truths.in_digits(lambda t: [mp.cos(mp.mpf(WHEEL_RATE) * t), mp.sin(mp.mpf(WHEEL_RATE) * t)])
    ),
}
