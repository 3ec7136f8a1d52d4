"""Gaps between features of two hulls: a corner over a face, and two edges that cross."""

from __future__ import annotations

import math
from typing import Any

import msgspec

from twolink.algorithms.motion import Motion
from twolink.algorithms.spatial import Scalar, Vec, constant, cross, dot, scale
from twolink.effects.gaps import Gap, Nearest, Place, PlaneGap, sub, tangents


class FaceGap(PlaneGap, frozen=True):
    """From a corner of one body to the plane of a face of the other.

    sides: of the face, the inward normal of each in the axes of the face's link, and its height along it. second: the
    corner is the second body's.
    """

    sides: tuple[tuple[Vec, float], ...]
    second: bool

    def nearest(self, motion: Motion) -> Nearest:
        """The corner, and its foot on the face."""
        near = super().nearest(motion)
        if not self.second:
            return near
        n, s, t = near.axes
        return Nearest(near.gap, (scale(-1.0, n), t, s), near.second, near.first)

    def single(self, motion: Motion) -> Scalar:
        """How far the corner's foot is from the nearest side of the face, m; below 0 beside it."""
        apart, xp = sub(self.ball.centre(motion), motion.position(self.frame)), motion.xp
        depths = [dot(motion.direction(self.frame, inward), apart) - height for inward, height in self.sides]
        least = depths[0]
        for depth in depths[1:]:
            least = xp.where(xp.less(depth, least), depth, least)
        return least


class Edge(msgspec.Struct, frozen=True):
    """An edge of a link: its middle, and from there to an end, in the link's axes, m."""

    frame: str
    middle: Vec
    half: Vec


class EdgeGap(Gap, frozen=True):
    """From an edge of one body to an edge of the other that crosses it.

        n = side (u x w) / |u x w|,   g = n . (a - b),   a + s u - b - t w = g n

    first, second: the edges with the middles a, b and the halves u, w. side: +1 or -1, so that n points from the second
    body to the first.
    """

    first: Edge
    second: Edge
    side: float

    def nearest(self, motion: Motion) -> Nearest:
        """The nearest points of the lines along the edges."""
        u, w, apart = self._lines(motion)
        s, t = self._along(u, w, apart)
        across = cross(u, w)
        square = dot(across, across)  # a number where neither body turns
        n = scale(self.side / (math.sqrt(square) if constant(square) else motion.xp.sqrt(square)), across)
        ends = (Place(edge.frame, edge.middle, scale(share, line))
                for edge, share, line in ((self.first, s, u), (self.second, t, w)))  # fmt: skip
        return Nearest(dot(n, apart), (n, *tangents(n, motion.xp)), *ends)

    def single(self, motion: Motion) -> Scalar:
        """How far the nearest points are from the ends of the edges, m; below 0 beyond them."""
        xp = motion.xp
        shares = zip((self.first, self.second), self._along(*self._lines(motion)), strict=True)
        s, t = (math.hypot(*edge.half) * (1.0 - xp.where(xp.less(share, 0.0), -share, share)) for edge, share in shares)
        return xp.where(xp.less(s, t), s, t)

    def _lines(self, motion: Motion) -> tuple[Vec, Vec, Vec]:
        """u, w and a - b in the world."""
        (a, u), (b, w) = ((motion.position(edge.frame, edge.middle), motion.direction(edge.frame, edge.half))
                          for edge in (self.first, self.second))  # fmt: skip
        return u, w, sub(a, b)

    def _along(self, u: Vec, w: Vec, apart: Vec) -> tuple[Scalar, Scalar]:
        """s and t of the nearest points of the lines."""
        a, b, c, d, e = dot(u, u), dot(u, w), dot(w, w), dot(u, apart), dot(w, apart)
        size: Any = a * c - b * b
        return (b * e - c * d) / size, (a * e - b * d) / size
