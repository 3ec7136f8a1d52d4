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
    """tau = -d v in each joint named, or in all joints with the damping their URDF gives.

    damping: d by joint, N m s/rad or N s/m; of a joint with several degrees of freedom the same for each. Left out:
    the URDF's values, which forward dynamics alone does not apply.
    """

    damping: Mapping[str, float] | None = None

    def check(self, robot: Robot) -> None:
        """Names are joints; damping is not negative; the URDF gives some where it is asked."""
        if self.damping is None:
            if not robot.model.damping.any():
                raise SceneError("the URDF gives no joint damping", where="damping",
                                 remedy="give it by joint, or leave the effect out")  # fmt: skip
            return
        check_joints(self.damping, robot, "damping")
        check_values(self.damping, "damping", least=0.0)

    def act(self, motion: Motion, loads: Loads) -> None:
        """-d v."""
        if self.damping is None:
            for k, d in enumerate(motion.model.damping.tolist()):
                loads.torque(k, times(-d, motion.v[k]))
            return
        for joint, d in self.damping.items():
            for k in motion.dofs(joint):
                loads.torque(k, times(-float(d), motion.v[k]))
