"""A point of one link held at a point of another, as by a ball joint."""

from twolink.algorithms.spatial import Scalar
from twolink.dynamics import Robot
from twolink.effects.effect import LinkName
from twolink.effects.frame_checks import apart, check_frame
from twolink.effects.loop import Loop
from twolink.effects.motion import GROUND, Motion


class PointLoop(Loop, frozen=True):
    """A point of link a stays at a point of link b: g = x_a - x_b.

    Parameters
    ----------
    a, b : str
        Links; b may be the "universe", the ground.
    point_a, point_b : (float, float, float)
        In the links' axes, m.
    """

    a: LinkName
    b: LinkName = GROUND
    point_a: tuple[float, float, float] = (0.0, 0.0, 0.0)
    point_b: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def check(self, robot: Robot) -> None:
        """Require links."""
        check_frame(self.a, robot, "a", ground=True)
        check_frame(self.b, robot, "b", ground=True)

    def carrier(self, motion: Motion) -> int:
        """The nearest body that carries a and b."""
        return motion.carrier(self.a, self.b)

    def rows(self, motion: Motion) -> list[Scalar]:
        """x_a - x_b along the carrier's axes."""
        return apart(motion.seen_from(self.carrier(motion)), self.a, self.point_a, self.b, self.point_b)
