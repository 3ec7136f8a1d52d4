"""Viscous damping of joints."""

from __future__ import annotations

from collections.abc import Mapping

from twolink.algorithms.spatial import times
from twolink.dynamics import Robot
from twolink.effects.effect import Effect
from twolink.effects.joint_checks import check_joints, check_values
from twolink.effects.motion import Loads, Motion
from twolink.errors import SceneError


class JointDamping(Effect, frozen=True):
    """Viscous damping of joints: tau = -d v.

    Parameters
    ----------
    damping : mapping of joint to float, or None
        d, N m s/rad or N s/m, not negative; the same for each degree of freedom of a joint. None: all joints, with the
        values of the URDF (<dynamics damping>), which forward dynamics alone does not apply.
    """

    damping: Mapping[str, float] | None = None

    def check(self, robot: Robot) -> None:
        """Require joints and damping that is not negative, or damping in the URDF."""
        if self.damping is None:
            if not robot.model.damping.any():
                remedy = "give it by joint, or leave the effect out"
                raise SceneError("the URDF gives no joint damping", where="damping", remedy=remedy)
            return
        check_joints(self.damping, robot, "damping")
        check_values(self.damping, "damping", least=0.0)

    def act(self, motion: Motion, loads: Loads) -> None:
        """Add -d v."""
        damping = dict(enumerate(motion.model.damping.tolist()))
        if self.damping is not None:
            damping = {k: float(d) for joint, d in self.damping.items() for k in motion.dofs(joint)}
        for k, d in damping.items():
            loads.torque(k, times(-d, motion.v[k]))
