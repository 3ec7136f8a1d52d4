"""Convex hulls of boxes and meshes: their faces and edges, how far two of them are apart, and where they touch.

Two convex polyhedra are farthest apart, or overlap least, along the normal of a face of one, or across an edge of each:

    n = side (u x w) / |u x w|

u, w: the edges' directions. Of all pairs of edges only those count between which both bodies lie on different sides of
the plane across n: the arcs that the edges' faces make on the unit sphere cross there. Four signs tell that for each
pair. Where a face has the normal, the face of the other hull that looks at it most is cut to the prism over it. Each
corner of what is left is a point with a gap of its own: a corner of either hull over a face of the other, or two edges
that cross. Sources: Ericson, Real-Time Collision Detection, 2005, sections 5.2.1 and 5.5; Gregorius: The Separating
Axis Test between Convex Polyhedra, GDC 2013.
"""

from __future__ import annotations

import functools
import hashlib
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from twolink.algorithms.namespaces import Array
from twolink.io import cache
from twolink.robots.collisions import Box, Convex, no_volume

FLAT = 1e-9  # of unit normals and, in m, of distances: triangles that are so alike are one face
ROUNDED, SINGLE = 1e-5, 2e-7  # so alike are those of corners that STL files round, to this share of their coordinates
PARALLEL = 1e-6  # the sine between edges below which they count as parallel
FACE_FIRST = 1e-6  # m by which edges must be farther apart, so that faces that lie on each other keep their points
WITHIN = 1e-9  # m: a point so far outside of a prism is within
MANY, VERSION = 200, 4  # vertices of hulls that are kept, and the kind of what is
FEW = 3000  # pairs of edges: of more, those are looked at that look at each other
SLAB = 1e-3  # of a hull's height: so deep below its farthest corner features look that way
Name = tuple[object, ...]


@dataclass(frozen=True)
class Hull:
    """A convex hull.

    vertices (n, 3). faces: of each the vertices in order around its outward normal. normals (faces, 3). heights
    (faces,): of the faces along their normals. edges (edges, 2): vertices. sides (edges, 2): the faces that have an
    edge in this order, and in the other. ways (edges, 3): directions, of length 1. inward (sides, 3), depths (sides,):
    of the sides of all faces the inward directions along the face, and the heights along these; they begin at starts
    (faces,). corners (n,): vertices whose faces and edges are all there.
    """

    vertices: Array
    faces: tuple[Array, ...]
    normals: Array
    heights: Array
    edges: Array
    sides: Array
    ways: Array
    inward: Array
    depths: Array
    starts: Array
    corners: Array

    def placed(self, rotation: Array, origin: Array) -> Hull:
        """The hull in other axes."""
        normals, inward = self.normals @ rotation.T, self.inward @ rotation.T
        return Hull(self.vertices @ rotation.T + origin, self.faces, normals, self.heights + normals @ origin,
                    self.edges, self.sides, self.ways @ rotation.T, inward, self.depths + inward @ origin,
                    self.starts, self.corners)  # fmt: skip

    def towards(self, direction: Array) -> Hull:
        """The hull of all vertices with the faces and edges at those that are farthest in a direction (3,)."""
        heights = self.vertices @ direction
        top = heights >= heights.max() - SLAB * np.ptp(heights)
        kept = top[self.edges].any(axis=1)
        faces = np.unique(self.sides[kept])
        sizes = np.array([len(self.faces[face]) for face in faces.tolist()])
        starts = np.cumsum(sizes) - sizes
        sides = np.repeat(self.starts[faces] - starts, sizes) + np.arange(sizes.sum())
        return Hull(self.vertices, tuple(self.faces[face] for face in faces.tolist()), self.normals[faces],
                    self.heights[faces], self.edges[kept], np.searchsorted(faces, self.sides[kept]), self.ways[kept],
                    self.inward[sides], self.depths[sides], starts, np.flatnonzero(top))  # fmt: skip

    def sides_of(self, face: int) -> slice:
        """The numbers of a face's sides."""
        return slice(int(self.starts[face]), int(self.starts[face]) + len(self.faces[face]))

    def over_faces(self, x: Array) -> Array:
        """The heights (..., faces) of points (..., 3) over the planes of the faces."""
        return np.asarray(x @ self.normals.T - self.heights)

    def within_sides(self, x: Array) -> Array:
        """Distances of points (..., 3) from the nearest side of each face (..., faces), below 0 beside it."""
        return np.asarray(np.minimum.reduceat(x @ self.inward.T - self.depths, self.starts, axis=-1))


