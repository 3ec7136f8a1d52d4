"""Pendulums: release from symmetric rest, chaos, unstable balance, and very long runs."""

from __future__ import annotations

import math

from twolink.dynamics import load_robot
from twolink.effects import Gravity
from twolink.hard import truths
from twolink.lagrange.pinocchio_arm import arm_urdf
from twolink.scenes import Scene

G = 9.81
W0 = math.sqrt(G)


def _equal_rods() -> Scene:
    """Two equal rods at rest from the horizontal; of 3 kg, so that m l^2 / 12 is a double exactly."""
    robot = load_robot(arm_urdf(1.0, 1.0, 3.0, 3.0))
    return Scene(robot, effects=[Gravity((0.0, 0.0, -G))], title="The chaotic double pendulum")


CHAOTIC = ("chaos", "chaos-30s", "chaos-30s-quad")
SCENES = dict.fromkeys(CHAOTIC, _equal_rods)
PENDULUM = truths.configuration_error(truths.swing(math.pi / 2, W0, -math.pi / 2))
ERRORS = {
    "symmetric-rest": truths.stored("arm-swing"),
    **dict.fromkeys(CHAOTIC, truths.stored("chaos")),
    "upright-balance": truths.configuration_error(truths.toppling(1e-12, W0)),
    "pendulum-1000s": PENDULUM,
    "pendulum-100000s": PENDULUM,
    "million-steps": truths.energy_error(G),
}
