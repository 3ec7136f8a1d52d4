"""Points at which bodies touch height fields: corners, balls, edges, faces, and of cylinders rims, ends and sides."""

from __future__ import annotations

from collections.abc import Iterator
from typing import cast

import numpy as np

from twolink.algorithms.namespaces import Array
from twolink.geometry.fields import FARTHER, LEVEL, SAME, FieldSurface, Spots
from twolink.geometry.hulls import Hull, TouchPoint, hull_of
from twolink.geometry.points import rim_ways
from twolink.robots.collisions import AnyShape, Box, Capsule, Convex, Cylinder

Hit = tuple[int, float, Array, Array]  # the number of a plane or triangle, gap, normal and middle point
BESIDE = 0.1  # of a radius: points of a capsule's end and of its side that are nearer are one
SIDE, RIMS, CROSSINGS = 2, 3, 11  # parts of round bodies behind their ends: a side; four points, and two, of each rim


class FieldBody:
    """A shape as corners (n, 3) with a radius; a capsule has a line between two, and a hull edges and faces.

    The name of a point is the number of the body's part, which are corners or ends, then edges, then faces, or those
    of what is round; and the number of the ridge, the peak, the plane of triangles, or the triangle with the edge.
    """

    def __init__(self, shape: AnyShape) -> None:
        self.hull: Hull | None = None
        self.radius, self.line, self.corners = 0.0, isinstance(shape, (Capsule, Cylinder)), np.zeros((1, 3))
        if isinstance(shape, (Box, Convex)):
            self.hull = hull_of(shape)
            self.corners = self.hull.vertices
        else:
            self.radius, half = float(shape.radius), 0.5 * float(getattr(shape, "length", 0.0))
            self.corners = np.array([[0.0, 0.0, -half], [0.0, 0.0, half]]) if half else self.corners
        self.rims = isinstance(shape, Cylinder)

    def touches(self, surface: FieldSurface, rotation: Array, origin: Array, reach: float) -> list[TouchPoint]:
        """The points at which the placed body touches a surface, with gaps below the reach."""
        corners, near = self.corners @ rotation.T + origin, self.radius + reach
        low, high = corners.min(axis=0) - near, corners.max(axis=0) + near
        if low[2] > surface.top:
            return []
        balls = corners[: 0 if self.rims else len(corners)]
        found = [touch for k, x in enumerate(balls) for touch in _of_corner(surface, k, x, self.radius, reach)]
        if self.line or self.hull:
            spots = surface.spots_in(low, high)
            if self.line:
                sides = [*_of_line(surface, corners, self.radius, spots, reach, rims=self.rims)]
                found = [one for one in found if not self._is_side(surface, one, sides)] + sides
            if self.rims:
                found += _of_rims(surface, corners, self.radius, spots, reach)
            if self.hull is not None and len(spots.ridges):
                hull = self.hull.placed(rotation, origin)
                found += [*_of_edges(surface, hull, spots, reach), *_of_faces(surface, hull, spots, reach)]
        return [touch for touch in found if touch.gap < reach]

    def _is_side(self, surface: FieldSurface, one: TouchPoint, sides: list[TouchPoint]) -> bool:
        """True if a ball touches an edge where the side, which is nearer, does: one point would count twice."""
        on_edge, far = cast(int, one.name[1]) >= surface.planes + surface.plane_of.size, BESIDE * self.radius
        return on_edge and any(np.linalg.norm(one.middle - side.middle) < far for side in sides)


def _each_once(surface: FieldSurface, part: int, hits: list[Hit]) -> Iterator[TouchPoint]:
    """The points of a part with triangles: one of each plane, and one in each direction."""
    seen = list[tuple[int, Array]]()
    for number, gap, n, middle in sorted(hits, key=lambda hit: hit[:2]):
        if not any(number == known or np.abs(n - other).max() < LEVEL for known, other in seen):
            yield TouchPoint((part, surface.planes + number), gap, n, middle)
            seen.append((number, n))


