"""Detection: the points at which the bodies of a robot touch or are about to, with gaps and normals.

Boxes and convex meshes touch with features (`hulls`). For other shapes without a formula, and where bodies overlap so
far that a formula has no normal, Coal tells the nearest points.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from typing import Any, cast

import numpy as np
import pinocchio as pin

from twolink.algorithms.namespaces import Array
from twolink.dynamics import Robot
from twolink.geometry.distance import Placed, distance, nearest_points
from twolink.geometry.fields import HeightField
from twolink.geometry.hulls import Hull, Name, TouchPoint, facing, hull_of, separation, touching
from twolink.geometry.on_world import Group, OnFields, OnPlanes, RimsOnPlanes, bounding_radius, of_touches
from twolink.geometry.pairs import Pair, Plane, gaps_of
from twolink.geometry.points import Links, Places, Points, each, joined, points_of, stacked
from twolink.robots.collisions import AnyShape, Box, Capsule, Convex, Cylinder, Solid, Sphere

# Relative to bounding spheres, of Coal's distances: faces of boxes that overlap by 5e-6 m were 7e-9 m apart for it.
DOUBT = 1e-3
BURIED = 1e-9  # m: cores that are nearer have no normal
FEATURES = ("first", "second", "edges")  # kinds of points of hulls
MANY = 2_000  # pairs beyond which a tree finds those that are near


class OfSolids(Group):
    """Pairs of solids, looked at where their bounding spheres are near."""

    def __init__(self, pair: Array, pairs: Sequence[Pair], number: dict[str, int]) -> None:
        solids: dict[int, int] = {}
        every = [cast(Solid, solid) for one in pairs for solid in (one.first, one.second)]
        self.ends = np.array([solids.setdefault(id(solid), len(solids)) for solid in every]).reshape(-1, 2)
        self.solids = list({id(solid): solid for solid in every}.values())
        self.pairs, self.pair = pairs, pair
        self.shapes = [solid.shape.coal() for solid in self.solids]
        self.links, self.number = np.array([number[solid.link] for solid in self.solids]), number
        places = [solid.shape.placement for solid in self.solids]
        self.rotations = np.array([place.rotation for place in places])
        self.origins = np.array([place.translation for place in places]).T
        self.bounds = np.array([bounding_radius(solid.shape) for solid in self.solids])
        self.of_ends: Array | None = None
        if len(pairs) > MANY:
            self.of_ends = np.full((len(solids), len(solids)), -1)
            self.of_ends[self.ends[:, 0], self.ends[:, 1]] = np.arange(len(pairs))

    def points(self, links: Links, reach: float) -> Points:
        """The points of the pairs that are near, one pair after the other."""
        return self._one_by_one(self._near(links, reach), links, reach)

    def _near(self, links: Links, reach: float) -> Array:
        """The numbers of the pairs whose bounding spheres are near."""
        centre = links.position(self.links, self.origins).T
        if self.of_ends is not None:
            from scipy.spatial import cKDTree

            close = cKDTree(centre).query_pairs(2.0 * float(self.bounds.max()) + reach, output_type="ndarray")
            numbers = np.concatenate([self.of_ends[close[:, 0], close[:, 1]], self.of_ends[close[:, 1], close[:, 0]]])
            return np.sort(numbers[numbers >= 0])
        i, k = self.ends.T
        apart = centre[i] - centre[k]
        limit = self.bounds[i] + self.bounds[k] + reach
        return np.flatnonzero(np.einsum("ni,ni->n", apart, apart) < limit**2)

    def _placed(self, pairs: Array, links: Links) -> tuple[Array, Array]:
        """The rotations (n, 2, 3, 3) and origins (n, 2, 3) of the solids of pairs."""
        solids = self.ends[pairs].ravel()
        own = self.links[solids]
        rotations, origins = links.rotations[own] @ self.rotations[solids], links.position(own, self.origins[:, solids])
        return rotations.reshape(-1, 2, 3, 3), origins.T.reshape(-1, 2, 3)

    def _looked_at(self, pairs: Array, links: Links, reach: float) -> Iterator[tuple[int, Any, Array, Array]]:
        """Of those of the pairs that may be nearer than the reach the number, Coal's result, rotations and origins."""
        rotations, origins = self._placed(pairs, links)
        for k, rotation, origin in zip(pairs.tolist(), rotations, origins, strict=True):
            gap, result = distance(*self._shapes(k, rotation, origin))
            if gap < reach + DOUBT * self.bounds[self.ends[k]].sum():
                yield k, result, rotation, origin

    def _shapes(self, number: int, rotations: Array, origins: Array) -> tuple[Placed, Placed]:
        """The two placed shapes of a pair."""
        i, k = self.ends[number].tolist()
        return (self.shapes[i], rotations[0], origins[0]), (self.shapes[k], rotations[1], origins[1])

    def _one_by_one(self, pairs: Array, links: Links, reach: float) -> Points:
        found = [(k, one) for k, result, rotation, origin in self._looked_at(pairs, links, reach)
                 for one in self._between(k, result, rotation, origin, reach) if one.gap < reach]  # fmt: skip
        which = np.array([k for k, _ in found], dtype=int)
        joints = links.joint[self.links[self.ends[which]]]
        features = [self._feature(k, one.name) for k, one in found]
        return of_touches(self.pair[which], found, features, joints[:, 0], joints[:, 1])

    def _feature(self, number: int, name: Name) -> int:
        """The number of a point of a pair by its name, which is the only one."""
        del number, name
        return 0

    def _between(self, number: int, result: Any, rotations: Array, origins: Array, reach: float) -> list[TouchPoint]:
        """The points of a pair of placed solids: the nearest ones. There is one, also where they touch along a line."""
        del reach
        return [nearest_points(*self._shapes(number, rotations, origins), result)]


