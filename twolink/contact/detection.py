"""Detection: the points at which bodies touch or are about to, with gaps and normals, for all pairs at once.

    g = n . (x_a - x_b)

x_a, x_b: the nearest points of the two bodies; n: the unit normal there, from b to a. Spheres, capsules, boxes and
hulls against planes, spheres and capsules against each other, and spheres against boxes have closed formulas.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, cast

import numpy as np

from twolink.dynamics import Robot
from twolink.effects.conditions import unit
from twolink.effects.contact import Contact
from twolink.effects.contact_pairs import Pair, Plane
from twolink.errors import SceneError
from twolink.integrate.state import Array
from twolink.robots.collisions import Solid
from twolink.robots.shapes import AnyShape, Box, Capsule, Convex, Cylinder, Sphere

PARALLEL = 1e-9  # the square of the sine between two segments below it: they count as parallel
FLAT = 1e-9  # of a rim: below it the disc lies flat on the plane


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
        """The nearest points (n, 3) of the two bodies, the joints that carry them, and their signs in the gap."""
        half = 0.5 * self.gap[:, None] * self.normal
        return (self.position + half, self.first, 1.0), (self.position - half, self.second, -1.0)

    def taken(self, numbers: Array) -> Points:
        """Some of the points."""
        return Points(*(getattr(self, name)[numbers] for name in self.__dataclass_fields__))


class Detector:
    """Finds the points of a scene's contact effects. names: of the pairs. friction, static, restitution: of each."""

    def __init__(self, robot: Robot, effects: Sequence[Contact]) -> None:
        pairs = [(pair, effect) for effect in effects for pair in effect.selected(robot).chosen]
        self.names = [pair.name for pair, _ in pairs]
        laws = [(float(e.friction), float(e.friction if e.static is None else e.static), float(e.restitution))
                for _, e in pairs]  # fmt: skip
        self.friction, self.static, self.restitution = np.array(laws).reshape(-1, 3).T
        self.thickness = np.array([_thickness(pair) for pair, _ in pairs])  # of the thinner body of each pair, m
        kinds: dict[type[Group], list[tuple[int, Pair]]] = {}
        for number, (pair, _) in enumerate(pairs):
            kinds.setdefault(_kind(pair), []).append((number, pair))
        self._groups = [kind(robot, items) for kind, items in kinds.items()]
        solids = [s for pair, _ in pairs for s in (pair.first, pair.second) if isinstance(s, Solid)]
        self.extent = np.zeros(robot.model.njoints)  # of the shapes around their joint, m
        for solid in solids:
            joint, center = _local(robot, solid)
            self.extent[joint] = max(self.extent[joint], float(np.linalg.norm(center)) + bounding_radius(solid))

    def points(self, places: Places, reach: float) -> Points:
        """The points with gaps below the reach."""
        found = [group.points(places, reach) for group in self._groups]
        if len(found) == 1:
            return found[0]
        return Points(*(np.concatenate([getattr(one, name) for one in found]) for name in Points.__dataclass_fields__))


class Group:
    """Pairs of shapes of one kind."""

    def __init__(self, robot: Robot, items: Sequence[tuple[int, Pair]]) -> None:
        raise NotImplementedError

    def points(self, places: Places, reach: float) -> Points:
        """The points with gaps below the reach."""
        raise NotImplementedError


class OnPlanes(Group):
    """Balls and points of bodies over planes of the world: g = n . x - height - r."""

    def __init__(self, robot: Robot, items: Sequence[tuple[int, Pair]]) -> None:
        rows = []
        for number, pair in items:
            plane = cast(Plane, pair.second)
            normal = unit(plane.normal, "pairs")
            radius, corners = _corners(pair.first)
            joint, _ = _local(robot, pair.first)
            place = _placement(robot, pair.first)
            rows += [(number, k, joint, place.act(np.array(corner)), radius, normal, float(plane.height))
                     for k, corner in enumerate(corners)]  # fmt: skip
        columns: list[Array] = [np.array(column) for column in zip(*rows, strict=True)]
        self.pair, feature, self.joint, self.local, self.radius, self.normal, self.height = columns
        self.key, self.ground = _key(self.pair, feature), np.zeros_like(self.joint)

    def points(self, places: Places, reach: float) -> Points:
        """The balls' lowest points."""
        x = places.points(self.joint, self.local)
        gap = np.einsum("ni,ni->n", self.normal, x) - self.height - self.radius
        position = x - (self.radius + 0.5 * gap)[:, None] * self.normal
        every = Points(self.pair, self.key, self.joint, self.ground, gap, self.normal, position)
        return every.taken(np.flatnonzero(gap < reach))


