"""Points of hulls that touch, pair by pair; and of other shapes, by Coal's distances."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import numpy as np

from twolink.contact.hulls import touching
from twolink.contact.points import Group, Places, Points, bounding_radius, key_of, middle_of, placement
from twolink.dynamics import Robot
from twolink.effects.contact_pairs import Pair
from twolink.integrate.state import Array
from twolink.robots.collisions import Solid
from twolink.robots.hulls import hull_of
from twolink.robots.shapes import Box, Convex


class PairByPair(Group):
    """Pairs of solids that are looked at one by one, where their bounding spheres are near."""

    def __init__(self, robot: Robot, items: Sequence[tuple[int, Pair]]) -> None:
        self.pair = np.array([number for number, _ in items])
        self.solids = [[cast(Solid, s) for s in (pair.first, pair.second)] for _, pair in items]
        self.joints = np.array([[middle_of(robot, s)[0] for s in pair] for pair in self.solids])
        own = [[placement(robot, s) for s in pair] for pair in self.solids]
        self.rotations = np.array([[x.rotation for x in pair] for pair in own])
        self.origins = np.array([[x.translation for x in pair] for pair in own])
        self.bounds = np.array([sum(bounding_radius(s) for s in pair) for pair in self.solids])

    def points(self, places: Places, reach: float) -> Points:
        """The points of the pairs whose bounding spheres are near."""
        rotations = places.rotations[self.joints]
        origins = np.einsum("npij,npj->npi", rotations, self.origins) + places.origins[self.joints]
        near = np.flatnonzero(np.linalg.norm(origins[:, 0] - origins[:, 1], axis=1) < self.bounds + reach)
        rows: list[tuple[int, int, float, Array, Array]] = []
        for k in near.tolist():
            found = self.between(k, rotations[k] @ self.rotations[k], origins[k], reach)
            rows += [(k, *point) for point in found if point[1] < reach]
        number = np.array([row[0] for row in rows], dtype=int)
        pair, joints = self.pair[number], self.joints[number]
        return Points(pair, key_of(pair, np.array([row[1] for row in rows], dtype=int)), joints[:, 0], joints[:, 1],
                      np.array([row[2] for row in rows]), np.array([row[3] for row in rows]).reshape(-1, 3),
                      np.array([row[4] for row in rows]).reshape(-1, 3))  # fmt: skip

    def between(
        self, number: int, rotations: Array, origins: Array, reach: float
    ) -> list[tuple[int, float, Array, Array]]:
        """The points of a pair of placed solids: a number, the gap, the normal from the second, the middle point."""
        raise NotImplementedError


class Hulls(PairByPair):
    """Boxes and convex meshes against each other."""

    def between(
        self, number: int, rotations: Array, origins: Array, reach: float
    ) -> list[tuple[int, float, Array, Array]]:
        """The corners of faces that lie over each other, or the crossing of two edges."""
        a, b = (hull_of(cast(Box | Convex, solid.shape)) for solid in self.solids[number])
        return touching(a.placed(rotations[0], origins[0]), b.placed(rotations[1], origins[1]), reach)


class NearestPoints(PairByPair):
    """Any other two shapes: their nearest points, by Coal. There is one, also where they touch along a line."""

    def __init__(self, robot: Robot, items: Sequence[tuple[int, Pair]]) -> None:
        super().__init__(robot, items)
        self.shapes = [[solid.shape.coal() for solid in pair] for pair in self.solids]

    def between(
        self, number: int, rotations: Array, origins: Array, reach: float
    ) -> list[tuple[int, float, Array, Array]]:
        """The nearest points."""
        del reach
        import coal

        first, second = self.shapes[number]
        at = [coal.Transform3s(rotation, origin) for rotation, origin in zip(rotations, origins, strict=True)]
        result: Any = coal.DistanceResult()
        gap = float(coal.distance(first, at[0], second, at[1], coal.DistanceRequest(), result))
        middle = 0.5 * (np.array(result.getNearestPoint1()) + np.array(result.getNearestPoint2()))
        return [(0, gap, -np.array(result.normal), middle)]