class ByFormula(OfSolids):
    """Solids with a formula of their one gap."""

    def __init__(self, pair: Array, pairs: Sequence[Pair], number: dict[str, int]) -> None:
        super().__init__(pair, pairs, number)
        self.row = np.full(len(pairs), -1)  # of each pair in the formulas of those that have been near
        self.every: Any = None
        radius = np.array([getattr(s.shape, "radius", 0.0) * (not isinstance(s.shape, Cylinder)) for s in self.solids])
        self.radii = radius[self.ends].sum(axis=1)

    def points(self, links: Links, reach: float) -> Points:
        """The nearest points by the formula; by Coal where cores overlap."""
        near = self._near(links, reach)
        if not len(near):
            return self._one_by_one(near, links, reach)
        with np.errstate(divide="ignore", invalid="ignore"):
            found = self._formulas(near).nearest(links)
            buried = ~(found.gap + self.radii[near] > BURIED)
            points = points_of(self.pair[near[~buried]], 0, links, found, reach, np.flatnonzero(~buried))
        return joined([points, self._one_by_one(near[buried], links, reach)]) if buried.any() else points

    def _formulas(self, near: Array) -> Any:
        """The gaps of pairs as one."""
        fresh = near[self.row[near] < 0]
        if len(fresh):
            new = stacked([gaps_of(self.pairs[k])[0] for k in fresh.tolist()], self.number)
            self.row[fresh] = np.arange(len(fresh)) + (self.row.max() + 1)
            self.every = new if self.every is None else each(lambda x: np.concatenate(x, axis=-1), [self.every, new])
        rows, known = self.row[near], self.row.max() + 1
        same = np.array_equal(rows, np.arange(known))
        return self.every if same else each(lambda x: x[0][..., rows], [self.every])


class Hulls(OfSolids):
    """Boxes and convex meshes against each other."""

    def __init__(self, pair: Array, pairs: Sequence[Pair], number: dict[str, int]) -> None:
        super().__init__(pair, pairs, number)
        self.hulls: dict[int, Hull] = {}  # of those that have been near

    def overlaps(self, links: Links) -> Iterator[tuple[float, int]]:
        """Overlaps of the solids: their depths [m], and the numbers of the pairs."""
        for k, result, rotations, origins in self._looked_at(self._near(links, 0.0), links, 0.0):
            yield -separation(*self._facing(k, result, rotations, origins)).gap, int(self.pair[k])

    def _between(self, number: int, result: Any, rotations: Array, origins: Array, reach: float) -> list[TouchPoint]:
        """The corners of faces that lie over each other, or the crossing of two edges."""
        return touching(*self._facing(number, result, rotations, origins), reach)

    def _facing(self, number: int, result: Any, rotations: Array, origins: Array) -> tuple[Hull, Hull]:
        """The placed hulls of a pair, or what of them looks at the other."""
        a, b = (self.hull(i).placed(rotations[k], origins[k]) for k, i in enumerate(self.ends[number].tolist()))
        return facing(a, b, -np.array(result.normal))

    def _feature(self, number: int, name: Name) -> int:
        """The number of a point by its kind and the edges that it lies between: what names it."""
        a, b = (self.hull(i) for i in self.ends[number].tolist())
        kind, *edges = name if len(name) == 3 else ("edges", *name)
        count = len(a.edges) + len(b.edges)
        first, second = (_edge_number(a, b, cast(tuple[bool, int, int], edge)) for edge in edges)
        return (FEATURES.index(cast(str, kind)) * count + first) * count + second

    def hull(self, number: int) -> Hull:
        """The hull of a solid."""
        if number not in self.hulls:
            self.hulls[number] = hull_of(cast(Box | Convex, self.solids[number].shape))
        return self.hulls[number]


