"""The surfaces of a robot's visual geometry as triangles with normals and colours, for drawing without a viewer."""

import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from twolink.io.files import read_confined
from twolink.io.mesh_files import SUFFIXES, Part, read_collada, read_triangles
from twolink.robots.meshes import LARGEST
from twolink.show.meshcat_scene import box_corners
from twolink.show.meshcat_shapes import parts_read, shaded_triangles, triangles

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
        parts = list(_parts(item, parts_read(visuals, item)))
        if parts:
            drawn.append(TriangleMesh(index, *(np.concatenate(arrays) for arrays in zip(*parts, strict=True))))
        else:
            skipped.append(item.name)
    return drawn, skipped


def _parts(item: Any, parts: Sequence[Part]) -> Iterator[tuple[Floats, Floats, Floats]]:
    """Corners, normals and colours of one pin.GeometryObject; nothing where there is no way to draw it.

    parts: of its Collada file, where they are read already.
    """
    rgb, path = np.asarray(item.meshColor, float)[:3], Path(item.meshPath)
    suffix = path.suffix.lower()
    if suffix in SUFFIXES:
        try:
            raw = b"" if parts else read_confined(path.parent, path.name, LARGEST)
            parts = parts or (read_collada(raw) if suffix == ".dae" else ())
            whole = None if parts else read_triangles(raw, suffix)
        except (OSError, ValueError):
            return
        scale = np.asarray(item.meshScale, float)
        for part in parts:
            corners = (part.position * scale).reshape(-1, 3, 3)
            normals = _units(part.normal / scale).reshape(-1, 3, 3)
            yield corners, normals, _colours(part, path.parent, rgb, item.overrideMaterial)
        if whole is not None:
            yield _one_colour(*shaded_triangles(whole[0] * scale, whole[1]), rgb)
        return
    made = _primitive(item.geometry)
    if made is not None:
        yield _one_colour(*shaded_triangles(made.vertices, made.faces), rgb)


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


def _one_colour(corners: Floats, normals: Floats, rgb: Floats) -> tuple[Floats, Floats, Floats]:
    return corners, normals, np.broadcast_to(rgb, corners.shape)


def _units(vectors: Floats) -> Floats:
    sizes = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(sizes > 0.0, sizes, 1.0)


def _colours(part: Part, folder: Path, rgb: Floats, override: bool) -> Floats:
    """The colours at the corners of a part of a Collada file: its picture's, its own, or the URDF's."""
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