@functools.lru_cache(maxsize=256)
def hull_of(shape: Box | Convex) -> Hull:
    """The hull of a shape in the shape's own axes. That of many vertices is kept by its content."""
    if isinstance(shape, Box):
        signs = np.array(np.meshgrid(*[(-0.5, 0.5)] * 3)).reshape(3, -1).T
        return _hull_of_points(signs * np.array(shape.size, dtype=float))
    cloud = np.array(shape.vertices, dtype=float)
    name = f"faces-{VERSION}-{hashlib.sha256(cloud.tobytes()).hexdigest()}" if len(cloud) > MANY else ""
    known = cache.load(name) if name else None
    if known is not None:
        return Hull(**known)
    try:
        hull = _hull_of_points(cloud)
    except (RuntimeError, ValueError):  # Qhull's is the former
        raise no_volume(shape) from None
    if name:
        cache.store(name, vars(hull))
    return hull


def _hull_of_points(cloud: Array) -> Hull:
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    found = _triangles_of(cloud)
    cloud, unlike = found.points, _unlike(found)
    # Triangles of one plane are one face; whose side an edge is on is told by order, which rounding does not change.
    triangle, side = np.nonzero(unlike < FLAT)
    size = len(found.simplices)
    joined = csr_array((np.ones(len(side)), (triangle, found.neighbors[triangle, side])), shape=(size, size))
    count, face_of = connected_components(joined, directed=False)
    owner = {way: int(face_of[number]) for number, corners in enumerate(_in_order(found)) for way in _ways(corners)}
    borders: list[dict[int, int]] = [{} for _ in range(count)]
    for (i, k), face in owner.items():
        if owner[k, i] != face:
            borders[face][i] = k
    normals = found.equations[np.unique(face_of, return_index=True)[1], :3]
    faces = tuple(np.array(_loop(border)) for border in borders)
    edges = np.array(sorted((i, k) for border in borders for i, k in border.items() if i < k))
    sides = np.array([(owner[i, k], owner[k, i]) for i, k in edges.tolist()])
    kept = np.unique(edges)  # no points inside of faces or of the body
    cloud, edges = cloud[kept], np.searchsorted(kept, edges)
    faces = tuple(np.searchsorted(kept, face) for face in faces)
    ways = cloud[edges[:, 1]] - cloud[edges[:, 0]]
    sizes = np.array([len(face) for face in faces])
    starts, corners = np.cumsum(sizes) - sizes, np.concatenate(faces)
    following = np.arange(len(corners)) + 1
    following[starts + sizes - 1] = starts
    ends, after = cloud[corners], cloud[corners[following]]
    inward = np.cross(np.repeat(normals, sizes, axis=0), after - ends)
    inward /= np.linalg.norm(inward, axis=1)[:, None]
    return Hull(cloud, faces, normals, np.einsum("ni,ni->n", normals, cloud[[face[0] for face in faces]]), edges,
                sides, ways / np.linalg.norm(ways, axis=1)[:, None], inward, np.einsum("ni,ni->n", inward, ends),
                starts, np.arange(len(cloud)))  # fmt: skip


def _triangles_of(cloud: Array) -> Any:
    """Qhull's triangles of a cloud, of rounded corners in whole planes.

    Where it is told to, it puts triangles that nearly lie in one plane into one; by their planes faces have holes.
    Corners on edges, which make triangles without height, are left out.
    """
    from scipy.spatial import ConvexHull

    found, rounding = ConvexHull(cloud), SINGLE * np.abs(cloud).max()
    unlike, between = _unlike(found), _between(found, rounding)
    if len(between) or ((unlike > FLAT) & (unlike < ROUNDED)).any():
        found = ConvexHull(cloud, qhull_options=f"Qt C{rounding:.3g}")
        while len(between := _between(found, rounding)):
            found = ConvexHull(np.delete(found.points, between, axis=0), qhull_options=f"Qt C{rounding:.3g}")
    return found


def _unlike(found: Any) -> Array:
    """Distances of the planes of Qhull's triangles from those of their neighbours, (triangles, 3)."""
    return np.asarray(np.abs(found.equations[found.neighbors] - found.equations[:, None]).max(axis=2))


def _between(found: Any, least: float) -> Array:
    """The corners of Qhull's triangles across from a side that they are no farther from than the least, m."""
    x = found.points[found.simplices]
    sides = np.linalg.norm(np.roll(x, -1, axis=1) - np.roll(x, -2, axis=1), axis=2)  # across from each corner
    area = np.linalg.norm(np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]), axis=1)
    flat = np.flatnonzero(area <= least * sides.max(axis=1))
    return np.unique(found.simplices[flat, sides[flat].argmax(axis=1)])


class Separation(NamedTuple):
    """The distance of two hulls, m, below 0 their overlap, along the normal from the second to the first.

    kind: a face of the first or the second hull, or two edges. feature: the face's number, or those of both edges.
    """

    gap: float
    normal: Array
    kind: Literal["first", "second", "edges"]
    feature: tuple[int, ...]


