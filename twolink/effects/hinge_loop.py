"""A hinge between two links that closes a loop."""

from __future__ import annotations

import numpy as np

from twolink.dynamics import Robot
from twolink.dynamics.spatial import Scalar, Vec, dot, minus
from twolink.effects.effect import finite
from twolink.effects.loop import Loop, require_frame
from twolink.effects.motion import GROUND, Motion
from twolink.errors import SceneError


class HingeLoop(Loop, frozen=True):
    """A common point and a common axis: x_a = x_b, and the axis of b has no part across that of a.

    a, b: names of links; b may be the "universe", the ground.
    point_a, point_b: m; axis_a, axis_b: directions, in the links' axes.
    """

    a: str
    axis_a: tuple[float, float, float]
    axis_b: tuple[float, float, float]
    b: str = GROUND
    point_a: tuple[float, float, float] = (0.0, 0.0, 0.0)
    point_b: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def check(self, robot: Robot) -> None:
        """Links exist; points are numbers; axes have a direction."""
        require_frame(robot, self.a, "a")
        require_frame(robot, self.b, "b")
        for field in ("point_a", "point_b", "axis_a", "axis_b"):
            finite(getattr(self, field), field)
        for field in ("axis_a", "axis_b"):
            if not any(getattr(self, field)):
                raise SceneError("expected a direction, got (0, 0, 0)", where=field, remedy="such as (0, 1, 0)")

    def rows(self, motion: Motion) -> list[Scalar]:
        """x_a - x_b, and the parts of b's axis along two directions across a's."""
        ends = motion.position(self.a, self.point_a), motion.position(self.b, self.point_b)
        axis = motion.direction(self.b, _unit(self.axis_b))
        across = [motion.direction(self.a, way) for way in _across(self.axis_a)]
        return [*(minus(x, y) for x, y in zip(*ends, strict=True)), *(dot(way, axis) for way in across)]


def _unit(axis: tuple[float, ...]) -> Vec:
    x, y, z = (np.asarray(axis, float) / np.linalg.norm(axis) + 0.0).tolist()
    return x, y, z


def _across(axis: tuple[float, ...]) -> list[Vec]:
    """Two unit vectors across an axis and each other."""
    u = np.array(_unit(axis))
    first = np.cross(u, np.eye(3)[int(np.argmin(np.abs(u)))])
    first /= np.linalg.norm(first)
    return [_unit(tuple(first)), _unit(tuple(np.cross(u, first)))]