def _of_corner(surface: FieldSurface, part: int, x: Array, radius: float, reach: float) -> Iterator[TouchPoint]:
    """The triangles that a corner or ball touches."""
    below, deep = surface.below(x), surface.height(x)
    cells = surface.cells(x - radius - reach, x + radius + reach)
    triangles, normals = surface.triangles[cells].reshape(-1, 3, 3), surface.normals[cells].reshape(-1, 3)
    if deep - radius > reach and not len(triangles):
        return
    on, heights = surface.nearest(x, cells), np.einsum("ni,ni->n", normals, x - triangles[:, 0])
    numbers = surface.plane_of[cells].ravel()
    if radius > 0.0 and deep > 0.0:
        heights = np.linalg.norm(x - on, axis=1)
        near, ways = heights - radius < reach, (x - on) / heights[:, None]
        found = np.array([k for k in np.flatnonzero(near) if surface.supports(on[k], ways[k])], dtype=int)
        edges = np.abs(ways - normals).max(axis=1) > LEVEL
        numbers = np.where(edges, surface.plane_of.size + surface.numbers[cells].ravel(), numbers)
    else:
        over = np.linalg.norm(x - heights[:, None] * normals - on, axis=1) <= SAME
        over &= (heights - radius < reach) & (heights >= FARTHER * min(deep, 0.0) - SAME)
        found, ways = np.flatnonzero(over), normals
    hits = [(int(numbers[k]), float(heights[k]), ways[k]) for k in found]
    if below is not None and not (radius > 0.0 and deep > 0.0) and (heights[found] > max(deep, 0.0) + SAME).all():
        hits.append((below[2], deep, below[1]))  # none holds it up
    yield from _each_once(surface, part, [(number, far - radius, n, x - 0.5 * (far + radius) * n)
                                          for number, far, n in hits])  # fmt: skip


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
    surface: FieldSurface, ends: Array, radius: float, spots: Spots, reach: float, *, rims: bool
) -> Iterator[TouchPoint]:
    """The ridges and peaks at which the side of a capsule touches, or of a cylinder, which has rims."""
    start, way, edge = ends[0], ends[1] - ends[0], spots.ridges[:, 1] - spots.ridges[:, 0]
    _, t, crosses = (found[0] for found in _lines(start[None], way[None], spots.ridges[:, 0], edge))
    within = crosses & (t > 0.0) & (t < 1.0)
    at = np.concatenate([(spots.ridges[:, 0] + t[:, None] * edge)[within], spots.peaks])
    names = np.concatenate([spots.ridge_numbers[within], spots.peak_numbers]).tolist()
    share = (at - start) @ way / (way @ way)
    for number in np.flatnonzero((share > 0.0) & (share < 1.0)).tolist():
        p = at[number]
        line = start + share[number] * way - p
        far = float(np.linalg.norm(line))
        if rims and radius - far > min(share[number], 1.0 - share[number]) * np.linalg.norm(way):
            continue  # an end is nearer
        if far > SAME and far - radius < reach and surface.supports(p, line / far):
            yield TouchPoint((SIDE, names[number]), far - radius, line / far, p + 0.5 * (far - radius) * line / far)


def _of_edges(surface: FieldSurface, hull: Hull, spots: Spots, reach: float) -> Iterator[TouchPoint]:
    """The edges of a hull that cross ridges."""
    ends, ridges = hull.vertices[hull.edges], spots.ridges
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
            and (gap > -SAME or _is_near(surface, x, ways[i], s[i, k], gap * n, spots.sides[k]))
        ):
            yield TouchPoint((len(hull.vertices) + i, int(spots.ridge_numbers[k])), gap, n, 0.5 * (x + p))


def _is_near(surface: FieldSurface, x: Array, way: Array, share: float, off: Array, sides: Array) -> bool:
    """True if an edge in the ground is nearest to the ridge that it crosses, and not to what lies on its far side.

    Of the edge's points x + k way the deepest one is as far below both sides of the ridge. off: from the ridge to x.
    """
    tilt = sides[0] - sides[1]
    more = -(off @ tilt) / (way @ tilt)
    deepest = sides[0] @ (off + more * way)
    return bool(0.0 <= share + more <= 1.0 and deepest >= FARTHER * surface.height(x + more * way) - SAME)


