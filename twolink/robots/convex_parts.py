"""Concave meshes as convex parts that touch on their own, by CoACD, kept by content.

Source: Wei, Liu, Ling, Su: Approximate convex decomposition for 3D meshes with collision-aware concavity and tree
search, ACM Transactions on Graphics 41 (4), 2022.
"""

from __future__ import annotations

import functools
import hashlib
from dataclasses import replace
from importlib.metadata import version

import numpy as np

from twolink.errors import RobotError, ShowError, require_extra
from twolink.io import cache
from twolink.io.mesh_files import Floats, read_triangles
from twolink.robots.collisions import Convex, Solid

VERSION = 1  # of parts that are kept


def convex_parts(solid: Solid, concavity: float) -> tuple[Solid, ...]:
    """A mesh as convex parts of its name; what is less hollow than the concavity [m] stays one.

    Raises MissingExtraError without CoACD, and RobotError for a mesh that it cannot cut.
    """
    if solid.mesh is None or solid.hollow <= concavity:
        return (solid,)
    mesh = solid.mesh
    require_extra("coacd", "decomposition")
    try:
        parts = _cut(*mesh.read(), tuple(map(float, mesh.scale.split())), concavity, version("coacd"))
    except (OSError, ValueError, RuntimeError, ShowError) as error:
        raise RobotError(f"the mesh {mesh.path.name!r} cannot be cut into convex parts: {error}",
                         where=f"collision {solid.name!r}", code="mesh-not-readable",
                         remedy="close it, leave concavity= out, or give shapes= to Contact") from None  # fmt: skip
    at = {key: getattr(solid.shape, key) for key in ("point", "rpy")}
    return tuple(replace(solid, shape=Convex(tuple(map(tuple, part.tolist())), **at), hollow=0.0) for part in parts)


@functools.lru_cache(maxsize=64)
def _cut(raw: bytes, suffix: str, scale: tuple[float, ...], concavity: float, release: str) -> list[Floats]:
    """The corners (n, 3) of the parts, each."""
    key = repr((VERSION, release, suffix, scale, concavity)).encode()
    name = f"parts-{hashlib.sha256(key + raw).hexdigest()}"
    known = cache.load(name)
    if known is not None:
        return known  # type: ignore[no-any-return]
    import coacd
    from scipy.spatial import ConvexHull, QhullError

    vertices, faces = read_triangles(raw, suffix)
    # Corners that triangles share are one; a scale that mirrors turns the faces around.
    vertices, number = np.unique(np.asarray(vertices) * scale, axis=0, return_inverse=True)
    faces = number.reshape(-1)[np.asarray(faces)][:, :: -1 if np.prod(scale) < 0 else 1]
    coacd.set_log_level("error")
    parts = list[Floats]()
    for corners, _ in coacd.run_coacd(coacd.Mesh(vertices, faces), threshold=concavity, real_metric=True, seed=0):
        try:
            parts.append(np.unique(corners[ConvexHull(corners).vertices], axis=0))
        except QhullError:  # a splinter without volume
            continue
    if not parts:
        raise ValueError("it encloses no volume")
    cache.store(name, parts)
    return parts
