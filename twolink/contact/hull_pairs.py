"""Points of solids that are looked at pair by pair: Coal tells their distance, and of boxes and meshes the features."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, cast

import numpy as np

from twolink.contact.hulls import Name, Touch, touching
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
        self.shapes = [[solid.shape.coal() for solid in pair] for pair in self.solids]
        self.joints = np.array([[middle_of(robot, s)[0] for s in pair] for pair in self.solids])
        own = [[placement(robot, s) for s in pair] for pair in self.solids]
        self.rotations = np.array([[x.rotation for x in pair] for pair in own])
        self.origins = np.array([[x.translation for x in pair] for pair in own])
        self.numbers: list[dict[Name, int]] = [{} for _ in items]  # of the points of each pair, by their names
        self.bounds = np.array([sum(bounding_radius(s) for s in pair) for pair in self.solids])

    def points(self, places: Places, reach: float) -> Points:
        """The points of the pairs that are near."""
        found = [(k, one) for k, result, rotations, origins in self._near(places, reach)
                 for one in self.between(k, result, rotations, origins, reach) if one.gap < reach]  # fmt: skip
        which = np.array([k for k, _ in found], dtype=int)
        own = np.array([self.numbers[k].setdefault(one.name, len(self.numbers[k])) for k, one in found], dtype=int)
        pair, joints = self.pair[which], self.joints[which]
        return Points(pair, key_of(pair, own), joints[:, 0], joints[:, 1], np.array([one.gap for _, one in found]),
                      np.array([one.normal for _, one in found]).reshape(-1, 3),
                      np.array([one.middle for _, one in found]).reshape(-1, 3))  # fmt: skip

    def overlaps(self, places: Places) -> Iterator[tuple[float, int]]:
        """How deep the solids overlap [m], and the numbers of the pairs."""
        for k, result, *_ in self._near(places, 0.0):
            yield -float(result.min_distance), int(self.pair[k])

    def _near(self, places: Places, reach: float) -> Iterator[tuple[int, Any, Array, Array]]:
        """Of the pairs nearer than the reach the number, Coal's result, and the rotations and origins of both."""
        import coal

        rotations = places.rotations[self.joints]
        origins = np.einsum("npij,npj->npi", rotations, self.origins) + places.origins[self.joints]
        near = np.flatnonzero(np.linalg.norm(origins[:, 0] - origins[:, 1], axis=1) < self.bounds + reach)
        request, turned = coal.DistanceRequest(), rotations[near] @ self.rotations[near]
        for k, rotation, origin in zip(near.tolist(), turned, origins[near], strict=True):
            (first, second), result = self.shapes[k], coal.DistanceResult()
            at = [coal.Transform3s(one, x) for one, x in zip(rotation, origin, strict=True)]
            if coal.distance(first, at[0], second, at[1], request, result) < reach:
                yield k, result, rotation, origin

    def between(self, number: int, result: Any, rotations: Array, origins: Array, reach: float) -> list[Touch]:
        """The points of a pair of placed solids, at least those with gaps below the reach. result: Coal's."""
        raise NotImplementedError


class Hulls(PairByPair):
    """Boxes and convex meshes against each other."""

    def between(self, number: int, result: Any, rotations: Array, origins: Array, reach: float) -> list[Touch]:
        """The corners of faces that lie over each other, or the crossing of two edges."""
        del result
        a, b = (hull_of(cast(Box | Convex, solid.shape)) for solid in self.solids[number])
        return touching(a.placed(rotations[0], origins[0]), b.placed(rotations[1], origins[1]), reach)


class NearestPoints(PairByPair):
    """Any other two shapes: their nearest points. There is one, also where they touch along a line."""

    def between(self, number: int, result: Any, rotations: Array, origins: Array, reach: float) -> list[Touch]:
        """The nearest points."""
        del number, rotations, origins, reach
        middle = 0.5 * (np.array(result.getNearestPoint1()) + np.array(result.getNearestPoint2()))
        return [Touch((), float(result.min_distance), -np.array(result.normal), middle)]
