"""Points at which bodies touch what is fixed to the world: planes and height fields."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, cast

import numpy as np

from twolink.algorithms.motion import GROUND
from twolink.algorithms.namespaces import Array
from twolink.algorithms.spatial import unit
from twolink.geometry.fields import HeightField, surface_of
from twolink.geometry.gaps import Ball, PlaneGap, RimGap
from twolink.geometry.hulls import TouchPoint
from twolink.geometry.on_fields import FieldBody
from twolink.geometry.pairs import Pair, Plane, balls_of, gaps_of
from twolink.geometry.points import Links, Points, joined, key_of, rim_ways, stacked
from twolink.robots.collisions import AnyShape, Box, Convex, Cylinder

FEW = 64  # points that are all looked at


class Group:
    """Pairs of shapes of one kind. pair: their numbers. number: of each link, by its name."""

    def __init__(self, pair: Array, pairs: Sequence[Pair], number: dict[str, int]) -> None:
        raise NotImplementedError

    def points(self, links: Links, reach: float) -> Points:
        """The points with gaps below the reach."""
        raise NotImplementedError

    def overlaps(self, links: Links) -> Iterator[tuple[float, int]]:
        """Overlaps of bodies: their depths [m], and the numbers of the pairs."""
        found = self.points(links, 0.0)
        return zip((-found.gap).tolist(), found.pair.tolist(), strict=True)


class OnPlanes(Group):
    """Balls and points of bodies over planes of the world.

    every: the gaps of all points as one. key, pair: see `Points`. first, solid: of each body its first point, and of
    each point its body. bodies: their links. centres (3, bodies), bounds (bodies,): of spheres around them.
    """

    def __init__(self, pair: Array, pairs: Sequence[Pair], number: dict[str, int]) -> None:
        solids, planes = [one.first for one in pairs], [cast(Plane, one.second) for one in pairs]
        balls = [balls_of(solid) for solid in solids]
        counts = np.array([len(points) for points, _ in balls])
        self.solid, self.first = np.repeat(np.arange(len(pairs)), counts), np.cumsum(counts) - counts
        self.pair = pair[self.solid]
        self.feature = np.arange(len(self.solid)) - self.first[self.solid]
        self.key, self.bodies = key_of(self.pair, self.feature), [solid.link for solid in solids]
        normals = np.array([unit(plane.normal, "pairs") for plane in planes], dtype=float)
        heights, radii = (np.array(x, dtype=float)[self.solid]
                          for x in ([plane.height for plane in planes], [radius for _, radius in balls]))  # fmt: skip
        frames = np.array([number[solid.link] for solid in solids])[self.solid]
        points: Any = np.concatenate([points for points, _ in balls]).T
        self.every: Any = PlaneGap(Ball(frames, points, radii), GROUND, normals[self.solid].T, heights)  # type: ignore[arg-type]
        self.centres = np.array([solid.shape.placement.translation for solid in solids]).T
        self.bounds = np.array([bounding_radius(solid.shape) for solid in solids])

    def points(self, links: Links, reach: float) -> Points:
        """The balls' lowest points."""
        gap, rows = self.every, self._near(links, reach)
        link, normal, radius = gap.ball.frame[rows], gap.normal[:, rows], gap.ball.radius[rows]
        x = links.position(link, gap.ball.point[:, rows])
        height = (normal * x).sum(axis=0) - gap.height[rows] - radius
        found = np.flatnonzero(height < reach)
        rows, height, normal = rows[found], height[found], normal[:, found]
        position = x[:, found] - (radius[found] + 0.5 * height) * normal
        ground = np.zeros(len(rows), dtype=int)
        return Points(self.pair[rows], self.key[rows], links.joint[link[found]], ground, height, normal.T, position.T)

    def _near(self, links: Links, reach: float) -> Array:
        """The rows of the bodies whose bounding spheres are near their planes; all where there are few."""
        if len(self.pair) <= FEW:
            return np.arange(len(self.pair))
        first, gap = self.first, self.every
        low = (gap.normal[:, first] * links.position(gap.ball.frame[first], self.centres)).sum(axis=0) - self.bounds
        return np.flatnonzero((low - gap.height[first] < reach)[self.solid])