class Detector:
    """Finds the points of pairs of a robot. names: of the pairs.

    thickness: m, of each pair, how deep bodies can go before they are out on the other side. sees_all: whether what
    touches within a step is a point before. extent (joints,): of the shapes around their joint, m.
    """

    def __init__(self, robot: Robot, pairs: Sequence[Pair]) -> None:
        self.names = [pair.name for pair in pairs]
        solids = {id(s): s for pair in pairs for s in (pair.first, pair.second) if isinstance(s, Solid)}
        paired = {id(s) for pair in pairs if isinstance(pair.second, Solid) for s in (pair.first, pair.second)}
        inner = {key: _inner(solid.shape) for key, solid in solids.items() if key in paired}
        self.thickness = np.array([
            inner[id(pair.first)] + inner[id(pair.second)] if isinstance(pair.second, Solid) else np.inf
            for pair in pairs
        ])  # fmt: skip
        number = {link: k for k, link in enumerate(dict.fromkeys(solid.link for solid in solids.values()))}
        frames = [robot.model.frames[robot.model.getFrameId(link, pin.FrameType.BODY)] for link in number]
        self.links = Links(np.array([frame.parentJoint for frame in frames], dtype=int),
                           np.array([frame.placement.rotation for frame in frames]).reshape(-1, 3, 3),
                           np.array([frame.placement.translation for frame in frames]).reshape(-1, 3))  # fmt: skip
        kinds: dict[tuple[type[Group], str], list[int]] = {}
        for k, pair in enumerate(pairs):
            kinds.setdefault(_kind(pair), []).append(k)
        self.groups = [kind(np.array(own), [pairs[k] for k in own], number) for (kind, _), own in kinds.items()]
        self.sees_all = not any(kind is Hulls or (kind is OnFields and name != "Sphere") for kind, name in kinds)
        self.extent = np.zeros(robot.model.njoints)
        for solid in solids.values():
            frame = frames[number[solid.link]]
            far = float(np.linalg.norm((frame.placement * solid.shape.placement).translation))
            self.extent[frame.parentJoint] = max(self.extent[frame.parentJoint], far + bounding_radius(solid.shape))

    def points(self, places: Places, reach: float) -> Points:
        """The points with gaps below the reach."""
        links = self.links.at(places)
        return joined(group.points(links, reach) for group in self.groups)

    def overlap(self, places: Places) -> tuple[float, int]:
        """The deepest overlap [m], and the number of its pair; 0 and -1 where there is none."""
        links = self.links.at(places)
        return max(itertools.chain(((0.0, -1),), *(group.overlaps(links) for group in self.groups)))


def _edge_number(a: Hull, b: Hull, edge: tuple[bool, int, int]) -> int:
    """The number of an edge of a pair of hulls, those of the second behind those of the first."""
    second, *ends = edge
    hull = b if second else a
    return int(np.flatnonzero((hull.edges == ends).all(axis=1))[0]) + len(a.edges) * second


def _kind(pair: Pair) -> tuple[type[Group], str]:
    """The group that finds the points of a pair, and the kind of its shapes where that has a formula for each."""
    a, b = pair.first.shape, pair.second
    if isinstance(b, HeightField):
        return OnFields, "Sphere" if isinstance(a, Sphere) else ""
    if isinstance(b, Plane):
        return (RimsOnPlanes if isinstance(a, Cylinder) else OnPlanes), ""
    shapes, flat = (a, b.shape), (Box, Convex)
    if all(isinstance(shape, flat) for shape in shapes):
        return Hulls, ""
    rounds = sum(isinstance(shape, (Sphere, Capsule)) for shape in shapes)
    solid = isinstance(a, Sphere) and isinstance(b.shape, (Box, Cylinder))
    if (rounds == 2 or solid) and sum(getattr(shape, "radius", 0.0) for shape in shapes[: max(1, rounds)]) > 0.0:
        return ByFormula, " ".join(type(shape).__name__ for shape in shapes)
    return OfSolids, ""


def _inner(shape: AnyShape) -> float:
    """Half of the smallest extent, m; of a hull, of those along the normals of its faces."""
    if isinstance(shape, Box):
        return 0.5 * float(min(shape.size))
    if isinstance(shape, Convex):
        hull = hull_of(shape)
        return 0.5 * float((hull.heights - (hull.vertices @ hull.normals.T).min(axis=0)).min())
    return float(min(shape.radius, 0.5 * shape.length) if isinstance(shape, Cylinder) else shape.radius)
