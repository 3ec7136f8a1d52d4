"""Convex hulls that touch: the points of a face of one over a face of the other, or of two edges that cross.

The pair's normal is the direction in which the hulls are farthest apart, or overlap least, among those of their faces
and of the cross products of their edges (the theorem of separating axes). Where a face wins, the face of the other hull
that looks at it most is cut to the prism over it, and each corner of what is left is a point with a gap of its own.
Source: Ericson, Real-Time Collision Detection, 2005, sections 5.2.1 and 5.5.
"""

from __future__ import annotations

import numpy as np

from twolink.integrate.state import Array
from twolink.robots.hulls import ALIKE, Hull

MOST_EDGES = 40  # directions of edges of a hull up to which their cross products are looked at
FACE_FIRST = 1e-6  # m by which an edge must win, so that faces that lie on each other keep their points
WITHIN = 1e-9  # m: a point so far outside of a prism is within


def touching(a: Hull, b: Hull, reach: float) -> list[tuple[int, float, Array, Array]]:
    """Of the points with gaps below the reach a number, the gap, the normal from b to a, and the middle point."""
    offsets_a = np.einsum("ni,ni->n", a.normals, a.vertices[[face[0] for face in a.faces]])
    offsets_b = np.einsum("ni,ni->n", b.normals, b.vertices[[face[0] for face in b.faces]])
    over_a = (b.vertices @ a.normals.T).min(axis=0) - offsets_a
    over_b = (a.vertices @ b.normals.T).min(axis=0) - offsets_b
    i, k = int(over_a.argmax()), int(over_b.argmax())
    apart = max(over_a[i], over_b[k])
    if apart > reach:
        return []
    crossing = _crossing_edges(a, b, apart + FACE_FIRST)
    if crossing is not None:
        return [crossing] if crossing[1] < reach else []
    # The lower hull's face where both are as good: it does not change from step to step.
    if over_b[k] >= over_a[i] - FACE_FIRST:
        return [(number, gap, b.normals[k], x) for number, gap, x in _over_face(b, k, a, reach)]
    return [(number + (1 << 12), gap, -a.normals[i], x) for number, gap, x in _over_face(a, i, b, reach)]


def _over_face(base: Hull, number: int, other: Hull, reach: float) -> list[tuple[int, float, Array]]:
    """The corners of the other hull's face within the prism over a face: number, gap and middle point."""
    normal, loop = base.normals[number], base.vertices[base.faces[number]]
    facing = other.faces[int((other.normals @ normal).argmin())]
    polygon = [(int(k), other.vertices[k]) for k in facing]
    for side, (p, q) in enumerate(zip(loop, np.roll(loop, -1, axis=0), strict=True)):
        inward = np.cross(normal, q - p)
        inward /= np.linalg.norm(inward)
        polygon = _cut(polygon, inward, float(inward @ p) - WITHIN, 64 * (side + 1))
    found = [(label, float(normal @ (x - loop[0])), x) for label, x in polygon]
    return [(label % (1 << 12), gap, x - 0.5 * gap * normal) for label, gap, x in found if gap < reach]


def _cut(polygon: list[tuple[int, Array]], inward: Array, offset: float, label: int) -> list[tuple[int, Array]]:
    """The part of a polygon on one side of a plane; new corners have numbers of their own."""
    out = []
    depths = [float(inward @ x) - offset for _, x in polygon]
    for k, (number, x) in enumerate(polygon):
        (before, last), depth, d = polygon[k - 1], depths[k], depths[k - 1]
        if (d < 0.0) != (depth < 0.0):
            out.append((label + (before if d < 0.0 else number) % 64, last + (x - last) * (d / (d - depth))))
        if depth >= 0.0:
            out.append((number, x))
    return out


def _crossing_edges(a: Hull, b: Hull, least: float) -> tuple[int, float, Array, Array] | None:
    """The nearest points of two edges, where the hulls are farther apart across them than by `least`."""
    if len(a.directions) > MOST_EDGES or len(b.directions) > MOST_EDGES:
        return None
    axes = np.cross(a.directions[:, None], b.directions[None]).reshape(-1, 3)
    length = np.linalg.norm(axes, axis=1)
    axes = axes[length > ALIKE] / length[length > ALIKE, None]
    axes = np.concatenate([axes, -axes])
    if not len(axes):
        return None
    apart = (a.vertices @ axes.T).min(axis=0) - (b.vertices @ axes.T).max(axis=0)
    best = int(apart.argmax())
    if not apart[best] > least:
        return None
    normal, gap = axes[best], float(apart[best])
    e, f = _edge(a, -normal), _edge(b, normal)
    (p, u), (q, w) = ((hull.vertices[edge[0]], hull.vertices[edge[1]] - hull.vertices[edge[0]])
                      for hull, edge in ((a, e), (b, f)))  # fmt: skip
    # p + s u - q - t w = gap n
    s, t, _ = np.linalg.lstsq(np.stack([u, -w, -normal], axis=1), q - p, rcond=None)[0]
    x, y = p + np.clip(s, 0.0, 1.0) * u, q + np.clip(t, 0.0, 1.0) * w
    return (1 << 13) + int(e[0]) % 64 * 64 + int(f[0]) % 64, gap, normal, 0.5 * (x + y)


def _edge(hull: Hull, along: Array) -> Array:
    """The edge that is farthest along a direction."""
    heights = hull.vertices @ along
    return np.asarray(hull.edges[int((heights[hull.edges[:, 0]] + heights[hull.edges[:, 1]]).argmax())])
