"""Features of two hulls that touch: corners over faces, and edges that cross.

The distance of two convex polyhedra that are apart is that of a corner from a face, of two edges that cross, or of what
lies at an end of these. The first two are smooth, and a pair touches at the others only where one of the first two
touches too. So the gaps of all corners over faces, while their feet lie on these, and of all edges that cross show when
the pair touches, and which features do. NumPy evaluates all at once; the formulas of those that touch are `FaceGap` and
`EdgeGap`.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import Any, NamedTuple, cast

import msgspec
import numpy as np

from twolink.algorithms.motion import KinematicState
from twolink.algorithms.namespaces import Array
from twolink.algorithms.spatial import IDENTITY, Scalar, Vec, constant, cross, dot, scale, vec
from twolink.geometry.gaps import Ball, Gap, Nearest, Place, PlaneGap, sub, tangents
from twolink.geometry.hulls import edge_sides, hull_of, separation
from twolink.robots.collisions import Box, Convex, Solid

AWAY = 1.0  # m: of features that are not over each other
CLOSED = 1e-9  # m: what counts as no gap, and as over each other where they touch
SIDE = 1e-12  # m: rounding; a corner so far beside a face is over it, and features that overlap by so much more show it
CHUNK = 300_000  # features of states that are evaluated at once, 100 MB
ROUNDING = 1e-14  # of unit vectors
FLAT = 1e-6  # rad: what counts as flat, and as parallel, where features touch


class FaceGap(PlaneGap, frozen=True):
    """From a corner of one body to the plane of a face of the other.

    sides: of the face, the inward normal of each in the axes of the face's link, and its height along it. second: the
    corner is the second body's.
    """

    sides: tuple[tuple[Vec, float], ...]
    second: bool

    def nearest(self, motion: KinematicState) -> Nearest:
        """The corner, and its foot on the face."""
        near = super().nearest(motion)
        if not self.second:
            return near
        n, s, t = near.axes
        return Nearest(near.gap, (scale(-1.0, n), t, s), near.second, near.first)

    def single(self, motion: KinematicState) -> Scalar:
        """Distance of the corner's foot from the nearest side of the face, m; below 0 beside it."""
        apart, xp = sub(self.ball.centre(motion), motion.position(self.frame)), motion.xp
        depths = [dot(motion.direction(self.frame, inward), apart) - height for inward, height in self.sides]
        least = depths[0]
        for depth in depths[1:]:
            least = xp.where(xp.less(depth, least), depth, least)
        return least


class Edge(msgspec.Struct, frozen=True):
    """An edge of a link: its middle, and from there to an end, in the link's axes, m."""

    frame: str
    middle: Vec
    half: Vec


class EdgeGap(Gap, frozen=True):
    """From an edge of one body to an edge of the other that crosses it.

        n = side (u x w) / |u x w|,   g = n . (a - b),   a + s u - b - t w = g n

    first, second: the edges with the middles a, b and the halves u, w. side: +1 or -1, so that n points from the second
    body to the first.
    """

    first: Edge
    second: Edge
    side: float

    def nearest(self, motion: KinematicState) -> Nearest:
        """The nearest points of the lines along the edges."""
        u, w, apart = self._lines(motion)
        s, t = self._along(u, w, apart)
        across = cross(u, w)
        square = dot(across, across)  # a number where neither body turns
        n = scale(self.side / (math.sqrt(square) if constant(square) else motion.xp.sqrt(square)), across)
        ends = (Place(edge.frame, edge.middle, scale(share, line))
                for edge, share, line in ((self.first, s, u), (self.second, t, w)))  # fmt: skip
        return Nearest(dot(n, apart), (n, *tangents(n, motion.xp)), *ends)

    def single(self, motion: KinematicState) -> Scalar:
        """Distance of the nearest points from the ends of the edges, m; below 0 beyond them."""
        xp = motion.xp
        shares = zip((self.first, self.second), self._along(*self._lines(motion)), strict=True)
        s, t = (math.hypot(*edge.half) * (1.0 - xp.where(xp.less(share, 0.0), -share, share)) for edge, share in shares)
        return xp.where(xp.less(s, t), s, t)

    def _lines(self, motion: KinematicState) -> tuple[Vec, Vec, Vec]:
        """u, w and a - b in the world."""
        (a, u), (b, w) = ((motion.position(edge.frame, edge.middle), motion.direction(edge.frame, edge.half))
                          for edge in (self.first, self.second))  # fmt: skip
        return u, w, sub(a, b)

    def _along(self, u: Vec, w: Vec, apart: Vec) -> tuple[Scalar, Scalar]:
        """s and t of the nearest points of the lines."""
        a, b, c, d, e = dot(u, u), dot(u, w), dot(w, w), dot(u, apart), dot(w, apart)
        size: Any = a * c - b * b
        return (b * e - c * d) / size, (a * e - b * d) / size