def separation(a: Hull, b: Hull) -> Separation:
    """The separation of two placed hulls."""
    face = separation_by_faces(a, b)
    return separation_by_edges(a, b, face.gap) or face


def facing(a: Hull, b: Hull, normal: Array) -> tuple[Hull, Hull]:
    """The parts of two placed hulls that decide how far they are apart. normal: roughly that between them.

    Of large hulls the features that look at each other are searched alone, again along the normal that these have, as
    long as that brings more: of bodies that are apart there is one largest separation. Of small ones all are.
    """
    if len(a.edges) * len(b.edges) <= FEW:
        return a, b
    parts, gap = (a.towards(-normal), b.towards(normal)), -np.inf
    while (now := separation(*parts)).gap > gap + FLAT:
        gap, parts = now.gap, (a.towards(-now.normal), b.towards(now.normal))
    return parts


def separation_by_faces(a: Hull, b: Hull, second: float = 0.0) -> Separation:
    """The separation along normals of faces. second: by so much more the first hull's must be apart, m."""
    over_a = (b.vertices @ a.normals.T).min(axis=0) - a.heights
    over_b = (a.vertices @ b.normals.T).min(axis=0) - b.heights
    i, k = int(over_a.argmax()), int(over_b.argmax())
    if over_a[i] > over_b[k] + second:
        return Separation(float(over_a[i]), -a.normals[i], "first", (i,))
    return Separation(float(over_b[k]), b.normals[k], "second", (k,))


def separation_by_edges(a: Hull, b: Hull, least: float) -> Separation | None:
    """The separation across edges, where it is more than the least, m."""
    side, outward = edge_sides(a.ways, a.normals, a.sides, b.ways, b.normals, b.sides)
    i, k = np.nonzero(outward <= 0.0)
    across = np.cross(a.ways[i], b.ways[k])
    length = np.sqrt(np.einsum("ni,ni->n", across, across))
    apart = a.vertices[a.edges[i, 0]] - b.vertices[b.edges[k, 0]]
    with np.errstate(divide="ignore", invalid="ignore"):
        gaps = np.where(length > PARALLEL, side[i, k] * np.einsum("ni,ni->n", across, apart) / length, -np.inf)
    if not gaps.max(initial=-np.inf) > least:
        return None
    m = int(gaps.argmax())
    first, second = int(i[m]), int(k[m])
    return Separation(float(gaps[m]), side[first, second] / length[m] * across[m], "edges", (first, second))


def edge_sides(
    u: Array, normals_a: Array, sides_a: Array, w: Array, normals_b: Array, sides_b: Array
) -> tuple[Array, Array]:
    """Of all pairs of edges (..., E, E) the side of n, +1 or -1, and how much of the bodies is on its wrong side.

    The latter as a sine times that between the edges: at most 0 where all of the first body is beyond the second.
    """
    of_a, of_b = normals_a @ np.swapaxes(w, -1, -2), u @ np.swapaxes(normals_b, -1, -2)
    parts = (of_a[..., sides_a[:, 0], :], (-of_a)[..., sides_a[:, 1], :],
             of_b[..., sides_b[:, 0]], (-of_b)[..., sides_b[:, 1]])  # fmt: skip
    most, least = (ufunc(ufunc(*parts[:2]), ufunc(*parts[2:])) for ufunc in (np.maximum, np.minimum))
    return np.where(most <= -least, 1.0, -1.0), np.minimum(most, -least)


def _in_order(found: Any) -> list[tuple[int, int, int]]:
    """The corners of Qhull's triangles in order around their outward normals, passed on from one to its neighbours."""
    x = found.points[found.simplices]
    cross = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    first = int(np.einsum("ni,ni->n", cross, cross).argmax())
    triangles, neighbours = found.simplices.tolist(), found.neighbors.tolist()  # each across from a corner
    i, k, m = triangles[first]
    order = {first: (i, k, m) if cross[first] @ found.equations[first, :3] > 0.0 else (k, i, m)}
    seen = [first]
    for number in seen:
        corners = order[number]
        for (i, k), across in zip(_ways(corners), (corners[2], corners[0], corners[1]), strict=True):
            beside = neighbours[number][triangles[number].index(across)]
            if beside not in order:
                order[beside] = k, i, next(m for m in triangles[beside] if m not in (i, k))
                seen.append(beside)
    return [order[number] for number in range(len(triangles))]


def _ways(corners: tuple[int, int, int]) -> tuple[tuple[int, int], ...]:
    """The sides of a triangle, in order."""
    i, k, m = corners
    return (i, k), (k, m), (m, i)


