"""Detection: the points at which the bodies of a scene touch or are about to, with gaps and normals."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from twolink.contact.formulas import InBoxes, OnPlanes, RimsOnPlanes, Rounds
from twolink.contact.hull_pairs import Hulls, NearestPoints
from twolink.contact.points import Group, Places, Points, bounding_radius, joined, middle_of
from twolink.dynamics import Robot
from twolink.effects.contact import Contact
from twolink.effects.contact_pairs import Pair, Plane
from twolink.robots.collisions import Solid
from twolink.robots.shapes import AnyShape, Box, Capsule, Convex, Cylinder, Sphere


class Detector:
    """Finds the points of a scene's contact effects. names: of the pairs. friction, static, restitution: of each."""

    def __init__(self, robot: Robot, effects: Sequence[Contact]) -> None:
        pairs = [(pair, effect) for effect in effects for pair in effect.selected(robot).chosen]
        self.names = [pair.name for pair, _ in pairs]
        laws = [(float(e.friction), float(e.friction if e.static is None else e.static), float(e.restitution))
                for _, e in pairs]  # fmt: skip
        self.friction, self.static, self.restitution = np.array(laws).reshape(-1, 3).T
        solids = {id(s): s for pair, _ in pairs for s in (pair.first, pair.second) if isinstance(s, Solid)}
        inner = {key: _inner(solid.shape) for key, solid in solids.items()}
        self.thickness = np.array([  # m, of each pair: how deep bodies can go before they are out on the other side
            np.inf if isinstance(pair.second, Plane) else inner[id(pair.first)] + inner[id(pair.second)]
            for pair, _ in pairs
        ])  # fmt: skip
        kinds: dict[type[Group], list[tuple[int, Pair]]] = {}
        for number, (pair, _) in enumerate(pairs):
            kinds.setdefault(_kind(pair), []).append((number, pair))
        self.groups = [kind(robot, items) for kind, items in kinds.items()]
        self.sees_all = Hulls not in kinds  # whether what touches within a step is a point before
        self.extent = np.zeros(robot.model.njoints)  # of the shapes around their joint, m
        for solid in solids.values():
            joint, center = middle_of(robot, solid)
            self.extent[joint] = max(self.extent[joint], float(np.linalg.norm(center)) + bounding_radius(solid))

    def points(self, places: Places, reach: float) -> Points:
        """The points with gaps below the reach."""
        return joined(group.points(places, reach) for group in self.groups)

    def overlap(self, places: Places) -> tuple[float, int]:
        """The deepest overlap [m], and the number of its pair; 0 and -1 where there is none."""
        return max(itertools.chain(((0.0, -1),), *(group.overlaps(places) for group in self.groups)))


def _kind(pair: Pair) -> type[Group]:
    """What finds the points of a pair."""
    a, b = pair.first.shape, pair.second
    if isinstance(b, Plane):
        return RimsOnPlanes if isinstance(a, Cylinder) else OnPlanes
    if isinstance(a, (Sphere, Capsule)) and isinstance(b.shape, (Sphere, Capsule)):
        return Rounds
    if isinstance(a, Sphere) and isinstance(b.shape, Box):
        return InBoxes
    if isinstance(a, (Box, Convex)) and isinstance(b.shape, (Box, Convex)):
        return Hulls
    return NearestPoints


def _inner(shape: AnyShape) -> float:
    """Half of the smallest extent, m."""
    if isinstance(shape, Box):
        return 0.5 * float(min(shape.size))
    if isinstance(shape, Convex):
        return 0.5 * float(np.ptp(np.array(shape.vertices), axis=0).min())
    return float(shape.radius)
