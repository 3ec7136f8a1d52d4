"""The triangles of mesh files as Coal's geometry in Pinocchio's geometry objects."""

from typing import Any

import coal
import numpy as np

from twolink.errors import ShowError
from twolink.io.confined import read_confined
from twolink.io.mesh_triangles import SUFFIXES, read_triangles
from twolink.io.text import parse_number
from twolink.robots.meshes import MeshFile

LARGEST = 2**28  # bytes of a mesh file


def set_mesh(item: Any, mesh: MeshFile) -> None:
    """Give a pin.GeometryObject the shape of a mesh file.

    Raises
    ------
    ShowError
        Code "mesh-not-readable".
    """
    try:
        scale = tuple(parse_number(part) for part in mesh.scale.split())
        if len(scale) != 3 or not np.isfinite(scale).all():
            raise ValueError(f"its scale is {mesh.scale[:60]!r}, expected 3 numbers")
        item.geometry = _shape(read_confined(mesh.root, mesh.path, LARGEST), mesh.path.suffix.lower(), scale)
    except (OSError, ValueError) as error:
        what = f"the mesh {mesh.path.name!r} cannot be read: {getattr(error, 'strerror', None) or error}"
        remedy = f"repair or convert it (readable: {', '.join(SUFFIXES)}), or take it out of the URDF"
        raise ShowError(what, where=f"visual {item.name!r}", remedy=remedy, code="mesh-not-readable") from None
    item.meshPath, item.meshScale = str(mesh.path), np.array(scale)


def _shape(raw: bytes, suffix: str, scale: tuple[float, ...]) -> coal.CollisionGeometry:
    vertices, faces = read_triangles(raw, suffix)
    shape = coal.BVHModelOBBRSS()
    shape.beginModel(len(faces), len(vertices))
    shape.addVertices(vertices * scale)
    shape.addTriangles(faces)
    shape.endModel()
    return shape
