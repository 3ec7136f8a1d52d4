"""Gaps between two boxes: their corners against each other's sides, and what tells that their edges meet.

    p = R_b^T (x - x_b),   d_i = |p_i| - h_i,   g = max_i d_i          a corner x of a, a box of b

g is 0 on the surface of the box, below 0 inside, and above a side the distance from it. Two edges that meet have no
corner inside: then the separation of the boxes along the best of 15 directions falls below 0 (Gottschalk, Lin,
Manocha: OBBTree, 1996).
"""

from __future__ import annotations

import itertools
from typing import Any

import msgspec
import numpy as np

from twolink.algorithms.spatial import ZERO, Scalar, Vec, dot, minus, scale
from twolink.effects.gaps import Ball, Gap, Nearest, Place, sub
from twolink.effects.motion import Motion

PARALLEL = 1e-12  # the square of the sine between two edges below it: their cross product is no direction


class BoxShape(msgspec.Struct, frozen=True):
    """A box of a link: its centre and own axes in the link's axes, and half its edges, m."""

    frame: str
    point: Vec
    axes: tuple[Vec, Vec, Vec]
    half: Vec


class CornerGap(Gap, frozen=True):
    """From a corner of one body to the nearest side of a box of the other. second: the corner is the second's."""

    corner: Ball
    box: BoxShape
    second: bool

    def nearest(self, motion: Motion) -> Nearest:
        """The corner, and its foot on the side."""
        xp, axes = motion.xp, self._axes(motion)
        apart, (dx, dy, dz) = self._depths(motion, axes)
        along_x = xp.where(xp.less(dx, dy), 0.0, xp.where(xp.less(dx, dz), 0.0, 1.0))
        along_y = xp.where(xp.less(dy, dz), 0.0, 1.0 - along_x)
        chosen = along_x, along_y, 1.0 - along_x - along_y
        gap = sum(share * d for share, d in zip(chosen, (dx, dy, dz), strict=True))
        signs = [xp.where(xp.less(dot(axis, apart), 0.0), -1.0, 1.0) for axis in axes]
        n = _mixed([share * sign for share, sign in zip(chosen, signs, strict=True)], axes)
        s, t = _mixed(chosen, [axes[1], axes[2], axes[0]]), _mixed(chosen, [axes[2], axes[0], axes[1]])
        foot = sub(sub(self.corner.centre(motion), scale(gap, n)), motion.position(self.box.frame))
        ends = Place(self.corner.frame, self.corner.point, ZERO), Place(self.box.frame, ZERO, foot)
        if self.second:
            return Nearest(gap, (scale(-1.0, n), s, t), ends[1], ends[0])
        return Nearest(gap, (n, s, t), *ends)

    def single(self, motion: Motion) -> Scalar:
        """How far its foot is from the edges of the side."""
        xp = motion.xp
        _, (dx, dy, dz) = self._depths(motion, self._axes(motion))
        low, high = _ordered(dx, dy, xp)
        return -_ordered(low, _ordered(high, dz, xp)[0], xp)[1]

    def _axes(self, motion: Motion) -> list[Vec]:
        return [motion.direction(self.box.frame, axis) for axis in self.box.axes]

    def _depths(self, motion: Motion, axes: list[Vec]) -> tuple[Vec, list[Scalar]]:
        """x - x_b, and d along the box's axes."""
        apart = sub(self.corner.centre(motion), motion.position(self.box.frame, self.box.point))
        along = [dot(axis, apart) for axis in axes]
        xp = motion.xp
        return apart, [minus(xp.where(xp.less(p, 0.0), -p, p), h) for p, h in zip(along, self.box.half, strict=True)]


def separation(first: BoxShape, second: BoxShape, motion: Motion) -> Any:
    """How far two boxes are apart along the direction that shows it best, m; below 0 where they overlap. By NumPy."""
    boxes = [(np.array([_stacked(motion.direction(box.frame, axis)) for axis in box.axes]), np.array(box.half))
             for box in (first, second)]  # fmt: skip
    line = _stacked(sub(motion.position(first.frame, first.point), motion.position(second.frame, second.point)))
    (a, _), (b, _) = boxes
    best = np.full(line.shape[1], -np.inf)
    for way in (*a, *b, *(np.cross(u, w, axis=0) for u, w in itertools.product(a, b))):
        square = (way * way).sum(axis=0)
        extent = sum(h * np.abs((axis * way).sum(axis=0)) for axes, half in boxes
                     for axis, h in zip(axes, half, strict=True))  # fmt: skip
        apart = (np.abs((line * way).sum(axis=0)) - extent) / np.sqrt(np.maximum(square, PARALLEL))
        best = np.maximum(best, np.where(square > PARALLEL, apart, -np.inf))
    return best


def _stacked(vector: Vec) -> np.ndarray:
    """A vector (3, n) of numbers or arrays (n,)."""
    return np.array(np.broadcast_arrays(*vector), dtype=float).reshape(3, -1)


def _ordered(x: Scalar, y: Scalar, xp: Any) -> tuple[Scalar, Scalar]:
    """The smaller and the larger."""
    less = xp.less(x, y)
    return xp.where(less, x, y), xp.where(less, y, x)


def _mixed(shares: Any, vectors: Any) -> Vec:
    """The sum of three vectors by their shares."""
    x, y, z = (sum(share * vector[i] for share, vector in zip(shares, vectors, strict=True)) for i in range(3))
    return x, y, z