class RimsOnPlanes(Group):
    """Cylinders over planes of the world: of each end the lowest point of the rim and three others."""

    def __init__(self, robot: Robot, items: Sequence[tuple[int, Pair]]) -> None:
        rows = []
        for number, pair in items:
            shape, plane = cast(Cylinder, pair.first.shape), cast(Plane, pair.second)
            place, half = _placement(robot, pair.first), 0.5 * float(shape.length)
            rows += [(number, k, _local(robot, pair.first)[0], place.act(np.array([0.0, 0.0, side * half])),
                      place.rotation[:, 2], float(shape.radius), unit(plane.normal, "pairs"),
                      float(plane.height)) for k, side in enumerate((-1.0, 1.0))]  # fmt: skip
        columns: list[Array] = [np.array(column) for column in zip(*rows, strict=True)]
        self.pair, self.end, self.joint, self.local, self.axis, self.radius, self.normal, self.height = columns

    def points(self, places: Places, reach: float) -> Points:
        """The lowest point of each rim, the highest one, and those between."""
        u = places.directions(self.joint, self.axis)
        down = np.einsum("ni,ni->n", self.normal, u)[:, None] * u - self.normal
        length = np.linalg.norm(down, axis=1)
        any_radius = np.cross(u, np.where(np.abs(u[:, :1]) < 0.9, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]))
        down = np.where((length > FLAT)[:, None], down, any_radius)
        down /= np.linalg.norm(down, axis=1)[:, None]
        side = np.cross(u, down)
        centre, found = places.points(self.joint, self.local), []
        for feature, way in enumerate((down, side, -side, -down)):
            x = centre + self.radius[:, None] * way
            gap = np.einsum("ni,ni->n", self.normal, x) - self.height
            found.append(Points(self.pair, _key(self.pair, 4 * self.end + feature), self.joint,
                                np.zeros_like(self.joint), gap, self.normal,
                                x - 0.5 * gap[:, None] * self.normal).taken(np.flatnonzero(gap < reach)))  # fmt: skip
        return Points(*(np.concatenate([getattr(p, name) for p in found]) for name in Points.__dataclass_fields__))


class Rounds(Group):
    """Spheres and capsules against each other: the nearest points of two segments, with radii.

    Source: Ericson, Real-Time Collision Detection, 2005, section 5.1.9.
    """

    def __init__(self, robot: Robot, items: Sequence[tuple[int, Pair]]) -> None:
        self.pair = np.array([number for number, _ in items])
        self.ends = [_Segments([_segment(robot, solid) for solid in solids])
                     for solids in zip(*((pair.first, pair.second) for _, pair in items), strict=True)]  # fmt: skip
        self.apart = [ends.radius + np.linalg.norm(ends.half, axis=1) for ends in self.ends]
        self.bounds = self.apart[0] + self.apart[1]

    def points(self, places: Places, reach: float) -> Points:
        """The nearest points of the pairs whose bounding spheres are near."""
        a, b = self.ends
        x, y = places.points(a.joint, a.centre), places.points(b.joint, b.centre)
        apart = x - y
        near = np.flatnonzero(np.einsum("ni,ni->n", apart, apart) < (self.bounds + reach) ** 2)
        x, y, apart = x[near], y[near], apart[near]
        u, w = (places.directions(ends.joint[near], ends.half[near]) for ends in (a, b))
        s, t = _nearest_of_segments(apart, u, w)
        x, y = x + s[:, None] * u, y + t[:, None] * w
        line = x - y
        distance = np.linalg.norm(line, axis=1)
        normal = np.where(distance[:, None] > 0.0, line / np.maximum(distance, 1e-300)[:, None], [0.0, 0.0, 1.0])
        gap = distance - a.radius[near] - b.radius[near]
        position = y + (b.radius[near] + 0.5 * gap)[:, None] * normal
        pair = self.pair[near]
        every = Points(pair, _key(pair, 0), a.joint[near], b.joint[near], gap, normal, position)
        return every.taken(np.flatnonzero(gap < reach))


class InBoxes(Group):
    """Spheres against boxes: the nearest point of a face, an edge or a corner."""

    def __init__(self, robot: Robot, items: Sequence[tuple[int, Pair]]) -> None:
        self.pair = np.array([number for number, _ in items])
        self.ball = _Segments([_segment(robot, pair.first) for _, pair in items])
        boxes = [pair.second for _, pair in items if isinstance(pair.second, Solid)]
        places = [_placement(robot, box) for box in boxes]
        self.joint = np.array([_local(robot, box)[0] for box in boxes])
        self.rotation, self.centre = np.array([p.rotation for p in places]), np.array([p.translation for p in places])
        sizes = [box.shape.size for box in boxes if isinstance(box.shape, Box)]
        self.half = 0.5 * np.array(sizes, dtype=np.float64)

    def points(self, places: Places, reach: float) -> Points:
        """The nearest points to the balls' centres."""
        x = places.points(self.ball.joint, self.ball.centre)
        axes = places.rotations[self.joint] @ self.rotation
        own = np.einsum("nji,nj->ni", axes, x - places.points(self.joint, self.centre))
        inside = np.clip(own, -self.half, self.half)
        off = own - inside
        distance = np.linalg.norm(off, axis=1)
        # A centre within the box leaves by the nearest face.
        depth = self.half - np.abs(own)
        face = depth.argmin(axis=1)
        rows = np.arange(len(own))
        out = np.zeros_like(own)
        out[rows, face] = np.where(own[rows, face] < 0.0, -1.0, 1.0)
        within = distance <= 0.0
        normal = np.where(within[:, None], out, off / np.maximum(distance, 1e-300)[:, None])
        gap = np.where(within, -depth[rows, face], distance) - self.ball.radius
        normal = np.einsum("nij,nj->ni", axes, normal)
        position = x - (self.ball.radius + 0.5 * gap)[:, None] * normal
        every = Points(self.pair, _key(self.pair, 0), self.ball.joint, self.joint, gap, normal, position)
        return every.taken(np.flatnonzero(gap < reach))