def _of_faces(surface: FieldSurface, hull: Hull, spots: Spots, reach: float) -> Iterator[TouchPoint]:
    """The faces of a hull that peaks touch."""
    over, within = hull.over_faces(spots.peaks), hull.within_sides(spots.peaks)
    nearest = over >= over.max(axis=1, keepdims=True) - SAME  # not those on the far side of the hull
    for i, face in np.argwhere(nearest & (over < reach) & (within >= 0.0) & (hull.normals[:, 2] < -LEVEL)).tolist():
        n, gap, p = -hull.normals[face], float(over[i, face]), spots.peaks[i]
        if surface.supports(p, n):
            part = len(hull.vertices) + len(hull.edges) + face
            yield TouchPoint((part, int(spots.peak_numbers[i])), gap, n, p + 0.5 * gap * n)


def _of_rims(surface: FieldSurface, ends: Array, radius: float, spots: Spots, reach: float) -> Iterator[TouchPoint]:
    """The points of a cylinder's rims and ends that triangles, ridges and peaks touch. ends: of its axis."""
    for end, (centre, other) in enumerate((ends, ends[::-1])):
        out = (centre - other) / np.linalg.norm(centre - other)
        cells = surface.cells(centre - radius - reach, centre + radius + reach)
        every = surface.normals[cells].reshape(-1, 3)
        normals = every[np.unique(np.round(every, 6), axis=0, return_index=True)[1]]
        down, side = (ways.T for ways in rim_ways(normals.T, out[:, None]))
        for number, ways in enumerate((down, side, -side, -down)):
            hits = (_of_rim_point(surface, x, n) for x, n in zip(centre + radius * ways, normals, strict=True))
            yield from _each_once(surface, RIMS + 4 * end + number, [hit for hit in hits if hit and hit[1] < reach])
        yield from _of_end(surface, end, centre, out, radius, spots, reach)
        yield from _of_rim_on_ridges(surface, end, centre, other, radius, spots, reach)


def _of_rim_point(surface: FieldSurface, x: Array, n: Array) -> Hit | None:
    """A point that touches the triangle below it, if that has the normal n."""
    below = surface.below(x)
    if below is None or np.abs(below[1] - n).max() > LEVEL:
        return None
    gap = float(n @ (x - below[0]))
    return below[2], gap, n, x - 0.5 * gap * n


def _of_end(
    surface: FieldSurface, end: int, centre: Array, out: Array, radius: float, spots: Spots, reach: float
) -> Iterator[TouchPoint]:
    """Peaks below the disc at an end."""
    if out[2] > -LEVEL:
        return
    peaks = spots.peaks
    over = (peaks - centre) @ out  # below 0: in the disc's way
    beside = np.linalg.norm(peaks - centre - over[:, None] * out, axis=1)
    for i in np.flatnonzero((beside < radius) & (over < reach) & (over > beside - radius)).tolist():
        if surface.supports(peaks[i], -out):
            gap = float(over[i])
            yield TouchPoint((end, int(spots.peak_numbers[i])), gap, -out, peaks[i] - 0.5 * gap * out)


def _of_rim_on_ridges(
    surface: FieldSurface, end: int, centre: Array, other: Array, radius: float, spots: Spots, reach: float
) -> Iterator[TouchPoint]:
    """Crossings of ridges and a rim, as seen along the axis. other: the middle of the other end."""
    ridges, length = spots.ridges, float(np.linalg.norm(centre - other))
    out = (centre - other) / length
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
            share = float(np.clip(-b[k] / a[k], 0.0, 1.0))  # of the ridge's deepest point below the side
            beside = FARTHER * (radius - float(np.linalg.norm(start[k] + share * edge[k]))) + SAME
            deep = (x - p) @ out, (centre - ridges[k, 0] - share * way) @ out  # below the end
            tangent = radius * np.cross(out, radial)
            if (
                gap < reach
                and deep[0] < length
                and min(deep) < beside  # else the side has the smaller overlap
                and min(-n @ out, -n @ radial) >= -LEVEL
                and surface.supports(p, n)
                and (gap > -SAME or _is_near(surface, x, tangent, 0.5, x - p, spots.sides[k]))
            ):
                yield TouchPoint((CROSSINGS + 2 * end + number, int(spots.ridge_numbers[k])), gap, n, 0.5 * (x + p))
