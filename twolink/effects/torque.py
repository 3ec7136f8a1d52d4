"""Torques and forces in joints as functions of time."""

from collections.abc import Mapping

from twolink.dynamics import Robot
from twolink.effects.effect import Effect
from twolink.effects.inputs import Input, value_at
from twolink.effects.joint_checks import check_joints
from twolink.effects.motion import Loads, Motion


class Torque(Effect, frozen=True):
    """Torques and forces in joints: tau_k = u_k(t).

    Parameters
    ----------
    inputs : mapping of joint to input
        u, N m or N: numbers, `Polynomial`, `Sine` or `Sampled` tables. Joints with one degree of freedom.
    """

    inputs: Mapping[str, Input]

    def check(self, robot: Robot) -> None:
        """Require joints with one degree of freedom."""
        check_joints(self.inputs, robot, "inputs", dofs=True)

    def act(self, motion: Motion, loads: Loads) -> None:
        """Add u(t)."""
        for joint, u in self.inputs.items():
            loads.torque(motion.dofs(joint)[0], value_at(u, motion.t, motion.xp))
