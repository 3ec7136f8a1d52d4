"""Torques that carry the robot's weight."""

from __future__ import annotations

from twolink.algorithms.recursions import newton_euler
from twolink.dynamics import Robot
from twolink.effects.effect import Effect
from twolink.effects.joint_checks import Limits, check_joint, check_limits, clamped, single_joints
from twolink.effects.motion import Loads, Motion
from twolink.errors import SceneError


class GravityCompensation(Effect, frozen=True):
    """tau = g(q) in each joint named: what inverse dynamics at rest asks for, by recursive Newton-Euler.

    The model is the scene's own, payloads included. Without gravity in the scene it is nothing.

    joints: all with one degree of freedom unless given: a free root has no motor. effort: limits by joint, or "urdf".
    """

    joints: tuple[str, ...] | None = None
    effort: Limits = None

    @property
    def analytic(self) -> bool:
        """Not where a limit of effort acts."""
        return self.effort is None

    def check(self, robot: Robot) -> None:
        """Names are joints of one degree of freedom, each once."""
        joints = single_joints(robot) if self.joints is None else self.joints
        if isinstance(joints, str) or not joints or len(set(joints)) != len(joints):
            raise SceneError(f"expected joints, each once, got {self.joints!r}", where="joints",
                             remedy="leave it out for all joints")  # fmt: skip
        for joint in joints:
            check_joint(joint, robot, "joints")
        check_limits(self.effort, joints, robot)

    def act(self, motion: Motion, loads: Loads) -> None:
        """g(q)."""
        still = [0.0] * motion.mech.nv
        torques = newton_euler(motion.mech, motion.own(), still, still, None)
        model = motion.model
        joints = self.joints
        if joints is None:
            joints = tuple(model.names[i] for i in range(1, model.njoints) if model.nvs[i] == 1)
        for joint in joints:
            k = motion.dofs(joint)[0]
            if type(torques[k]) is not float or torques[k] != 0.0:
                loads.torque(k, clamped(torques[k], joint, self.effort, motion, loads))