def _loop(border: dict[int, int]) -> list[int]:
    """The corners of a face in order, from the next one of each."""
    loop = [min(border)]
    while border[loop[-1]] != loop[0]:
        loop.append(border[loop[-1]])
    return loop


class TouchPoint(NamedTuple):
    """A point at which hulls touch: its name, the gap [m], the normal from b to a, and the middle point."""

    name: Name
    gap: float
    normal: Array
    middle: Array


def touching(a: Hull, b: Hull, reach: float) -> list[TouchPoint]:
    """The points with gaps below the reach. Names stay the same while features do.

    Where edges cross, corners over the best face count too: a body that turns a little may land on them.
    """
    face = separation_by_faces(a, b, FACE_FIRST)
    edges = separation_by_edges(a, b, face.gap + FACE_FIRST)
    if (edges or face).gap > reach:
        return []
    found = [] if edges is None else _crossing(a, b, edges, reach)
    hulls, sign = ((a, b), -1.0) if face.kind == "first" else ((b, a), 1.0)
    for name, gap, x in _over_face(*hulls, face.feature[0], face.kind == "second"):
        if gap < reach and not (found and set(name) == set(found[0].name)):
            found.append(TouchPoint((face.kind, *name), gap, face.normal, x - 0.5 * sign * gap * face.normal))
    return found


def _over_face(base: Hull, other: Hull, number: int, second: bool) -> list[tuple[Name, float, Array]]:
    """The corners of the other hull's face within the prism over a face: name, gap and point.

    Of the other hull the face counts that looks at the base's most, of those at its lowest corner. second: the base is
    the second hull.
    """
    normal, loop = base.normals[number], base.faces[number].tolist()
    lowest = int(other.corners[(other.vertices[other.corners] @ normal).argmin()])
    at_it = np.unique(other.sides[(other.edges == lowest).any(axis=1)])
    corners = other.faces[int(at_it[(other.normals[at_it] @ normal).argmin()])].tolist()
    # Of the polygon the corners, and the name of the side after each.
    x, names = other.vertices[corners], [_edge(not second, *ends) for ends in zip(corners, _next(corners), strict=True)]
    inward, depths = base.inward[base.sides_of(number)], base.depths[base.sides_of(number)] - WITHIN
    for side in np.flatnonzero((x @ inward.T < depths).any(axis=0)).tolist():
        x, names = _cut(x, names, x @ inward[side] - depths[side], _edge(second, loop[side], _next(loop)[side]))
    gaps = (x @ normal - base.heights[number]).tolist()
    return [((names[k - 1], names[k]), gap, x[k]) for k, gap in enumerate(gaps)]


def _cut(x: Array, names: list[Name], depths: Array, side: Name) -> tuple[Array, list[Name]]:
    """The part of a polygon with depths that are not negative. side: the name of the side that this makes."""
    kept, after, inside = list[Array](), list[Name](), (depths >= 0.0).tolist()
    for k, name in enumerate(names):
        m = (k + 1) % len(names)
        if inside[k]:
            kept.append(x[k])
            after.append(name)
        if inside[k] != inside[m]:
            kept.append(x[k] + (x[m] - x[k]) * (depths[k] / (depths[k] - depths[m])))
            after.append(side if inside[k] else name)
    return np.array(kept).reshape(-1, 3), after


def _crossing(a: Hull, b: Hull, apart: Separation, reach: float) -> list[TouchPoint]:
    """The nearest points of two edges: p + s u - q - t w = gap n. None where they are farther apart than the reach."""
    ends = [hull.edges[number].tolist() for hull, number in zip((a, b), apart.feature, strict=True)]
    (p, p_end), (q, q_end) = a.vertices[ends[0]], b.vertices[ends[1]]
    u, w = p_end - p, q_end - q
    across_u, across_w = np.cross(u, apart.normal), np.cross(w, apart.normal)
    with np.errstate(all="ignore"):  # of bodies that steps too long have thrown away
        s, t = (q - p) @ across_w / (u @ across_w), (p - q) @ across_u / (w @ across_u)
        x, y = p + np.clip(s, 0.0, 1.0) * u, q + np.clip(t, 0.0, 1.0) * w
        if not (apart.gap < 0.0 or np.linalg.norm(x - y) < reach):
            return []
    return [TouchPoint((_edge(False, *ends[0]), _edge(True, *ends[1])), apart.gap, apart.normal, 0.5 * (x + y))]


def _edge(second: bool, i: int, k: int) -> Name:
    """The name of an edge. second: of the second hull."""
    return second, min(i, k), max(i, k)


def _next(loop: list[int]) -> list[int]:
    """The corner after each of a face."""
    return loop[1:] + loop[:1]
