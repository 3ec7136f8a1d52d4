"""Points at which bodies touch or are about to, and what finds them.

    g = n . (x_a - x_b)

x_a, x_b: the nearest points of the two bodies; n: the unit normal there, from b to a.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, cast

import numpy as np
import pinocchio as pin

from twolink.dynamics import Robot
from twolink.effects.contact_pairs import Pair
from twolink.integrate.state import Array
from twolink.robots.collisions import Solid
from twolink.robots.shapes import Box, Capsule, Convex, Cylinder, Sphere

CLOSED = 1e-10  # m: what counts as no gap
TOUCHING = 1e-6  # m: points of two bodies that are so near move as one
STILL = 1e-9  # m/s: a slip that counts as none


class Places(NamedTuple):
    """Where the joints of a robot are: rotations R (joints, 3, 3) and origins (joints, 3), the ground first."""

    rotations: Array
    origins: Array

    def points(self, joints: Array, local: Array) -> Array:
        """Points (n, 3) in the axes of joints (n,), in the world."""
        return np.asarray(np.einsum("nij,nj->ni", self.rotations[joints], local) + self.origins[joints])

    def directions(self, joints: Array, local: Array) -> Array:
        """Directions (n, 3) in the axes of joints (n,), along the world's axes."""
        return np.asarray(np.einsum("nij,nj->ni", self.rotations[joints], local))


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


def joined(found: Iterable[Points]) -> Points:
    """Points of several groups as one."""
    parts = list(found)
    if len(parts) == 1:
        return parts[0]
    return Points(*(np.concatenate([getattr(one, name) for one in parts]) for name in Points.__dataclass_fields__))


class Group:
    """Pairs of shapes of one kind."""

    def __init__(self, robot: Robot, items: Sequence[tuple[int, Pair]]) -> None:
        raise NotImplementedError

    def points(self, places: Places, reach: float) -> Points:
        """The points with gaps below the reach."""
        raise NotImplementedError

    def overlaps(self, places: Places) -> Iterator[tuple[float, int]]:
        """How deep bodies overlap [m], and the numbers of the pairs."""
        found = self.points(places, 0.0)
        return zip((-found.gap).tolist(), found.pair.tolist(), strict=True)


def key_of(pair: Array, feature: Array | int) -> Array:
    """A number of each point from those of its pair and of the feature of the bodies that it is."""
    return np.asarray(pair * (1 << 32) + feature, dtype=np.int64)


def placement(robot: Robot, solid: Solid) -> Any:
    """Where a solid is in the axes of the joint that carries it."""
    frame = robot.model.frames[robot.model.getFrameId(solid.link, pin.FrameType.BODY)]
    return frame.placement * solid.shape.placement


def middle_of(robot: Robot, solid: Solid) -> tuple[int, Array]:
    """The joint that carries a solid, and its middle in that joint's axes."""
    frame = robot.model.frames[robot.model.getFrameId(solid.link, pin.FrameType.BODY)]
    return int(frame.parentJoint), np.array((frame.placement * solid.shape.placement).translation)


def corners_of(solid: Solid) -> tuple[float, list[tuple[float, float, float]]]:
    """The radius, and the points of a shape around which a hull of this radius is the shape, in its own axes."""
    shape = solid.shape
    if isinstance(shape, Sphere):
        return float(shape.radius), [(0.0, 0.0, 0.0)]
    if isinstance(shape, Capsule):
        return float(shape.radius), [(0.0, 0.0, side * 0.5 * float(shape.length)) for side in (-1.0, 1.0)]
    if isinstance(shape, Box):
        x, y, z = (0.5 * float(edge) for edge in shape.size)
        return 0.0, list(itertools.product((x, -x), (y, -y), (z, -z)))
    return 0.0, list(cast(Convex, shape).vertices)


def bounding_radius(solid: Solid) -> float:
    """Of a sphere around a solid's middle, m."""
    shape = solid.shape
    if isinstance(shape, Cylinder):
        return float(np.hypot(shape.radius, 0.5 * shape.length))
    radius, corners = corners_of(solid)
    return radius + float(np.linalg.norm(np.array(corners), axis=1).max())
