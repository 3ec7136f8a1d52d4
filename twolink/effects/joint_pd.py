"""Proportional-derivative control of joints."""

from collections.abc import Mapping

from twolink.algorithms.spatial import minus, plus, times
from twolink.dynamics import Robot
from twolink.effects.effect import Effect, NotNegative, check_name, number
from twolink.effects.inputs import Input, value_at
from twolink.effects.joint_checks import Limits, check_joints, check_limits, check_subset, clamped
from twolink.effects.motion import Loads, Motion


class JointPD(Effect, frozen=True):
    """Proportional-derivative control: tau = kp (target - q) - kd v + feedforward, within limits.

    Parameters
    ----------
    target : mapping of joint to input
        rad or m: numbers or functions of time. Joints with one coordinate.
    kp : mapping of joint to float
        N m/rad or N/m, not negative; for every joint with a target.
    kd : mapping of joint to float
        N m s/rad or N s/m, not negative; 0 by default.
    feedforward : mapping of joint to input
        N m or N: numbers or functions of time; 0 by default.
    effort : mapping of joint to float, "urdf" or None
        Limits L of the torques, -L <= tau <= L, N m or N: by joint, the URDF's, or none.

    Notes
    -----
    The controller is continuous in time: it does not sample.

    References
    ----------
    Siciliano et al., Robotics, 2009, section 8.5.1.
    """

    target: Mapping[str, Input]
    kp: Mapping[str, NotNegative]
    kd: Mapping[str, NotNegative] = {}
    feedforward: Mapping[str, Input] = {}
    effort: Limits = None

    @property
    def analytic(self) -> bool:
        """Whether there are no limits: a torque is not smooth where it reaches its limit."""
        return self.effort is None

    def check(self, robot: Robot) -> None:
        """Require joints with one coordinate, all with a target and kp."""
        check_joints(self.target, robot, "target", coordinates=True)
        for name in ("kp", "kd", "feedforward"):
            check_subset(getattr(self, name), self.target, name, "joint with a target")
        for joint in self.target:
            check_name(joint, self.kp, "kp", "gain for joint")
        check_limits(self.effort, self.target, robot)

    def act(self, motion: Motion, loads: Loads) -> None:
        """Add kp (target - q) - kd v + feedforward."""
        for joint, target in self.target.items():
            entry, dof = motion.coordinate(joint)
            error = minus(value_at(target, motion.t, motion.xp), motion.q[entry])
            torque = plus(
                times(number(self.kp[joint]), error),
                times(-number(self.kd.get(joint, 0.0)), motion.v[dof]),
                value_at(self.feedforward.get(joint, 0.0), motion.t, motion.xp),
            )
            loads.torque(dof, clamped(torque, joint, self.effort, motion, loads))
