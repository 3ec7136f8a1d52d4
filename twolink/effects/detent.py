"""A spring-loaded ball that holds a joint in notches."""

from twolink.dynamics import Robot
from twolink.effects.conditions import JointReaches
from twolink.effects.effect import JointName, NotNegative
from twolink.effects.joint_checks import check_joint
from twolink.effects.switching import Catch, Hold, SwitchingEffect, Trigger
from twolink.errors import SceneError
from twolink.robots.joint_layout import turns


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

    joint: JointName
    torque: NotNegative
    positions: tuple[float, ...] = (0.0,)
    speed: NotNegative = 0.0

    def check(self, robot: Robot) -> None:
        """Require a joint with one coordinate, and a notch."""
        check_joint(self.joint, robot, "joint", coordinate=True)
        if not self.positions:
            raise SceneError("there is no notch", where="positions", remedy="such as (0.0,)")

    def modes(self, robot: Robot) -> list[Hold | Trigger]:
        """The ball in each notch, and the ball that falls into it."""
        joint = next(j for j in robot.joints if j.name == self.joint)
        entry, dof, torque, speed = joint.q.start, joint.v.start, float(self.torque), float(self.speed)
        unit = "rad/s" if turns(robot.model, joint) else "m/s"
        modes: list[Hold | Trigger] = []
        for p in map(float, self.positions):
            modes.append(Hold(dof, -torque, torque, 0.0, entry, p, ("catch", "breakaway")))
            if speed:
                catch = Catch(dof, entry, p, speed, unit)
                modes.append(Trigger("catch", self.joint, condition=JointReaches(self.joint, p), catch=catch))
        return modes