class Feature(NamedTuple):
    """A feature of a pair that touches: its number, its gap as a formula, where, and the normal from the second."""

    number: int
    gap: Any
    place: np.ndarray
    normal: np.ndarray


class HullFeatures:
    """The features of two hulls: first the corners of the first body with the faces of the second, one corner after
    the other, then the corners of the second with the faces of the first, then the edges of both."""

    def __init__(self, first: Solid, second: Solid) -> None:
        self.bodies = _Body(first), _Body(second)
        a, b = self.bodies
        counts = (
            len(a.corners) * len(b.hull.normals),
            len(b.corners) * len(a.hull.normals),
            len(a.middles) * len(b.middles),
        )
        self.ends = np.cumsum([0, *counts])

    def __len__(self) -> int:
        return int(self.ends[-1])

    def gaps(self, motion: KinematicState, without: Collection[int] = ()) -> Array:
        """The smallest gap (n,) of states of features that are over each other, m; AWAY where there are none.

        Below 0 it is how far the bodies overlap. without: features that do not count.
        """
        r, p = self._relative(motion)
        out = AWAY + self._far(r, p)
        near = np.flatnonzero(out <= AWAY)
        counted = np.ones(len(self), dtype=bool)
        counted[list(without)] = False
        for some in np.array_split(near, 1 + len(near) * len(self) // CHUNK):
            if len(some):
                every = [values.reshape(len(some), -1) for values in self._every_gap(r[some], p[some])]
                kept = np.where(counted, np.concatenate(every, axis=1), AWAY)
                out[some] = kept.min(axis=1)
        return out

    def separation(self, motion: KinematicState) -> float:
        """Distance of the hulls of one state along the direction that shows it best, m; below 0: they overlap."""
        r, p = self._relative(motion)
        return separation(self.bodies[0].hull.placed(r[0], p[0]), self.bodies[1].hull).gap

    def touching(self, motion: KinematicState, reach: float = CLOSED) -> list[list[Feature]]:
        """The features of one state with gaps up to the reach, those together that are at one place with one normal."""
        r, p = self._relative(motion)
        a, b = self.bodies
        back = r.transpose(0, 2, 1)
        found = [*self._touching_corners(motion, reach, 0, _moved(a.corners, r, p)[0], back[0]),
                 *self._touching_corners(motion, reach, 1, _back(b.corners, r, p)[0], r[0])]  # fmt: skip
        edges = _Crossings(a, b, r, p)
        slack = 1.0 + CLOSED / np.minimum(a.lengths[:, None], b.lengths)
        touch = (np.abs(edges.gap) <= reach) & (edges.beyond <= slack) & (edges.outward <= FLAT) & edges.crosses
        for _, i, k in np.argwhere(touch).tolist():
            gap = EdgeGap(a.edge(i), b.edge(k), float(edges.side[0, i, k]))
            found.append(_touching(int(self.ends[2]) + i * len(b.middles) + k, gap, motion))
        groups: list[list[Feature]] = []
        for one in found:
            for group in groups:
                same = np.abs(group[0].place - one.place).max() <= 2 * reach
                if same and float(group[0].normal @ one.normal) > 1.0 - FLAT:
                    group.append(one)
                    break
            else:
                groups.append([one])
        return groups

    def _touching_corners(
        self, motion: KinematicState, reach: float, kind: int, corners: Array, turn: Array
    ) -> list[Feature]:
        """Corners of one body (n, 3) in the axes of the other, on its faces. turn: from these axes to the body's own.

        A corner touches with the normal of a face on whose outer side its body lies.
        """
        own, base = self.bodies[kind], self.bodies[1 - kind]
        on = (np.abs(base.hull.over_faces(corners)) <= reach) & (base.hull.within_sides(corners) >= -CLOSED)
        return [_touching(int(self.ends[kind]) + corner * len(base.hull.normals) + face,
                          base.face_gap(face, own.corner(corner), second=kind == 1), motion)
                for corner, face in np.argwhere(on).tolist()
                if (own.ways[corner] @ (turn @ base.hull.normals[face])).min() >= -FLAT]  # fmt: skip

    def _every_gap(self, r: Array, p: Array) -> list[Array]:
        """The gaps of corners over faces (n, corners, faces), of both, and of edges (n, edges, edges); else AWAY.

        Where the bodies overlap, the feature counts along which they do so least: others lie on the bodies' far sides.
        One that is not over the other then shows that they overlap, but not a rounding of a plane that both lie in.
        """
        a, b = self.bodies
        x, y, edges = _moved(a.corners, r, p), _back(b.corners, r, p), _Crossings(a, b, r, p)
        over_b, over_a, supports = b.hull.over_faces(x), a.hull.over_faces(y), edges.supports(ROUNDING)
        apart = _apart(over_b, over_a, supports)[:, None, None]
        ranges = (b.hull.within_sides(x) >= -SIDE, over_b), (a.hull.within_sides(y) >= -SIDE, over_a), (
            edges.crosses & (edges.beyond <= 1.0 - CLOSED), edges.gap)  # fmt: skip
        return [np.where(np.where(gap < 0.0, (shown >= apart - SIDE) & (over | (gap < -CLOSED)), over), gap, AWAY)
                for (over, gap), shown in zip(ranges, (over_b, over_a, supports), strict=True)]  # fmt: skip

    def _relative(self, motion: KinematicState) -> tuple[Array, Array]:
        """R (n, 3, 3) and p (n, 3) of the first body in the axes of the second."""
        (ra, pa), (rb, pb) = (_placed(motion, body.link) for body in self.bodies)
        turned = rb.transpose(0, 2, 1)
        return turned @ ra, (turned @ (pa - pb)[..., None])[..., 0]

    def _far(self, r: Array, p: Array) -> Array:
        """Distance between spheres around the bodies (n,), m."""
        a, b = self.bodies
        return np.asarray(np.linalg.norm(r @ a.middle + p - b.middle, axis=1) - a.radius - b.radius)


class _Body:
    """A hull in its link's axes.

    corners (V, 3), of each the directions to its neighbours. middles, halves (E, 3), lengths (E,) of edges.
    """

    def __init__(self, solid: Solid) -> None:
        place = solid.shape.placement
        hull = hull_of(cast("Box | Convex", solid.shape)).placed(np.array(place.rotation), np.array(place.translation))
        self.link, self.hull, x = solid.link, hull, hull.vertices
        used = np.unique(hull.edges)
        self.corners = x[used]
        ends = x[hull.edges]
        self.middles, self.halves = ends.mean(axis=1), 0.5 * (ends[:, 1] - ends[:, 0])
        self.lengths = np.linalg.norm(self.halves, axis=1)
        ways = [x[hull.edges[hull.edges[:, side] == i][:, 1 - side]] - x[i] for i in used for side in (0, 1)]
        self.ways = [_units(np.concatenate(pair)) for pair in zip(ways[::2], ways[1::2], strict=True)]
        self.middle = self.corners.mean(axis=0)
        self.radius = float(np.linalg.norm(self.corners - self.middle, axis=1).max())

    def corner(self, i: int) -> Ball:
        """A corner, as a ball without a radius."""
        return Ball(self.link, vec(self.corners[i]), 0.0)

    def edge(self, i: int) -> Edge:
        """An edge."""
        return Edge(self.link, vec(self.middles[i]), vec(self.halves[i]))

    def face_gap(self, i: int, corner: Ball, *, second: bool) -> FaceGap:
        """From a corner to a face."""
        hull, own = self.hull, self.hull.sides_of(i)
        sides = tuple((vec(way), float(depth)) for way, depth in zip(hull.inward[own], hull.depths[own], strict=True))
        return FaceGap(corner, self.link, vec(hull.normals[i]), float(hull.heights[i]), sides, second)


class _Crossings:
    """All pairs of edges of n states, (n, E, E).

    gap: m. side: of the normal, +1 or -1. beyond: the larger of |s| and |t|. crosses: whether they are not parallel.
    outward: how much of a body lies on the wrong side of the normal, as a sine.
    """

    def __init__(self, a: _Body, b: _Body, r: Array, p: Array) -> None:
        u, w = np.einsum("nij,ej->nei", r, a.halves), b.halves
        apart = _moved(a.middles, r, p)[:, :, None] - b.middles
        across = np.cross(u[:, :, None], w)
        length = np.linalg.norm(across, axis=-1)
        self.crosses = length / (a.lengths[:, None] * b.lengths) > FLAT
        across = across / np.maximum(length, 1e-300)[..., None]
        turned = a.hull.normals @ r.transpose(0, 2, 1), a.hull.ways @ r.transpose(0, 2, 1)
        self.side, outward = edge_sides(turned[1], turned[0], a.hull.sides, b.hull.ways, b.hull.normals, b.hull.sides)
        self.outward = outward * a.lengths[:, None] * b.lengths / np.maximum(length, 1e-300)
        self.gap = self.side * np.einsum("nexi,nexi->nex", across, apart)
        uu, uw, ww = np.einsum("nei,nei->ne", u, u)[..., None], u @ w.T, np.einsum("xi,xi->x", w, w)
        d, e = np.einsum("nei,nexi->nex", u, apart), np.einsum("xi,nexi->nex", w, apart)
        size = np.maximum(length**2, 1e-300)
        self.beyond = np.maximum(np.abs(uw * e - ww * d), np.abs(uu * e - uw * d)) / size

    def supports(self, slack: float) -> Array:
        """The gaps of those between which the bodies lie on different sides, up to a slack; -inf of the others."""
        return np.where(self.crosses & (self.outward <= slack), self.gap, -np.inf)


def _apart(over_b: Array, over_a: Array, supports: Array) -> Array:
    """Distance of hulls along the best direction (n,): of the heights of corners over faces, and of edges."""
    faces = [heights.min(axis=1).max(axis=1) for heights in (over_b, over_a)]
    return np.asarray(np.maximum(np.maximum(*faces), supports.max(axis=(1, 2))))


def _touching(feature: int, gap: FaceGap | EdgeGap, motion: KinematicState) -> Feature:
    near = gap.nearest(motion)
    return Feature(feature, gap, *(np.array([float(np.asarray(x).item()) for x in vector])
                                    for vector in (near.first.position(motion), near.axes[0])))  # fmt: skip


def _placed(motion: KinematicState, link: str) -> tuple[Array, Array]:
    """R (n, 3, 3) and the origin (n, 3) of a link."""
    vectors = [*(motion.direction(link, axis) for axis in IDENTITY), motion.position(link)]
    count = max(np.size(x) for vector in vectors for x in vector)
    x, y, z, origin = (np.stack([np.broadcast_to(np.asarray(e, dtype=float).ravel(), (count,)) for e in vector], axis=1)
                       for vector in vectors)  # fmt: skip
    return np.stack([x, y, z], axis=2), origin


def _moved(x: Array, r: Array, p: Array) -> Array:
    """Points (k, 3) of the first body in the axes of the second, (n, k, 3)."""
    return np.asarray(x @ r.transpose(0, 2, 1) + p[:, None])


def _back(x: Array, r: Array, p: Array) -> Array:
    """Points (k, 3) of the second body in the axes of the first, (n, k, 3)."""
    return np.asarray((x - p[:, None]) @ r)


def _units(vectors: Array) -> Array:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1)[:, None])
