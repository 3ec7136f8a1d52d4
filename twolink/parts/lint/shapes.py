"""The sizes of a link's shapes: their corners in the link's frame, and their volume."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import pinocchio as pin

from twolink.io.mesh_files import read_triangles
from twolink.robots.meshes import MeshFolders
from twolink.robots.xml import Element

_LARGEST = 2**22  # bytes of a mesh that is read for its size
_MOST = 1e60  # m: squares of more overflow
_READ = (".stl", ".obj")  # Collada takes too long
_CUBE = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))


@dataclass(frozen=True)
class Extent:
    """The shapes of a link: `points` (n, 3) on their hull in its frame, m, and their volume, m^3, 0 if not known.

    whole: False where a mesh was not read.
    """

    points: np.ndarray
    volume: float
    whole: bool

    def __bool__(self) -> bool:
        return bool(len(self.points)) or not self.whole

    @property
    def half_diagonal(self) -> float:
        """Half the diagonal of the box around the points, m."""
        return float(np.linalg.norm(np.ptp(self.points, axis=0)) / 2) if len(self.points) else 0.0

    def beside(self, point: np.ndarray) -> float:
        """The distance of a point from the box around the points, m."""
        low, high = self.points.min(axis=0), self.points.max(axis=0)
        return float(np.linalg.norm(np.maximum(0, np.maximum(low - point, point - high))))

    def largest_moments(self, point: np.ndarray) -> np.ndarray:
        """The largest moments (3,) that 1 kg within the box can have about the axes through a point, m^2."""
        far = np.maximum(np.abs(self.points - point), 0).max(axis=0) ** 2
        return np.asarray(far.sum() - far)


def extent(link: Element, folders: MeshFolders, tags: tuple[str, ...]) -> Extent:
    """The shapes of a link's collisions or visuals."""
    points, volume, whole = [np.empty((0, 3))], 0.0, True
    for tag in tags:
        for body in link.all(tag):
            found = _shape(body, folders)
            if found is None:
                whole = False
                continue
            corners, own = found
            volume += own
            points.append(corners @ _turn(body).T + _numbers(body.first("origin"), "xyz", 3))
    return Extent(np.concatenate(points), volume if whole else 0.0, whole)


def _turn(body: Element) -> np.ndarray:
    return np.asarray(pin.rpy.rpyToMatrix(*_numbers(body.first("origin"), "rpy", 3)))


def _numbers(element: Element | None, key: str, count: int, default: float = 0.0) -> np.ndarray:
    """Numbers of a shape, which strict reading leaves alone; the default where they are none."""
    try:
        values = np.array((element.attributes[key] if element else "").split(), dtype=float)
    except (KeyError, ValueError):
        values = np.empty(0)
    return values if len(values) == count and (np.abs(values) < _MOST).all() else np.full(count, default)


def _shape(body: Element, folders: MeshFolders) -> tuple[np.ndarray, float] | None:
    """The corners around a shape, and its volume; None for what is not read."""
    shape = next((part for geometry in body.all("geometry") for part in geometry.children), None)
    if shape is None:
        return None
    radius, length = (float(_numbers(shape, key, 1)[0]) for key in ("radius", "length"))
    match shape.tag:
        case "box":
            size = _numbers(shape, "size", 3)
            return _CUBE * size, float(np.prod(size))
        case "sphere":
            return 2 * radius * _CUBE, 4 / 3 * np.pi * radius**3
        case "cylinder" | "capsule":
            ends = 2 * radius * (shape.tag == "capsule")
            return _CUBE * [2 * radius, 2 * radius, length + ends], np.pi * radius**2 * (length + 2 / 3 * ends)
        case "mesh":
            found = folders.find(shape.attributes.get("filename", ""))
            sized = None if found is None else _mesh(found[0])
            scale = _numbers(shape, "scale", 3, 1.0)
            return None if sized is None else (sized[0] * scale, abs(float(np.prod(scale))) * sized[1])
    return None


@lru_cache(maxsize=256)
def _mesh(path: Path) -> tuple[np.ndarray, float] | None:
    """The corners of the box around a mesh, and its volume, 0 where it is open; None for what is not read."""
    if path.suffix.lower() not in _READ or path.stat().st_size > _LARGEST:
        return None
    try:
        vertices, faces = read_triangles(path.read_bytes(), path.suffix.lower())
    except (OSError, ValueError):
        return None
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    corners = vertices[faces]
    volume = abs(float(np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6))
    return (low + high) / 2 + _CUBE * (high - low), volume


def meshes(link: Element) -> Iterator[Element]:
    """The meshes of a link's visuals and collisions."""
    for body in (*link.all("visual"), *link.all("collision")):
        for geometry in body.all("geometry"):
            yield from geometry.all("mesh")
