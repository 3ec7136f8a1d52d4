"""The sizes of a link's shapes: their corners in the link's frame, and their volume."""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pinocchio as pin

from twolink.io.mesh_files import is_closed, read_triangles
from twolink.io.text import parse_number
from twolink.robots.meshes import MeshFolders
from twolink.robots.xml import Element

_LARGEST = 2**22  # bytes of a mesh that is read for its size
_MOST = 1e60  # m: squares of more overflow
_READ = (".stl", ".obj")  # Collada takes too long
_CUBE = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))


Size = tuple[np.ndarray, float]
"""The corners (8, 3) of the box around a shape, m, and its volume, m^3."""


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


@dataclass(frozen=True)
class Shapes:
    """The shapes of the links of a file, each mesh measured once. folders: of its meshes."""

    folders: MeshFolders
    _meshes: dict[str, Size | None] = field(default_factory=dict)

    def extent(self, link: Element, tags: tuple[str, ...]) -> Extent:
        """The shapes of a link's collisions or visuals, or both; the volume is that of all, or not known."""
        each = [self._of(body) for tag in tags for body in link.all(tag)]
        whole, known = all(one.whole for one in each), all(one.volume > 0 or not one for one in each)
        volume = sum(one.volume for one in each) if whole and known else 0.0
        return Extent(np.concatenate([np.empty((0, 3)), *(one.points for one in each)]), volume, whole)

    def _of(self, body: Element) -> Extent:
        """The shape of a visual or collision."""
        shape = next((part for geometry in body.all("geometry") for part in geometry.children), None)
        found = None if shape is None else self._mesh(shape) if shape.tag == "mesh" else _plain(shape)
        if found is None:
            return Extent(np.empty((0, 3)), 0.0, False)
        place = placement(body)
        return Extent(found[0] @ place.rotation.T + place.translation, found[1], True)

    def _mesh(self, mesh: Element) -> Size | None:
        """The corners around a mesh, and its volume; None where it is not read."""
        name = mesh.attributes.get("filename", "")
        if name not in self._meshes:
            found = self.folders.find(name)
            self._meshes[name] = None if found is None else _measured(found[0])
        sized, scale = self._meshes[name], _numbers(mesh, "scale", 3, 1.0)
        return None if sized is None else (sized[0] * scale, abs(float(np.prod(scale))) * sized[1])


def placement(element: Element) -> pin.SE3:
    """The place of an element by its <origin>."""
    xyz, rpy = (_numbers(element.first("origin"), key, 3) for key in ("xyz", "rpy"))
    return pin.SE3(pin.rpy.rpyToMatrix(*rpy), xyz)


def floats(text: str) -> list[float]:
    """The numbers of a text; none where a part of it is no number."""
    try:
        return [parse_number(part) for part in text.split()]
    except ValueError:
        return []


def _numbers(element: Element | None, key: str, count: int, default: float = 0.0) -> np.ndarray:
    """Numbers of a shape, which strict reading leaves alone; the default where they are none."""
    values = np.array(floats(element.attributes.get(key, "") if element else ""))
    return values if len(values) == count and (np.abs(values) < _MOST).all() else np.full(count, default)


def _plain(shape: Element) -> Size | None:
    """The corners around a shape that is no mesh, and its volume; None for what is not known."""
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
    return None


def _measured(path: Path) -> Size | None:
    """The size of a mesh file, its volume 0 where it is open; None for what is not read."""
    suffix = path.suffix.lower()
    try:
        if suffix not in _READ or path.stat().st_size > _LARGEST:
            return None
        vertices, faces = read_triangles(path.read_bytes(), suffix)
    except (OSError, ValueError):
        return None
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    corners = vertices[faces]
    volume = abs(float(np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6))
    return (low + high) / 2 + _CUBE * (high - low), volume * is_closed(vertices, faces)


def meshes(link: Element) -> Iterator[Element]:
    """The meshes of a link's visuals and collisions."""
    for body in (*link.all("visual"), *link.all("collision")):
        for geometry in body.all("geometry"):
            yield from geometry.all("mesh")