class RimsOnPlanes(Group):
    """Cylinders over planes of the world: of each end the lowest point of the rim and three others.

    pair, feature, gaps: of each rim.
    """

    def __init__(self, pair: Array, pairs: Sequence[Pair], number: dict[str, int]) -> None:
        rims = [[gap for gap in gaps_of(one) if isinstance(gap, RimGap)] for one in pairs]
        self.pair = np.repeat(pair, [len(gaps) for gaps in rims])
        self.feature = np.array([k for gaps in rims for k, _ in enumerate(gaps)])
        self.gaps = [gap for gaps in rims for gap in gaps]
        self.every = stacked(self.gaps, number)

    def points(self, links: Links, reach: float) -> Points:
        """The lowest point of each rim, the highest one, and those between."""
        gap, found = self.every, []
        u = links.direction(gap.link, gap.axis)
        down, side = rim_ways(gap.normal, u)
        centre = links.position(gap.link, gap.point)
        for feature, way in enumerate((down, side, -side, -down)):
            x = centre + gap.radius * way
            height = np.einsum("in,in->n", gap.normal, x) - gap.height
            ground = np.zeros(len(height), dtype=int)
            found.append(Points(self.pair, key_of(self.pair, 4 * self.feature + feature), links.joint[gap.link], ground,
                                height, gap.normal.T, (x - 0.5 * height * gap.normal).T))  # fmt: skip
        every = joined(found)
        return every.taken(np.flatnonzero(every.gap < reach))


class OnFields(Group):
    """Bodies over height fields of the world."""

    def __init__(self, pair: Array, pairs: Sequence[Pair], number: dict[str, int]) -> None:
        self.pair, self.link = pair, np.array([number[one.first.link] for one in pairs])
        self.solids, self.bodies = [one.first for one in pairs], [FieldBody(one.first.shape) for one in pairs]
        self.surfaces = [surface_of(cast(HeightField, one.second)) for one in pairs]
        places = [one.first.shape.placement for one in pairs]
        self.rotations = np.array([place.rotation for place in places])
        self.origins = np.array([place.translation for place in places]).T

    def points(self, links: Links, reach: float) -> Points:
        """The points of one body after the other."""
        rotations, origins = links.rotations[self.link] @ self.rotations, links.position(self.link, self.origins).T
        found = [(k, touch) for k, (body, surface) in enumerate(zip(self.bodies, self.surfaces, strict=True))
                 for touch in body.touches(surface, rotations[k], origins[k], reach)]  # fmt: skip
        rows = np.array([k for k, _ in found], dtype=int)
        features = [self.surfaces[k].feature(one.name) for k, one in found]
        return of_touches(self.pair[rows], found, features, links.joint[self.link[rows]], np.zeros(len(rows), int))


def of_touches(
    pair: Array, found: Sequence[tuple[int, TouchPoint]], features: Sequence[int], first: Array, second: Array
) -> Points:
    """Points of touches, each with its place among the pairs of a group. features: their numbers within a pair."""
    feature = np.array(features, dtype=int)
    gap, normal, middle = (np.array([getattr(one, key) for _, one in found]) for key in ("gap", "normal", "middle"))
    return Points(pair, key_of(pair, feature), first, second, gap, normal.reshape(-1, 3), middle.reshape(-1, 3))


def bounding_radius(shape: AnyShape) -> float:
    """Of a sphere around a shape's middle, m."""
    if isinstance(shape, Convex):
        return float(np.linalg.norm(np.array(shape.vertices), axis=1).max())
    if isinstance(shape, Box):
        return 0.5 * float(np.linalg.norm(shape.size))
    radius, half = float(shape.radius), 0.5 * float(getattr(shape, "length", 0.0))
    return float(np.hypot(radius, half)) if isinstance(shape, Cylinder) else radius + half
