"""Springs in joints."""

from __future__ import annotations

from collections.abc import Mapping

from twolink.algorithms.spatial import plus, times
from twolink.dynamics import Robot
from twolink.effects.effect import Effect, one_of
from twolink.effects.joint_checks import check_joints, check_values
from twolink.effects.motion import Loads, Motion


class JointSpring(Effect, frozen=True):
    """tau = -k (q - q0) in each joint named: Hooke's law, with the energy k (q - q0)^2 / 2.

    stiffness: k by joint, N m/rad or N/m. rest: q0 by joint, rad or m; 0 unless given.
    """

    stiffness: Mapping[str, float]
    rest: Mapping[str, float] = {}

    def check(self, robot: Robot) -> None:
        """Names are joints with one coordinate; stiffness is not negative."""
        check_joints(self.stiffness, robot, "stiffness", coordinates=True)
        check_values(self.stiffness, "stiffness", least=0.0)
        if self.rest:
            check_joints(self.rest, robot, "rest")
        for joint in self.rest:
            one_of(joint, self.stiffness, "rest", "joint with a stiffness")
        check_values(self.rest, "rest")

    def act(self, motion: Motion, loads: Loads) -> None:
        """-k (q - q0)."""
        for joint, k in self.stiffness.items():
            entry, dof = motion.coordinate(joint)
            loads.torque(dof, times(-float(k), plus(motion.q[entry], -float(self.rest.get(joint, 0.0)))))
