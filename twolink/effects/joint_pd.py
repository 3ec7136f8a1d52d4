"""Proportional-derivative control of joints."""

from __future__ import annotations

from collections.abc import Mapping

from twolink.algorithms.spatial import minus, plus, times
from twolink.dynamics import Robot
from twolink.effects.effect import Effect, one_of
from twolink.effects.inputs import Input, check_input, value_at
from twolink.effects.joint_checks import Limits, check_joints, check_limits, check_values, clamped
from twolink.effects.motion import Loads, Motion


class JointPD(Effect, frozen=True):
    """tau = kp (target - q) - kd v + feedforward in each joint named, within its limit.

    target: by joint, rad or m: a number or a function of time. kp: N m/rad or N/m, by joint. kd: N m s/rad or N s/m,
    by joint; 0 unless given. feedforward: N m or N, by joint, as target. effort: limits L by joint, -L <= tau <= L, or
    "urdf" for the URDF's of every joint named; none unless given. The controller is continuous in time: no sampling.
    """

    target: Mapping[str, Input]
    kp: Mapping[str, float]
    kd: Mapping[str, float] = {}
    feedforward: Mapping[str, Input] = {}
    effort: Limits = None

    @property
    def analytic(self) -> bool:
        """Not where a limit of effort acts."""
        return self.effort is None

    def check(self, robot: Robot) -> None:
        """Names are joints with one coordinate, all with a target; gains are not negative."""
        check_joints(self.target, robot, "target", coordinates=True)
        for joint in self.target:
            one_of(joint, self.kp, "kp", "gain for joint")
        for name in ("kp", "kd", "feedforward"):
            for joint in getattr(self, name):
                one_of(joint, self.target, name, "joint with a target")
        check_values(self.kp, "kp", least=0.0)
        check_values(self.kd, "kd", least=0.0)
        for name in ("target", "feedforward"):
            for joint, given in getattr(self, name).items():
                check_input(given, f"{name}.{joint}")
        check_limits(self.effort, self.target, robot)

    def act(self, motion: Motion, loads: Loads) -> None:
        """kp (target - q) - kd v + feedforward."""
        for joint, target in self.target.items():
            entry, dof = motion.coordinate(joint)
            error = minus(value_at(target, motion.t, motion.xp), motion.q[entry])
            torque = plus(
                times(float(self.kp[joint]), error),
                times(-float(self.kd.get(joint, 0.0)), motion.v[dof]),
                value_at(self.feedforward.get(joint, 0.0), motion.t, motion.xp),
            )
            loads.torque(dof, clamped(torque, joint, self.effort, motion, loads))
