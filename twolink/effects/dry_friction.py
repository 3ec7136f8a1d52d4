"""Dry friction in joints: static friction holds them, kinetic friction brakes them."""

from collections.abc import Mapping

from twolink.dynamics import Robot
from twolink.effects.effect import NotNegative, check_name
from twolink.effects.joint_checks import check_joints
from twolink.effects.switching import Hold, SwitchingEffect
from twolink.errors import SceneError


class DryFriction(SwitchingEffect, frozen=True):
    """Dry friction that holds joints at rest (Coulomb 1785).

        tau_k = -c_k sign(v_k)   while joint k slips
        |tau_k| <= s_k           at rest; a joint that comes to rest sticks until more is needed to hold it

    Parameters
    ----------
    kinetic : mapping of joint to float
        c, N m or N, not negative. Joints with one degree of freedom.
    static : mapping of joint to float
        s, N m or N, not below c; c by default.
    """

    kinetic: Mapping[str, NotNegative]
    static: Mapping[str, NotNegative] = {}

    def check(self, robot: Robot) -> None:
        """Require joints with one degree of freedom, and s that is not below c."""
        check_joints(self.kinetic, robot, "kinetic", dofs=True)
        for joint, level in self.static.items():
            check_name(joint, self.kinetic, "static", "joint with kinetic friction")
            if level < self.kinetic[joint]:
                raise SceneError(f"it is {level:g}, below the kinetic friction {self.kinetic[joint]:g}",
                                 where=f"static.{joint}", remedy="static friction is the larger one")  # fmt: skip

    def modes(self, robot: Robot) -> list[Hold]:
        """Static friction holds a joint, kinetic friction brakes it."""
        dofs = {joint.name: joint.v.start for joint in robot.joints}
        static = {name: float(self.static.get(name, c)) for name, c in self.kinetic.items()}
        return [Hold(dofs[name], -static[name], static[name], float(c)) for name, c in self.kinetic.items()]
