"""Torques that carry the robot's weight."""

from twolink.algorithms.recursions import newton_euler
from twolink.dynamics import Robot
from twolink.effects.effect import Effect
from twolink.effects.joint_checks import Limits, check_joint, check_limits, clamped, single_joints
from twolink.effects.motion import Loads, Motion
from twolink.errors import SceneError


class GravityCompensation(Effect, frozen=True):
    """Compensation of gravity: tau = g(q) = h(q, 0), from recursive Newton-Euler at rest.

    Parameters
    ----------
    joints : sequence of str or None
        The joints that are driven, each with one degree of freedom; None: all of these.
    effort : mapping of joint to float, "urdf" or None
        Limits of the torques, N m or N: by joint, the URDF's, or none.

    Notes
    -----
    g is that of the scene's robot, payloads included. Without gravity in the scene there are no torques.

    References
    ----------
    Siciliano et al., Robotics, 2009, section 8.5.1.
    """

    joints: tuple[str, ...] | None = None
    effort: Limits = None

    @property
    def analytic(self) -> bool:
        """Whether there are no limits: a torque is not smooth where it reaches its limit."""
        return self.effort is None

    def check(self, robot: Robot) -> None:
        """Require joints of one degree of freedom, each named once."""
        joints = single_joints(robot) if self.joints is None else self.joints
        if not isinstance(joints, (list, tuple)) or not joints or any(joints.count(joint) > 1 for joint in joints):
            what, remedy = f"expected joints, each once, got {self.joints!r}", "leave it out for all joints"
            raise SceneError(what, where="joints", remedy=remedy)
        for joint in joints:
            check_joint(joint, robot, "joints")
        check_limits(self.effort, joints, robot)

    def act(self, motion: Motion, loads: Loads) -> None:
        """Add g(q)."""
        zeros = [0.0] * motion.mech.nv
        torques = newton_euler(motion.mech, motion.own(), zeros, zeros, None)
        model, joints = motion.model, self.joints
        if joints is None:
            joints = tuple(model.names[i] for i in range(1, model.njoints) if model.nvs[i] == 1)
        for joint in joints:
            k = motion.dofs(joint)[0]
            if type(torques[k]) is not float or torques[k] != 0.0:
                loads.torque(k, clamped(torques[k], joint, self.effort, motion, loads))
