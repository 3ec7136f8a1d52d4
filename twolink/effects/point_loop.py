"""A point of one link held at a point of another, as by a ball joint."""

from __future__ import annotations

from twolink.dynamics import Robot
from twolink.dynamics.spatial import Scalar, minus
from twolink.effects.effect import finite
from twolink.effects.loop import Loop, require_frame
from twolink.effects.motion import GROUND, Motion


class PointLoop(Loop, frozen=True):
    """g = x_a - x_b: a point of link a stays at a point of link b.

    a, b: names of links; b may be the "universe", the ground. point_a, point_b: m, in the links' axes.
    """

    a: str
    b: str = GROUND
    point_a: tuple[float, float, float] = (0.0, 0.0, 0.0)
    point_b: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def check(self, robot: Robot) -> None:
        """Links exist, points are numbers."""
        require_frame(robot, self.a, "a")
        require_frame(robot, self.b, "b")
        finite(self.point_a, "point_a")
        finite(self.point_b, "point_b")

    def rows(self, motion: Motion) -> list[Scalar]:
        """x_a - x_b along the world's axes."""
        ends = motion.position(self.a, self.point_a), motion.position(self.b, self.point_b)
        return [minus(x, y) for x, y in zip(*ends, strict=True)]
