"""The triangles of a mesh file, read from its bytes.

The readers that Pinocchio has (Assimp, through Coal) take a path and open whatever other files the mesh names. These
take bytes, and open none.
"""

import io

import numpy as np
from numpy.typing import NDArray

from twolink.io.collada import read_collada

Floats = NDArray[np.float64]
Faces = NDArray[np.int64]
SUFFIXES = (".dae", ".stl", ".obj", ".ply", ".off", ".glb")


def read_triangles(raw: bytes, suffix: str) -> tuple[Floats, Faces]:
    """Vertices (n, 3) and faces (m, 3) of a mesh file.

    Parameters
    ----------
    raw : bytes
        The file's content.
    suffix : str
        The ending of its name, such as ".stl": one of SUFFIXES.

    Raises
    ------
    ValueError
        It is not such a file, or has no triangles.
    """
    if suffix == ".dae":
        parts = read_collada(raw)
        vertices = np.concatenate([part.position for part in parts]) if parts else np.empty((0, 3))
        faces = np.arange(len(vertices)).reshape(-1, 3)
    elif suffix in SUFFIXES:
        vertices, faces = _by_trimesh(raw, suffix)
    else:
        raise ValueError(f"{suffix!r} is not one of {', '.join(SUFFIXES)}")
    if not len(faces):
        raise ValueError("it has no triangles")
    if not np.isfinite(vertices).all():
        raise ValueError("a vertex is not finite")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise ValueError("a triangle names a vertex that is not there")
    return vertices, faces


def _by_trimesh(raw: bytes, suffix: str) -> tuple[Floats, Faces]:
    import trimesh

    if suffix == ".obj":
        raw = raw.replace(b"\r\n", b"\n").replace(b"\r", b"\n")  # trimesh does not end lines at \r
    try:
        scene = trimesh.load_scene(io.BytesIO(raw), file_type=suffix[1:], process=False, skip_materials=True)
        mesh = scene.to_mesh()
        return np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64)
    except Exception as error:  # trimesh lets errors of many kinds through
        raise ValueError(str(error) or type(error).__name__) from None
