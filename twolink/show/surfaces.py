"""The surfaces of a robot's visual geometry as triangles with normals and colours, for drawing without a viewer."""

import io
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from twolink.io.files import read_confined
from twolink.io.mesh_files import SUFFIXES, Part
from twolink.robots.meshes import LARGEST
from twolink.show.meshcat_scene import box_corners
from twolink.show.meshcat_shapes import mesh_parts, plain_part, triangles

Floats = NDArray[np.float64]
SEGMENTS = 64  # of round bodies


@dataclass(frozen=True, slots=True)
class TriangleMesh:
    """The m triangles of one piece in its own frame: three corners each."""

    index: int  # the piece's place in GeometryModel.geometryObjects
    triangles: Floats  # (m, 3, 3) m
    normals: Floats  # (m, 3, 3) unit
    colours: Floats  # (m, 3, 3) red, green, blue, 0 to 1

    @property
    def corners(self) -> Floats:
        """(8, 3) m, of the box round the piece."""
        return box_corners(self.triangles.min(axis=(0, 1)), self.triangles.max(axis=(0, 1)))


def surfaces(visuals: Any) -> tuple[list[TriangleMesh], list[str]]:
    """The surfaces of the pin.GeometryModel `visuals`, and the names of pieces that cannot be drawn."""
    drawn, skipped = [], []
    for index, item in enumerate(visuals.geometryObjects):
        parts = list(_parts(visuals, item))
        if parts:
            drawn.append(TriangleMesh(index, *(np.concatenate(arrays) for arrays in zip(*parts, strict=True))))
        else:
            skipped.append(item.name)
    return drawn, skipped


def _parts(visuals: Any, item: Any) -> Iterator[tuple[Floats, Floats, Floats]]:
    """Corners, normals and colours of one pin.GeometryObject; nothing where there is no way to draw it."""
    rgb, path = np.asarray(item.meshColor, float)[:3], Path(item.meshPath)
    parts, scale = mesh_parts(visuals, item), np.asarray(item.meshScale, float)
    if path.suffix.lower() not in SUFFIXES and (made := _primitive(item.geometry)) is not None:
        parts, scale = (plain_part(made.vertices, made.faces),), np.ones(3)
    for part in parts:
        corners = (part.position * scale).reshape(-1, 3, 3)
        yield (
            corners,
            _units(part.normal / scale).reshape(-1, 3, 3),
            _colours(part, path.parent, rgb, item.overrideMaterial),
        )


def _primitive(shape: Any) -> trimesh.Trimesh | None:
    """A coal shape as triangles; None for a kind without a surface."""
    kind, creation = type(shape).__name__, trimesh.creation
    if kind == "Box":
        return creation.box(2.0 * np.asarray(shape.halfSide))
    if kind in ("Sphere", "Ellipsoid"):
        ball = creation.uv_sphere(1.0, count=(SEGMENTS // 2, SEGMENTS))
        radii = np.full(3, shape.radius) if kind == "Sphere" else np.asarray(shape.radii)
        return ball.apply_scale(radii)
    if kind == "Cylinder":
        return creation.cylinder(shape.radius, 2.0 * shape.halfLength, sections=SEGMENTS)
    if kind == "Capsule":
        return creation.capsule(2.0 * shape.halfLength, shape.radius, count=(SEGMENTS // 2, SEGMENTS))
    if kind == "Cone":
        cone = creation.cone(shape.radius, 2.0 * shape.halfLength, sections=SEGMENTS)
        return cone.apply_translation((0.0, 0.0, -shape.halfLength))  # Coal has its middle at the origin
    faces = triangles(shape)
    return None if faces is None else trimesh.Trimesh(*faces, process=False)


def _units(vectors: Floats) -> Floats:
    sizes = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(sizes > 0.0, sizes, 1.0)


def _colours(part: Part, folder: Path, rgb: Floats, override: bool) -> Floats:
    """The colours at the corners of a part: its picture's, its own, or the URDF's."""
    shape = (len(part.position) // 3, 3, 3)
    picture = None if override or part.picture is None else _picture(folder, part.picture)
    if picture is None:
        own = rgb if override or part.rgba is None else np.array(part.rgba[:3])
        return np.broadcast_to(own, shape)
    height, width = picture.shape[:2]
    u, v = part.uv[:, 0] % 1.0, (1.0 - part.uv[:, 1]) % 1.0
    seen = picture[(v * (height - 1)).astype(int), (u * (width - 1)).astype(int)]
    return np.asarray(seen).reshape(shape)


def _picture(folder: Path, name: str) -> Floats | None:
    """A picture (height, width, 3), 0 to 1; None where it cannot be read."""
    from PIL import Image

    try:
        with Image.open(io.BytesIO(read_confined(folder, name, LARGEST))) as image:
            return np.asarray(image.convert("RGB"), float) / 255.0
    except (OSError, ValueError, Image.DecompressionBombError):
        return None
