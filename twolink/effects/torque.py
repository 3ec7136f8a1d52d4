"""Torques and forces on joints as functions of time."""

from __future__ import annotations

from collections.abc import Mapping

from twolink.dynamics import Robot
from twolink.effects.effect import Effect
from twolink.effects.inputs import Input, check_input, value_at
from twolink.effects.joint_checks import check_joints
from twolink.effects.motion import Loads, Motion


class Torque(Effect, frozen=True):
    """tau_k = u_k(t) in each joint named.

    inputs: u by joint, N m or N: a number, Polynomial, Sine or Sampled table.
    """

    inputs: Mapping[str, Input]

    def check(self, robot: Robot) -> None:
        """Names are joints with one degree of freedom."""
        check_joints(self.inputs, robot, "inputs", dofs=True)
        for joint, given in self.inputs.items():
            check_input(given, f"inputs.{joint}")

    def act(self, motion: Motion, loads: Loads) -> None:
        """u(t)."""
        for joint, given in self.inputs.items():
            loads.torque(motion.dofs(joint)[0], value_at(given, motion.t, motion.xp))
