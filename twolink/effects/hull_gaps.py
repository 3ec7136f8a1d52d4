"""Gaps between a ball and a convex hull: to the nearest point of its faces and edges."""

from __future__ import annotations

from typing import Any

from twolink.algorithms.motion import Motion
from twolink.algorithms.spatial import ZERO, Scalar, Vec, add, cross, dot, scale, unit
from twolink.effects.gaps import Ball, Core, Gap, Nearest, between_balls, limited, sub

AXES: tuple[Vec, Vec, Vec] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
NEVER = 1e30  # m^2: the square of the distance from what is not below the ball


class HullGap(Gap, frozen=True):
    """From a ball of body a to a convex hull of body b.

    frame: the hull's link. edges: their ends in the link's axes. faces: of each its corners in order around its
    outward normal. Source: Ericson, Real-Time Collision Detection, 2005, sections 5.1.2 and 5.1.5.
    """

    ball: Ball
    frame: str
    edges: tuple[tuple[Vec, Vec], ...]
    faces: tuple[tuple[Vec, ...], ...]

    def nearest(self, motion: Motion) -> Nearest:
        """The nearest of the nearest points of edges, and of the feet on the faces that are below the ball."""
        xp = motion.xp
        x, origin = self.ball.centre(motion), motion.position(self.frame)
        ex, ey, ez = (motion.direction(self.frame, axis) for axis in AXES)
        apart = sub(x, origin)
        own = dot(ex, apart), dot(ey, apart), dot(ez, apart)
        square, place = _on_edge(own, *self.edges[0], xp)
        for found in (*(_on_edge(own, *edge, xp) for edge in self.edges[1:]),
                      *(_on_face(own, face, xp) for face in self.faces)):  # fmt: skip
            closer = xp.less(found[0], square)
            square = xp.where(closer, found[0], square)
            a, b, c = (xp.where(closer, new, old) for new, old in zip(found[1], place, strict=True))
            place = a, b, c
        offset = add(add(scale(place[0], ex), scale(place[1], ey)), scale(place[2], ez))
        hull: Core = Ball(self.frame, ZERO, 0.0), origin, offset
        return between_balls(motion, (self.ball, x, ZERO), hull)


def _on_edge(x: Vec, a: Vec, b: Vec, xp: Any) -> tuple[Scalar, Vec]:
    """The square of the distance from an edge, and its nearest point."""
    half, middle = scale(0.5, sub(b, a)), scale(0.5, add(a, b))
    apart = sub(x, middle)
    along = scale(limited(dot(half, apart) / dot(half, half), 1.0, xp), half)
    off = sub(apart, along)
    return dot(off, off), add(middle, along)


def _on_face(x: Vec, corners: tuple[Vec, ...], xp: Any) -> tuple[Scalar, Vec]:
    """The square of the distance from a face, and the foot on it; NEVER where that is beside the face or behind it."""
    normal = unit(cross(sub(corners[1], corners[0]), sub(corners[2], corners[1])), "vertices")
    height = dot(normal, sub(x, corners[0]))
    inside = height
    for a, b in zip(corners, (*corners[1:], corners[0]), strict=True):
        beside = dot(unit(cross(normal, sub(b, a)), "vertices"), sub(x, a))
        inside = xp.where(xp.less(beside, inside), beside, inside)
    return xp.where(xp.less(inside, 0.0), NEVER, height * height), sub(x, scale(height, normal))
