"""Convex hulls that touch: the points of a face of one over a face of the other, or of two edges that cross.

The pair's normal is the direction of the hulls' separation. Where a face has it, the face of the other hull that looks
at it most is cut to the prism over it, and each corner of what is left is a point with a gap of its own. Source:
Ericson, Real-Time Collision Detection, 2005, section 5.5.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from twolink.contact.multibody import cross
from twolink.integrate.state import Array
from twolink.robots.hulls import Hull, Separation, separation_by_edges, separation_by_faces

FACE_FIRST = 1e-6  # m by which edges must be farther apart, so that faces that lie on each other keep their points
WITHIN = 1e-9  # m: a point so far outside of a prism is within
Name = tuple[object, ...]


class Touch(NamedTuple):
    """A point at which hulls touch: its name, the gap [m], the normal from b to a, and the middle point."""

    name: Name
    gap: float
    normal: Array
    middle: Array


def touching(a: Hull, b: Hull, reach: float) -> list[Touch]:
    """The points with gaps below the reach. Names stay the same while features do.

    Where edges cross, corners over the best face count too: a body that turns a little may land on them.
    """
    face = separation_by_faces(a, b, FACE_FIRST)
    edges = separation_by_edges(a, b, face.gap + FACE_FIRST)
    if (edges or face).gap > reach:
        return []
    found = [] if edges is None else [_crossing(a, b, edges)]
    hulls, sign = ((a, b), -1.0) if face.kind == "first" else ((b, a), 1.0)
    for name, gap, x in _over_face(*hulls, face.feature[0], face.kind == "second"):
        if gap < reach and not (found and set(name) == set(found[0].name)):
            found.append(Touch((face.kind, *name), gap, face.normal, x - 0.5 * sign * gap * face.normal))
    return found


def _over_face(base: Hull, other: Hull, number: int, second: bool) -> list[tuple[Name, float, Array]]:
    """The corners of the other hull's face within the prism over a face: name, gap and point.

    Of the other hull the face counts that looks at the base's most, of those at its lowest corner. second: the base is
    the second hull.
    """
    normal, loop = base.normals[number], base.faces[number].tolist()
    lowest = int((other.vertices @ normal).argmin())
    at_it = np.unique(other.sides[(other.edges == lowest).any(axis=1)])
    corners = other.faces[int(at_it[(other.normals[at_it] @ normal).argmin()])].tolist()
    # Of the polygon the corners, and the name of the side after each.
    x, names = other.vertices[corners], [_edge(not second, *ends) for ends in zip(corners, _next(corners), strict=True)]
    ends = base.vertices[loop]
    inward = cross(normal, base.vertices[_next(loop)] - ends)
    inward /= np.sqrt(np.einsum("ni,ni->n", inward, inward))[:, None]
    depths = np.einsum("ni,ni->n", inward, ends) - WITHIN
    for side in np.flatnonzero((x @ inward.T < depths).any(axis=0)).tolist():
        x, names = _cut(x, names, x @ inward[side] - depths[side], _edge(second, loop[side], _next(loop)[side]))
    gaps = ((x - ends[0]) @ normal).tolist()
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


def _crossing(a: Hull, b: Hull, apart: Separation) -> Touch:
    """The nearest points of two edges: p + s u - q - t w = gap n."""
    ends = [hull.edges[number].tolist() for hull, number in zip((a, b), apart.feature, strict=True)]
    (p, p_end), (q, q_end) = a.vertices[ends[0]], b.vertices[ends[1]]
    u, w = p_end - p, q_end - q
    s, t, _ = np.linalg.solve(np.stack([u, -w, -apart.normal], axis=1), q - p)
    x, y = p + np.clip(s, 0.0, 1.0) * u, q + np.clip(t, 0.0, 1.0) * w
    return Touch((_edge(False, *ends[0]), _edge(True, *ends[1])), apart.gap, apart.normal, 0.5 * (x + y))


def _edge(second: bool, i: int, k: int) -> Name:
    """The name of an edge. second: of the second hull."""
    return second, min(i, k), max(i, k)


def _next(loop: list[int]) -> list[int]:
    """The corner after each of a face."""
    return loop[1:] + loop[:1]
