"""Dry friction in joints: static friction holds them, kinetic friction brakes them."""

from collections.abc import Mapping
from typing import Literal

from twolink.dynamics import Robot
from twolink.effects.effect import NotNegative, check_name
from twolink.effects.joint_checks import check_joints, check_values_or_urdf
from twolink.effects.switching import Hold, SwitchingEffect
from twolink.errors import SceneError


class DryFriction(SwitchingEffect, frozen=True):
    """Dry friction that holds joints at rest (Coulomb 1785).

        tau_k = -c_k sign(v_k)   while joint k slips
        |tau_k| <= s_k           at rest; a joint that comes to rest sticks until more is needed to hold it

    Parameters
    ----------
    kinetic : mapping of joint to float, or "urdf"
        c, N m or N, not negative. Joints with one degree of freedom. "urdf": all joints to which the URDF gives one
        (<dynamics friction>), which forward dynamics alone does not apply.
    static : mapping of joint to float
        s, N m or N, not below c; c by default.
    """

    kinetic: Mapping[str, NotNegative] | Literal["urdf"] = "urdf"
    static: Mapping[str, NotNegative] = {}

    def check(self, robot: Robot) -> None:
        """Require joints with one degree of freedom, or friction in the URDF, and s that is not below c."""
        if self.kinetic == "urdf":
            check_values_or_urdf(None, robot.model.friction, robot, "kinetic", "friction")
        else:
            check_joints(self.kinetic, robot, "kinetic", dofs=True)
        kinetic = self._kinetic(robot)
        for joint, level in self.static.items():
            check_name(joint, kinetic, "static", "joint with kinetic friction")
            if level < kinetic[joint]:
                raise SceneError(f"it is {level:g}, below the kinetic friction {kinetic[joint]:g}",
                                 where=f"static.{joint}", remedy="static friction is the larger one")  # fmt: skip

    def modes(self, robot: Robot) -> list[Hold]:
        """Static friction holds a joint, kinetic friction brakes it."""
        dofs = {joint.name: joint.v.start for joint in robot.joints}
        kinetic = self._kinetic(robot)
        static = {name: float(self.static.get(name, c)) for name, c in kinetic.items()}
        return [Hold(dofs[name], -static[name], static[name], c) for name, c in kinetic.items()]

    def _kinetic(self, robot: Robot) -> dict[str, float]:
        """The kinetic friction of each joint that has one."""
        if self.kinetic == "urdf":
            friction = robot.model.friction
            return {joint.name: float(friction[joint.v.start]) for joint in robot.joints if friction[joint.v].any()}
        return {name: float(c) for name, c in self.kinetic.items()}
