"""Points at which bodies touch height fields: corners, balls, edges, faces, and of cylinders rims, ends and sides."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from twolink.algorithms.namespaces import Array
from twolink.algorithms.spatial import across
from twolink.geometry.fields import FARTHER, LEVEL, SAME, FieldSurface
from twolink.geometry.hulls import Hull, TouchPoint, hull_of
from twolink.robots.collisions import AnyShape, Box, Capsule, Convex, Cylinder, Sphere


class FieldBody:
    """A shape as corners (n, 3) with a radius; a capsule has a line between two, and a hull edges and faces."""

    def __init__(self, shape: AnyShape) -> None:
        self.hull: Hull | None = None
        self.radius, self.line, self.corners = 0.0, isinstance(shape, (Capsule, Cylinder)), np.zeros((1, 3))
        if isinstance(shape, (Box, Convex)):
            self.hull = hull_of(shape)
            self.corners = self.hull.vertices[np.unique(self.hull.edges)]
        elif isinstance(shape, (Sphere, Capsule, Cylinder)):
            self.radius, half = float(shape.radius), 0.5 * float(getattr(shape, "length", 0.0))
            self.corners = np.array([[0.0, 0.0, -half], [0.0, 0.0, half]]) if half else self.corners
        self.rims, self.is_ball = isinstance(shape, Cylinder), isinstance(shape, Sphere)

    def touches(self, surface: FieldSurface, rotation: Array, origin: Array, reach: float) -> list[TouchPoint]:
        """The points at which the placed body touches a surface, with gaps below the reach."""
        corners, near = self.corners @ rotation.T + origin, self.radius + reach
        low, high = corners.min(axis=0) - near, corners.max(axis=0) + near
        if low[2] > surface.top:
            return []
        balls = corners[: 0 if self.rims else len(corners)]
        found = [touch for k, x in enumerate(balls) for touch in self._of_corner(surface, k, x, reach)]
        ridges = surface.ridges_in(low, high) if self.line or self.hull else surface.ridges[:0]
        peaks = np.unique(ridges.reshape(-1, 3), axis=0) if len(ridges) else np.empty((0, 3))
        if self.line and len(ridges):
            found += _of_line(surface, corners, self.radius, ridges, peaks, rims=self.rims)
        if self.rims:
            found += _of_rims(surface, corners, self.radius, ridges, peaks, reach)
        if self.hull is not None and len(ridges):
            hull = self.hull.placed(rotation, origin)
            found += [*_of_edges(surface, hull, ridges, reach), *_of_faces(surface, hull, peaks, reach)]
        return [touch for touch in found if touch.gap < reach]

    def _of_corner(self, surface: FieldSurface, number: int, x: Array, reach: float) -> Iterator[TouchPoint]:
        """The triangles that a corner or ball touches, each plane once."""
        below, deep = surface.below(x), surface.height(x)
        cells, seen = surface.cells(x - self.radius - reach, x + self.radius + reach), list[Array]()
        triangles, normals = surface.triangles[cells].reshape(-1, 3, 3), surface.normals[cells].reshape(-1, 3)
        if deep - self.radius > reach and not len(triangles):
            return
        on, heights = surface.nearest(x, cells), np.einsum("ni,ni->n", normals, x - triangles[:, 0])
        if self.radius > 0.0 and deep > 0.0:
            far = np.linalg.norm(x - on, axis=1)
            rows = np.flatnonzero(far - self.radius < reach)
            ways = (x - on) / far[:, None]
            hits = [(float(far[k]), ways[k]) for k in rows if surface.supports(on[k], ways[k])]
        else:
            over = np.linalg.norm(x - heights[:, None] * normals - on, axis=1) <= SAME
            over &= (heights - self.radius < reach) & (heights >= FARTHER * min(deep, 0.0) - SAME)
            hits = [(float(heights[k]), normals[k]) for k in np.flatnonzero(over)]
            if below is not None and not hits:
                hits = [(deep, below[1])]
        for far_off, n in sorted(hits, key=lambda hit: tuple(np.round(hit[1], 6))):
            if not any(np.abs(n - other).max() < LEVEL for other in seen):
                seen.append(n)
                gap = far_off - self.radius
                yield TouchPoint(("corner", number, len(seen)), gap, n, x - (self.radius + 0.5 * gap) * n)


def _lines(starts: Array, ways: Array, others: Array, other_ways: Array) -> tuple[Array, Array, Array]:
    """s and t (n, m) of the points start + s way of lines that are nearest to each other; and where they cross."""
    apart = starts[:, None] - others
    a, c = (np.einsum("ni,ni->n", way, way) for way in (ways, other_ways))
    b, d, e = ways @ other_ways.T, np.einsum("ni,nmi->nm", ways, apart), np.einsum("mi,nmi->nm", other_ways, apart)
    size = a[:, None] * c - b * b
    crosses = size > LEVEL**2 * a[:, None] * c
    size = np.where(crosses, size, 1.0)
    return (b * e - c * d) / size, (a[:, None] * e - b * d) / size, crosses


def _of_line(
    surface: FieldSurface, ends: Array, radius: float, ridges: Array, peaks: Array, *, rims: bool
) -> Iterator[TouchPoint]:
    """The ridges and their ends at which the side of a capsule touches, or of a cylinder, which has rims."""
    start, way, edge = ends[0], ends[1] - ends[0], ridges[:, 1] - ridges[:, 0]
    _, t, crosses = (found[0] for found in _lines(start[None], way[None], ridges[:, 0], edge))
    spots = np.concatenate([(ridges[:, 0] + t[:, None] * edge)[crosses & (t > 0.0) & (t < 1.0)], peaks])
    share = (spots - start) @ way / (way @ way)
    for number in np.flatnonzero((share > 0.0) & (share < 1.0)).tolist():
        p = spots[number]
        line = start + share[number] * way - p
        far = float(np.linalg.norm(line))
        if rims and radius - far > min(share[number], 1.0 - share[number]) * np.linalg.norm(way):
            continue  # an end is nearer
        if far > SAME and surface.supports(p, line / far):
            yield TouchPoint(("side", *np.round(p, 6)), far - radius, line / far, p + 0.5 * (far - radius) * line / far)


def _of_edges(surface: FieldSurface, hull: Hull, ridges: Array, reach: float) -> Iterator[TouchPoint]:
    """The edges of a hull that cross ridges."""
    ends = hull.vertices[hull.edges]
    ways, edge = ends[:, 1] - ends[:, 0], ridges[:, 1] - ridges[:, 0]
    s, t, crosses = _lines(ends[:, 0], ways, ridges[:, 0], edge)
    within = crosses & (s >= 0.0) & (s <= 1.0) & (t >= 0.0) & (t <= 1.0)
    on_left, on_right = hull.normals[hull.sides[:, 0]], hull.normals[hull.sides[:, 1]]
    for i, k in np.argwhere(within).tolist():
        n = np.cross(ways[i], edge[k])
        n /= np.copysign(np.linalg.norm(n), n[2])
        x, p = ends[i, 0] + s[i, k] * ways[i], ridges[k, 0] + t[i, k] * edge[k]
        down = (np.cross(on_left[i], -n) @ hull.ways[i], np.cross(-n, on_right[i]) @ hull.ways[i])
        gap = float(n @ (x - p))
        if (
            gap < reach
            and n[2] > LEVEL
            and min(down) >= -LEVEL
            and surface.supports(p, n)
            and (gap > -SAME or gap >= FARTHER * surface.height(x) - SAME)
        ):
            yield TouchPoint(("edge", i, *np.round(ridges[k].mean(axis=0), 6)), gap, n, 0.5 * (x + p))


def _of_faces(surface: FieldSurface, hull: Hull, peaks: Array, reach: float) -> Iterator[TouchPoint]:
    """The faces of a hull that peaks touch."""
    over, within = hull.over_faces(peaks), hull.within_sides(peaks)
    nearest = over >= over.max(axis=1, keepdims=True) - SAME  # not those on the far side of the hull
    for i, face in np.argwhere(nearest & (over < reach) & (within >= 0.0) & (hull.normals[:, 2] < -LEVEL)).tolist():
        n, gap = -hull.normals[face], float(over[i, face])
        if surface.supports(peaks[i], n):
            yield TouchPoint(("face", face, *np.round(peaks[i], 6)), gap, n, peaks[i] + 0.5 * gap * n)


def _of_rims(
    surface: FieldSurface, ends: Array, radius: float, ridges: Array, peaks: Array, reach: float
) -> Iterator[TouchPoint]:
    """The points of a cylinder's rims and ends that triangles, ridges and peaks touch. ends: of its axis."""
    for end, (centre, other) in enumerate((ends, ends[::-1])):
        out = (centre - other) / np.linalg.norm(centre - other)
        cells = surface.cells(centre - radius - reach, centre + radius + reach)
        seen = list[Array]()
        for n in surface.normals[cells].reshape(-1, 3):
            if any(np.abs(n - other_n).max() < LEVEL for other_n in seen):
                continue
            seen.append(n)
            down = (n @ out) * out - n
            size = float(np.linalg.norm(down))
            down = down / size if size > SAME else np.array(across(tuple(out))[0])
            side = np.cross(out, down)
            for number, way in enumerate((down, side, -side, -down)):
                yield from _of_rim_point(
                    surface, ("rim", end, number, *np.round(n, 6)), centre + radius * way, n, reach
                )
        yield from _of_end(surface, end, centre, out, radius, peaks, reach)
        yield from _of_rim_on_ridges(surface, end, centre, out, radius, ridges, reach)