class _Segments:
    """Segments of bodies with radii: joint (n,), centre (n, 3) and half (n, 3) in its axes, radius (n,)."""

    def __init__(self, rows: Sequence[tuple[int, Array, Array, float]]) -> None:
        joint, centre, half, radius = zip(*rows, strict=True)
        self.joint, self.centre, self.half, self.radius = (
            np.array(joint),
            np.array(centre),
            np.array(half),
            np.array(radius),
        )


def _kind(pair: Pair) -> type[Group]:
    """What finds the points of a pair. Raises SceneError for shapes that nothing does."""
    a, b = pair.first.shape, pair.second
    if isinstance(b, Plane):
        return RimsOnPlanes if isinstance(a, Cylinder) else OnPlanes
    if isinstance(a, (Sphere, Capsule)) and isinstance(b.shape, (Sphere, Capsule)):
        return Rounds
    if isinstance(a, Sphere) and isinstance(b.shape, Box):
        return InBoxes
    kinds = " and ".join(type(shape).__name__.lower() for shape in (a, b.shape))
    raise SceneError(f"contacts of {pair.name} cannot be stepped: there is no detection for {kinds}", where="pairs",
                     remedy="give spheres, capsules or boxes as its shapes", code="no-stepped-contact")  # fmt: skip


def _key(pair: Array, feature: Array | int) -> Array:
    return np.asarray(pair * (1 << 16) + feature, dtype=np.int64)


def _placement(robot: Robot, solid: Solid) -> Any:
    """Where a solid is in the axes of the joint that carries it."""
    import pinocchio as pin

    frame = robot.model.frames[robot.model.getFrameId(solid.link, pin.FrameType.BODY)]
    return frame.placement * solid.shape.placement


def _local(robot: Robot, solid: Solid) -> tuple[int, Array]:
    """The joint that carries a solid, and its middle in that joint's axes."""
    import pinocchio as pin

    frame = robot.model.frames[robot.model.getFrameId(solid.link, pin.FrameType.BODY)]
    return int(frame.parentJoint), np.array((frame.placement * solid.shape.placement).translation)


def _segment(robot: Robot, solid: Solid) -> tuple[int, Array, Array, float]:
    """A sphere or capsule: its joint, middle and half axis in that joint's axes, and its radius."""
    joint, centre = _local(robot, solid)
    half = 0.5 * float(getattr(solid.shape, "length", 0.0))
    return (
        joint,
        centre,
        half * _placement(robot, solid).rotation[:, 2],
        float(cast(Sphere | Capsule, solid.shape).radius),
    )


def _corners(solid: Solid) -> tuple[float, list[tuple[float, float, float]]]:
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
    radius, corners = _corners(solid)
    return radius + float(np.linalg.norm(np.array(corners), axis=1).max())


def _thickness(pair: Pair) -> float:
    """Half of the thinner body's smallest extent, m; planes have no end."""
    if isinstance(pair.second, Plane):
        return np.inf
    return min(_inner(solid.shape) for solid in (pair.first, pair.second))


def _inner(shape: AnyShape) -> float:
    if isinstance(shape, Box):
        return 0.5 * float(min(shape.size))
    if isinstance(shape, Convex):
        return 0.5 * float(np.ptp(np.array(shape.vertices), axis=0).min())
    return float(shape.radius)


def _nearest_of_segments(apart: Array, u: Array, w: Array) -> tuple[Array, Array]:
    """s and t (n,) from -1 to 1 of the nearest points s u and t w. apart (n, 3): of the middles, from the second."""

    def dot(x: Array, y: Array) -> Array:
        return np.asarray(np.einsum("ni,ni->n", x, y))

    a, b, c, d, e = dot(u, u), dot(u, w), dot(w, w), dot(u, apart), dot(w, apart)
    size = a * c - b * b
    crossing = size > PARALLEL * a * c
    s = np.clip(np.where(crossing, (b * e - c * d) / np.where(crossing, size, 1.0), 0.0), -1.0, 1.0)
    t = np.clip((b * s + e) / np.where(c > 0.0, c, 1.0), -1.0, 1.0)
    s = np.clip((b * t - d) / np.where(a > 0.0, a, 1.0), -1.0, 1.0)
    return s, t
