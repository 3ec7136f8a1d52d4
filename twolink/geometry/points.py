"""Points at which bodies touch or are about to, and formulas of gaps for many of them at once.

    g = n . (x_a - x_b)

x_a, x_b: the nearest points of the two bodies; n: the unit normal there, from b to a. The formulas are those of `gaps`,
with the numbers of all pairs of a kind as one array each.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import msgspec
import numpy as np

from twolink.algorithms.motion import GROUND
from twolink.algorithms.namespaces import Array, Numbers
from twolink.algorithms.spatial import ZERO
from twolink.geometry.gaps import Gap, Nearest, down_rim

CLOSED = 1e-10  # m: what counts as no gap
FEATURES = 38  # bits of a key below its pair
FLAT = 1e-9  # of a rim: below it the disc lies flat on the plane
TOUCHING = 1e-6  # m: points of two bodies that are so near move as one


class Places(NamedTuple):
    """Poses of a robot's joints: rotations R (joints, 3, 3) and origins (joints, 3), the ground first."""

    rotations: Array
    origins: Array


class Links:
    """Poses of links, read as from a `KinematicState`: frames are numbers (n,) of many links, vectors are (3, n)."""

    xp = Numbers

    def __init__(self, joint: Array, rotations: Array, origins: Array) -> None:
        self.joint, self.rotations, self.origins = joint, rotations, origins

    def at(self, places: Places) -> Links:
        """The links in the world, from these in their joints' axes and the places of the joints."""
        turned = places.rotations[self.joint]
        origins = np.einsum("nij,nj->ni", turned, self.origins) + places.origins[self.joint]
        return Links(self.joint, turned @ self.rotations, origins)

    def position(self, frames: Any, point: Any = ZERO) -> Any:
        """Positions of points of the frames in the world, m."""
        if isinstance(frames, str):  # the ground
            return point
        x = self.origins[frames].T
        return x if point is ZERO else x + self.direction(frames, point)

    def direction(self, frames: Any, axis: Any) -> Any:
        """Directions that are fixed in the frames, along the world's axes."""
        return axis if isinstance(frames, str) else np.einsum("nij,jn->in", self.rotations[frames], axis)


@dataclass(frozen=True)
class Points:
    """Points (n,) at which bodies touch or are about to.

    pair: the number of the pair. key: a number of each point that stays the same from step to step. first, second: the
    joints that carry the bodies. gap: m. normal (n, 3): from the second body to the first. position (n, 3): the middle
    of the nearest points.
    """

    pair: Array
    key: Array
    first: Array
    second: Array
    gap: Array
    normal: Array
    position: Array

    @property
    def ends(self) -> tuple[tuple[Array, Array, float], ...]:
        """The nearest points (n, 3) of the two bodies, the joints that carry them, and their signs in the gap.

        They are one where the bodies touch: with gaps of a face's corners that differ by 1e-9 m the slips of all could
        not be 0.
        """
        half = 0.5 * np.where(np.abs(self.gap) < TOUCHING, 0.0, self.gap)[:, None] * self.normal
        return (self.position + half, self.first, 1.0), (self.position - half, self.second, -1.0)

    def taken(self, numbers: Array) -> Points:
        """Some of the points."""
        return Points(*(getattr(self, name)[numbers] for name in self.__dataclass_fields__))


_NO_NUMBERS, _NO_VECTORS = np.zeros(0, dtype=int), np.zeros((0, 3))
NONE = Points(_NO_NUMBERS, _NO_NUMBERS, _NO_NUMBERS, _NO_NUMBERS, np.zeros(0), _NO_VECTORS, _NO_VECTORS)


def joined(found: Iterable[Points]) -> Points:
    """Points of several groups as one."""
    parts = list(found) or [NONE]
    if len(parts) == 1:
        return parts[0]
    return Points(*(np.concatenate([getattr(one, name) for one in parts]) for name in Points.__dataclass_fields__))


def key_of(pair: Array, feature: Array | int) -> Array:
    """A number of each point from those of its pair and of the feature of the bodies that it is."""
    return np.asarray(pair * (1 << FEATURES) + feature, dtype=np.int64)


def pair_of(key: Array) -> Array:
    """The numbers of the pairs of points."""
    return key >> FEATURES


def points_of(
    pair: Array, feature: Array | int, links: Any, near: Nearest, reach: float, rows: Array | slice = slice(None)
) -> Points:
    """Points of a group with gaps below the reach, from the nearest points that a formula gives for some rows."""
    gap, normal = near.gap[rows], np.array(near.axes[0]).T[rows]
    position = np.array(near.first.position(links)).T[rows] - 0.5 * gap[:, None] * normal
    first, second = (np.zeros(len(near.gap), dtype=int) if isinstance(end.frame, str) else links.joint[end.frame]
                     for end in (near.first, near.second))  # fmt: skip
    found = Points(pair, key_of(pair, feature), first[rows], second[rows], gap, normal, position)
    return found.taken(np.flatnonzero(gap < reach))


def rim_ways(n: Any, u: Any) -> tuple[Array, Array]:
    """Directions (3, n) along discs with axes u: down planes with normals n, and to the side. Any of what lies flat."""
    down = np.array(down_rim(n, u))
    any_way = np.cross(u, np.where(np.abs(u[:1]) < 0.9, [[1.0], [0.0], [0.0]], [[0.0], [1.0], [0.0]]), axis=0)
    down = np.where(np.linalg.norm(down, axis=0) > FLAT, down, any_way)
    down /= np.linalg.norm(down, axis=0)
    return down, np.cross(u, down, axis=0)


def stacked(gaps: Sequence[Gap], number: dict[str, int]) -> Any:
    """The gaps of one kind as one, of arrays: numbers of links in place of their names, vectors as (3, n).

    The ground and ZERO, which formulas fold, stay as they are.
    """

    def leaf(values: Sequence[Any]) -> Any:
        if isinstance(values[0], str):
            return np.array([number[name] for name in values])
        return np.array(values, dtype=float).T

    return each(leaf, gaps)


def each(leaf: Callable[[Sequence[Any]], Any], parts: Sequence[Any]) -> Any:
    """A structure like all of the parts, with a function of what they have in each place."""
    one = parts[0]
    if isinstance(one, msgspec.Struct):
        columns = ([getattr(part, name) for part in parts] for name in one.__struct_fields__)
        return type(one)(*(each(leaf, column) for column in columns))
    if isinstance(one, tuple) and isinstance(one[0], (tuple, np.ndarray)):  # of axes
        return tuple(each(leaf, column) for column in zip(*parts, strict=True))
    return one if one is ZERO or (isinstance(one, str) and one == GROUND) else leaf(parts)
