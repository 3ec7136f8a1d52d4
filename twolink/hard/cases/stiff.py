"""Stiff springs and dampers, and steps too long for them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import mpmath as mp
import numpy as np

from twolink.dynamics import Robot
from twolink.hard import truths
from twolink.hard.case import Track

CREEP_D, CREEP_K = 1e8, 1e8
RIGID_W0 = math.sqrt(0.75 * 9.81)  # two rods as one: m g c / I = 6 g / 8


def _creep(t: Any) -> Sequence[Any]:
    """x'' + d x' + k x = 0 from x = 1 at rest, overdamped: the sum of two exponentials."""
    d, k = mp.mpf(CREEP_D), mp.mpf(CREEP_K)
    root = mp.sqrt(d * d / 4 - k)
    slow, fast = -k / (d / 2 + root), -(d / 2 + root)
    return [(fast * mp.exp(slow * t) - slow * mp.exp(fast * t)) / (fast - slow)]


def _spin_change(robot: Robot, track: Track) -> np.ndarray:
    """The relative change of the governor's angular momentum about its shaft, about which no torque acts."""
    momentum = np.einsum("nj,nj->n", robot.mass_matrix(track.q)[:, 0, :], track.v)
    return np.asarray(np.abs(momentum / momentum[0] - 1.0))


ERRORS = {
    "stiff-spring": truths.configuration_error(truths.oscillation(1.0, 1e5)),
    "stiff-elbow": truths.configuration_error(truths.swing(1.0, RIGID_W0, factors=(1.0, 0.0))),
    "stiff-damper": truths.configuration_error(truths.in_digits(_creep)),
    "governor": _spin_change,
    "step-too-long": truths.configuration_error(truths.oscillation(1.0, 1000.0)),
}
