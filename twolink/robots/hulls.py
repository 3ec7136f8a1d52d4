"""Convex hulls of boxes and meshes: their faces and edges."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twolink.robots.shapes import Box, Convex, no_volume

ALIKE = 1e-6  # of unit vectors that count as one
Array = NDArray[Any]


@dataclass(frozen=True)
class Hull:
    """A convex hull in its own axes: vertices (n, 3), faces with their vertices in order around their normals
    (faces, 3), edges as pairs of vertices (edges, 2), and the different directions of edges (k, 3)."""

    vertices: Array
    faces: tuple[Array, ...]
    normals: Array
    edges: Array
    directions: Array

    def placed(self, rotation: Array, origin: Array) -> Hull:
        """The hull in other axes."""
        return Hull(self.vertices @ rotation.T + origin, self.faces, self.normals @ rotation.T, self.edges,
                    self.directions @ rotation.T)  # fmt: skip


@functools.lru_cache(maxsize=256)
def hull_of(shape: Box | Convex) -> Hull:
    """The hull of a shape in the shape's own axes."""
    from scipy.spatial import ConvexHull, QhullError

    if isinstance(shape, Box):
        signs = np.array(np.meshgrid(*[(-0.5, 0.5)] * 3)).reshape(3, -1).T
        cloud = signs * np.array(shape.size, dtype=float)
    else:
        cloud = np.array(shape.vertices, dtype=float)
    try:
        found = ConvexHull(cloud)
    except (QhullError, ValueError):
        if isinstance(shape, Convex):
            raise no_volume(shape) from None
        raise
    _, first, place = np.unique(np.round(found.equations, 9), axis=0, return_index=True, return_inverse=True)
    normals, faces, edges = found.equations[first, :3], [], set[tuple[int, int]]()
    for number, normal in enumerate(normals):
        corners = np.unique(found.simplices[place.ravel() == number])
        faces.append(_around(cloud, corners, normal))
        edges |= {
            (min(a, b), max(a, b)) for a, b in zip(faces[-1].tolist(), np.roll(faces[-1], -1).tolist(), strict=True)
        }
    pairs = np.array(sorted(edges))
    ways = cloud[pairs[:, 1]] - cloud[pairs[:, 0]]
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    different = [k for k, way in enumerate(ways) if not (np.abs(np.abs(ways[:k] @ way) - 1.0) < ALIKE).any()]
    return Hull(cloud, tuple(faces), normals, pairs, ways[different])


def _around(cloud: Array, corners: Array, normal: Array) -> Array:
    """The corners of a face in order around its normal."""
    points = cloud[corners]
    middle = points.mean(axis=0)
    x = points[0] - middle
    angle = np.arctan2((points - middle) @ np.cross(normal, x), (points - middle) @ x)
    return np.asarray(corners[np.argsort(angle)])
