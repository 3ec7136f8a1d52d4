"""Points of shapes whose nearest points have closed formulas, for all pairs of a kind at once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

import numpy as np

from twolink.algorithms.spatial import unit
from twolink.contact.points import Group, Places, Points, corners_of, joined, key_of, middle_of, placement
from twolink.dynamics import Robot
from twolink.effects.contact_pairs import Pair, Plane
from twolink.integrate.state import Array
from twolink.robots.collisions import Solid
from twolink.robots.shapes import Box, Capsule, Cylinder, Sphere

PARALLEL = 1e-9  # the square of the sine between two segments below it: they count as parallel
FLAT = 1e-9  # of a rim: below it the disc lies flat on the plane
MANY = 2_000  # pairs beyond which a tree finds those that are near


class OnPlanes(Group):
    """Balls and points of bodies over planes of the world: g = n . x - height - r."""

    def __init__(self, robot: Robot, items: Sequence[tuple[int, Pair]]) -> None:
        rows = []
        for number, pair in items:
            plane = cast(Plane, pair.second)
            normal = unit(plane.normal, "pairs")
            radius, corners = corners_of(pair.first)
            joint, _ = middle_of(robot, pair.first)
            place = placement(robot, pair.first)
            rows += [(number, k, joint, place.act(np.array(corner)), radius, normal, float(plane.height))
                     for k, corner in enumerate(corners)]  # fmt: skip
        columns: list[Array] = [np.array(column) for column in zip(*rows, strict=True)]
        self.pair, feature, self.joint, self.local, self.radius, self.normal, self.height = columns
        self.key, self.ground = key_of(self.pair, feature), np.zeros_like(self.joint)

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
            place, half = placement(robot, pair.first), 0.5 * float(shape.length)
            rows += [(number, k, middle_of(robot, pair.first)[0], place.act(np.array([0.0, 0.0, side * half])),
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
            found.append(Points(self.pair, key_of(self.pair, 4 * self.end + feature), self.joint,
                                np.zeros_like(self.joint), gap, self.normal,
                                x - 0.5 * gap[:, None] * self.normal).taken(np.flatnonzero(gap < reach)))  # fmt: skip
        return joined(found)


class Rounds(Group):
    """Spheres and capsules against each other: the nearest points of two segments, with radii.

    Source: Ericson, Real-Time Collision Detection, 2005, section 5.1.9.
    """

    def __init__(self, robot: Robot, items: Sequence[tuple[int, Pair]]) -> None:
        solids: dict[Solid, int] = {}
        ends = [
            [solids.setdefault(cast(Solid, s), len(solids)) for s in (pair.first, pair.second)] for _, pair in items
        ]
        self.ends, self.pair = np.array(ends), np.array([number for number, _ in items])
        self.all = _Segments([_segment(robot, solid) for solid in solids])
        self.bounds = self.all.radius + np.linalg.norm(self.all.half, axis=1)
        self.number: Array | None = None
        if len(items) > MANY:
            self.number = np.full((len(solids), len(solids)), -1)
            self.number[self.ends[:, 0], self.ends[:, 1]] = np.arange(len(items))

    def points(self, places: Places, reach: float) -> Points:
        """The nearest points of the pairs whose bounding spheres are near."""
        every = self.all
        centre = places.points(every.joint, every.centre)
        near = self._near(centre, reach)
        i, k = self.ends[near].T
        u, w = (places.directions(every.joint[side], every.half[side]) for side in (i, k))
        s, t = _nearest_of_segments(centre[i] - centre[k], u, w)
        y = centre[k] + t[:, None] * w
        line = centre[i] + s[:, None] * u - y
        distance = np.linalg.norm(line, axis=1)
        normal = np.where(distance[:, None] > 0.0, line / np.maximum(distance, 1e-300)[:, None], [0.0, 0.0, 1.0])
        gap = distance - every.radius[i] - every.radius[k]
        position = y + (every.radius[k] + 0.5 * gap)[:, None] * normal
        pair = self.pair[near]
        found = Points(pair, key_of(pair, 0), every.joint[i], every.joint[k], gap, normal, position)
        return found.taken(np.flatnonzero(gap < reach))

    def _near(self, centre: Array, reach: float) -> Array:
        """The numbers of the pairs whose bounding spheres are near."""
        if self.number is not None:
            from scipy.spatial import cKDTree

            close = cKDTree(centre).query_pairs(2.0 * float(self.bounds.max()) + reach, output_type="ndarray")
            numbers = np.concatenate([self.number[close[:, 0], close[:, 1]], self.number[close[:, 1], close[:, 0]]])
            return np.sort(numbers[numbers >= 0])
        i, k = self.ends.T
        apart = centre[i] - centre[k]
        limit = self.bounds[i] + self.bounds[k] + reach
        return np.flatnonzero(np.einsum("ni,ni->n", apart, apart) < limit**2)


class InBoxes(Group):
    """Spheres against boxes: the nearest point of a face, an edge or a corner."""

    def __init__(self, robot: Robot, items: Sequence[tuple[int, Pair]]) -> None:
        self.pair = np.array([number for number, _ in items])
        self.ball = _Segments([_segment(robot, pair.first) for _, pair in items])
        boxes = [pair.second for _, pair in items if isinstance(pair.second, Solid)]
        places = [placement(robot, box) for box in boxes]
        self.joint = np.array([middle_of(robot, box)[0] for box in boxes])
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
        every = Points(self.pair, key_of(self.pair, 0), self.ball.joint, self.joint, gap, normal, position)
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


def _segment(robot: Robot, solid: Solid) -> tuple[int, Array, Array, float]:
    """A sphere or capsule: its joint, middle and half axis in that joint's axes, and its radius."""
    joint, centre = middle_of(robot, solid)
    half = 0.5 * float(getattr(solid.shape, "length", 0.0))
    return (
        joint,
        centre,
        half * placement(robot, solid).rotation[:, 2],
        float(cast(Sphere | Capsule, solid.shape).radius),
    )


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
