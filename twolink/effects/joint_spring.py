"""Springs in joints."""

from collections.abc import Mapping

from twolink.algorithms.spatial import plus, times
from twolink.dynamics import Robot
from twolink.effects.effect import Effect, NotNegative, number
from twolink.effects.joint_checks import check_joints, check_subset
from twolink.effects.motion import Loads, Motion


class JointSpring(Effect, frozen=True):
    """Springs in joints (Hooke's law): tau = -k (q - q0), with the energy k (q - q0)^2 / 2.

    Parameters
    ----------
    stiffness : mapping of joint to float
        k, N m/rad or N/m, not negative. Joints with one coordinate.
    rest : mapping of joint to float
        q0, rad or m; 0 by default.
    """

    stiffness: Mapping[str, NotNegative]
    rest: Mapping[str, float] = {}

    def check(self, robot: Robot) -> None:
        """Require joints with one coordinate."""
        check_joints(self.stiffness, robot, "stiffness", coordinates=True)
        check_subset(self.rest, self.stiffness, "rest", "joint with a stiffness")

    def act(self, motion: Motion, loads: Loads) -> None:
        """Add -k (q - q0)."""
        for joint, k in self.stiffness.items():
            entry, dof = motion.coordinate(joint)
            loads.torque(dof, times(-number(k), plus(motion.q[entry], -number(self.rest.get(joint, 0.0)))))
