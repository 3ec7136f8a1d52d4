"""Hulls of points as mesh files, which is how a URDF can have them."""

from __future__ import annotations

import functools
import hashlib
import tempfile
from pathlib import Path

import numpy as np

from twolink.io import cache
from twolink.io.files import write_atomic
from twolink.robots.collisions import Convex, no_volume


def hull_file(shape: Convex) -> Path:
    """The OBJ file of the hull of a shape's vertices, along its own axes, with faces turned outwards.

    It lies in the cache under a name by its content; without a cache in a folder that goes with this process.

    Raises
    ------
    RobotError
        The hull has no volume (code "flat-shape").
    """
    from scipy.spatial import ConvexHull, QhullError

    try:
        points = np.array(shape.vertices, dtype=float)
        hull = ConvexHull(points)
    except (QhullError, ValueError, IndexError):
        raise no_volume(shape) from None
    used = np.sort(hull.vertices)
    corners, faces = points[used], np.searchsorted(used, hull.simplices)
    edges = corners[faces[:, 1:]] - corners[faces[:, :1]]
    inwards = (np.cross(edges[:, 0], edges[:, 1]) * hull.equations[:, :3]).sum(axis=1) < 0.0
    faces[inwards] = faces[inwards][:, ::-1]
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in corners.tolist()]
    lines += [f"f {i} {j} {k}" for i, j, k in (faces + 1).tolist()]
    content = "\n".join(lines).encode() + b"\n"
    path = (cache.folder() or Path(_own_folder().name)) / f"hull-{hashlib.sha256(content).hexdigest()[:32]}.obj"
    if not (path.is_file() and path.read_bytes() == content):
        write_atomic(path, lambda file: file.write(content), private=True)
    return path


@functools.cache
def _own_folder() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix="twolink-")
