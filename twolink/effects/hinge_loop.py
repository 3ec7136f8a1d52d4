"""A hinge between two links that closes a loop."""

from twolink.algorithms.spatial import Scalar, dot
from twolink.dynamics import Robot
from twolink.effects.conditions import across, unit
from twolink.effects.effect import LinkName
from twolink.effects.frame_checks import apart, check_frame
from twolink.effects.loop import Loop
from twolink.effects.motion import GROUND, Motion


class HingeLoop(Loop, frozen=True):
    """A hinge: a common point, x_a = x_b, and a common axis; b's axis has no part across a's.

    Parameters
    ----------
    a, b : str
        Links; b may be the "universe", the ground.
    axis_a, axis_b : (float, float, float)
        The hinge's direction in the links' axes, of any length.
    point_a, point_b : (float, float, float)
        In the links' axes, m.
    """

    a: LinkName
    axis_a: tuple[float, float, float]
    axis_b: tuple[float, float, float]
    b: LinkName = GROUND
    point_a: tuple[float, float, float] = (0.0, 0.0, 0.0)
    point_b: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def check(self, robot: Robot) -> None:
        """Require links, and axes that have a direction."""
        check_frame(self.a, robot, "a", ground=True)
        check_frame(self.b, robot, "b", ground=True)
        unit(self.axis_a, "axis_a")
        unit(self.axis_b, "axis_b")

    def carrier(self, motion: Motion) -> int:
        """The nearest body that carries a and b."""
        return motion.carrier(self.a, self.b)

    def rows(self, motion: Motion) -> list[Scalar]:
        """x_a - x_b, and the parts of b's axis along two directions across a's."""
        motion = motion.seen_from(self.carrier(motion))
        axis = motion.direction(self.b, unit(self.axis_b, "axis_b"))
        ways = [motion.direction(self.a, way) for way in across(unit(self.axis_a, "axis_a"))]
        return [*apart(motion, self.a, self.point_a, self.b, self.point_b), *(dot(way, axis) for way in ways)]
