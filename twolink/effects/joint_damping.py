"""Viscous damping of joints."""

from collections.abc import Mapping

from twolink.algorithms.spatial import times
from twolink.dynamics import Robot
from twolink.effects.effect import Effect, NotNegative
from twolink.effects.joint_checks import check_values_or_urdf, values_by_dof
from twolink.effects.motion import Loads, Motion


class JointDamping(Effect, frozen=True):
    """Viscous damping of joints: tau = -d v.

    Parameters
    ----------
    damping : mapping of joint to float, or None
        d, N m s/rad or N s/m, not negative; the same for each degree of freedom of a joint. None: all joints, with the
        values of the URDF (<dynamics damping>), which forward dynamics alone does not apply.
    """

    damping: Mapping[str, NotNegative] | None = None

    def check(self, robot: Robot) -> None:
        """Require joints, or damping in the URDF."""
        check_values_or_urdf(self.damping, robot.model.damping, robot, "damping")

    def act(self, motion: Motion, loads: Loads) -> None:
        """Add -d v."""
        for k, d in values_by_dof(self.damping, motion.model.damping, motion).items():
            loads.torque(k, times(-d, motion.v[k]))
