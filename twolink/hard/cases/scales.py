"""Mass ratios, and units from micrometres to kilometres."""

from __future__ import annotations

import functools
import math

from twolink.dynamics import load_robot
from twolink.effects import Gravity
from twolink.hard import truths
from twolink.lagrange.pinocchio_arm import arm_urdf
from twolink.scenes import Scene

SLIDER_K, SLIDER_M, SLIDER_X = 1e-3, 1e-12, 1e-6
GEAR_K, GEAR_I, GEAR_J, GEAR_N = 1e-15, 1e-21, 4e-21, -2.0
GEAR_W = (GEAR_K / (GEAR_I + GEAR_N**2 * GEAR_J)) ** 0.5


def _rods(m1: float, m2: float) -> Scene:
    return Scene(load_robot(arm_urdf(1.0, 1.0, m1, m2)), q=[0.3, -0.5], effects=[Gravity((0.0, 0.0, -9.81))])


SCENES = {"light-tip": functools.partial(_rods, 1.0, 1e-9), "heavy-tip": functools.partial(_rods, 1e-9, 1.0)}
ERRORS = {
    "light-tip": truths.stored("light-tip"),
    "heavy-tip": truths.stored("heavy-tip"),
    "micrometre-slider": truths.configuration_error(truths.oscillation(SLIDER_X, (SLIDER_K / SLIDER_M) ** 0.5)),
    "micrometre-gears": truths.configuration_error(truths.oscillation(0.1, GEAR_W, (1.0, GEAR_N))),
    "kilometre-crane": truths.configuration_error(truths.swing(1.0, math.sqrt(9.81 / 1000.0))),
}
