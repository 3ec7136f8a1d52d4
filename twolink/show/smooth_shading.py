"""Normals of triangle meshes that look round over flat edges."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
SMOOTH = 0.7  # rad: edges between triangles that turn by less look round


def shaded_triangles(vertices: Floats, faces: NDArray[np.integer]) -> tuple[Floats, Floats]:
    """The corners (m, 3, 3) of triangles, from vertices (n, 3) and faces (m, 3), and unit normals (m, 3, 3) there."""
    import trimesh  # 0.5 s: only where a mesh is drawn

    merged = trimesh.Trimesh(vertices, faces, process=True)
    shaded = trimesh.graph.smooth_shade(merged, angle=SMOOTH)
    corners, normals = (np.asarray(x)[shaded.faces] for x in (shaded.vertices, shaded.vertex_normals))
    return corners, normals