def _of_rim_point(
    surface: FieldSurface, name: tuple[Any, ...], x: Array, n: Array, reach: float
) -> Iterator[TouchPoint]:
    """A point that touches the triangle with the normal n below it."""
    below = surface.below(x)
    if below is None or np.abs(below[1] - n).max() > LEVEL:
        return
    gap = float(n @ (x - below[0]))
    if gap < reach:
        yield TouchPoint(name, gap, n, x - 0.5 * gap * n)


def _of_end(
    surface: FieldSurface, end: int, centre: Array, out: Array, radius: float, peaks: Array, reach: float
) -> Iterator[TouchPoint]:
    """Peaks below the disc at an end."""
    if out[2] > -LEVEL:
        return
    over = (peaks - centre) @ out  # below 0: in the disc's way
    beside = np.linalg.norm(peaks - centre - over[:, None] * out, axis=1) if len(peaks) else over
    for i in np.flatnonzero((beside < radius) & (over < reach) & (over > beside - radius)):
        if surface.supports(peaks[i], -out):
            gap = float(over[i])
            yield TouchPoint(("end", end, *np.round(peaks[i], 6)), gap, -out, peaks[i] - 0.5 * gap * out)


def _of_rim_on_ridges(
    surface: FieldSurface, end: int, centre: Array, out: Array, radius: float, ridges: Array, reach: float
) -> Iterator[TouchPoint]:
    """Crossings of ridges and a rim, as seen along the axis."""
    flat = ridges - centre - ((ridges - centre) @ out)[..., None] * out
    start, edge = flat[:, 0], flat[:, 1] - flat[:, 0]
    a, b = np.einsum("ni,ni->n", edge, edge), np.einsum("ni,ni->n", start, edge)
    inner = b * b - a * (np.einsum("ni,ni->n", start, start) - radius**2)
    for k in np.flatnonzero((inner > 0.0) & (a > SAME**2)):
        way = ridges[k, 1] - ridges[k, 0]
        for number, root in enumerate((-1.0, 1.0)):
            share = (-b[k] + root * np.sqrt(inner[k])) / a[k]
            radial = (start[k] + share * edge[k]) / radius
            n = np.cross(np.cross(out, radial), way)
            size = float(np.linalg.norm(n))
            if not (0.0 <= share <= 1.0 and size > LEVEL * float(np.linalg.norm(way))):
                continue
            n *= np.copysign(1.0 / size, n[2])
            x, p = centre + radius * radial, ridges[k, 0] + share * way
            gap = float(n @ (x - p))
            inside = start[k] + np.clip(-b[k] / a[k], 0.0, 1.0) * edge[k]
            beside = FARTHER * (radius - float(np.linalg.norm(inside)))  # else the side has the smaller overlap
            if (
                gap < reach
                and (x - p) @ out < beside + SAME
                and min(-n @ out, -n @ radial) >= -LEVEL
                and surface.supports(p, n)
            ):
                yield TouchPoint(
                    ("rim on ridge", end, number, *np.round(ridges[k].mean(axis=0), 6)), gap, n, 0.5 * (x + p)
                )
