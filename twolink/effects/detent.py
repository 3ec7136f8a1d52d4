"""A spring-loaded ball that holds a joint in notches."""

from __future__ import annotations

from collections.abc import Sequence

from twolink.dynamics import Robot
from twolink.effects.conditions import JointReaches
from twolink.effects.effect import NotNegative
from twolink.effects.joint_checks import check_joint
from twolink.effects.switching import Catch, Hold, SwitchingEffect, Trigger
from twolink.errors import SceneError


class Detent(SwitchingEffect, frozen=True):
    """A joint that a spring-loaded ball holds at a notch, until that takes more than a torque.

        |tau| <= T   while q = p and v = 0;   else tau = 0
        v+ = 0       where q passes p with |v| <= s: the ball falls into the notch

    Past the breakaway torque T the joint is free, until it passes a notch slowly. Then the ball stops it by an impulse,
    and the kinetic energy that this takes is lost. A faster joint passes without loss.

    Parameters
    ----------
    joint : str
        A joint with one coordinate.
    torque : float
        Breakaway torque T, N m or N.
    positions : tuple of float
        Notches p, rad or m.
    speed : float
        Largest speed s at which the ball falls into a notch, rad/s or m/s. 0: it never does.

    Notes
    -----
    An ideal detent: the width of the notch and the spring's force on its flanks are left out.
    """

    joint: str
    torque: NotNegative
    positions: tuple[float, ...] = (0.0,)
    speed: NotNegative = 0.0

    def check(self, robot: Robot) -> None:
        """Require a joint with one coordinate, and a notch."""
        check_joint(self.joint, robot, "joint", coordinate=True)
        if not self.positions:
            raise SceneError("there is no notch", where="positions", remedy="such as (0.0,)")

    def holds(self, robot: Robot) -> Sequence[Hold]:
        """The ball in each notch."""
        entry, dof = self._place(robot)
        torque, kinds = float(self.torque), ("catch", "breakaway")
        return [Hold(dof, -torque, torque, 0.0, entry, float(p), kinds) for p in self.positions]

    def triggers(self, robot: Robot) -> Sequence[Trigger]:
        """The ball that falls into a notch."""
        entry, dof = self._place(robot)
        turns = robot.model.joints[robot.model.getJointId(self.joint)].shortname().startswith("JointModelR")
        unit = "rad/s" if turns else "m/s"
        return [Trigger("catch", self.joint, condition=JointReaches(self.joint, float(p)),
                        catch=Catch(dof, entry, float(p), float(self.speed), unit))
                for p in (self.positions if self.speed else ())]  # fmt: skip

    def _place(self, robot: Robot) -> tuple[int, int]:
        """The joint's entries of q and v."""
        joint = next(j for j in robot.joints if j.name == self.joint)
        return joint.q.start, joint.v.start
