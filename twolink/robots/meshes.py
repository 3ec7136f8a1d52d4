"""The mesh files that a URDF names: where they are, their triangles as Coal's geometry, and the URDF without those
that are missing.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin

from twolink.errors import ShowError
from twolink.io.files import confining_roots, read_confined
from twolink.io.mesh_files import SUFFIXES, Part, read_collada, read_triangles
from twolink.io.text import parse_number
from twolink.robots.xml import Element, parse_xml

LARGEST = 2**28  # bytes of a mesh file


@dataclass(frozen=True)
class MeshFile:
    """A mesh to draw: its file after all links, the folder that the file must lie in, and its scale along x y z."""

    path: Path
    root: Path
    scale: str

    def read(self) -> tuple[bytes, str]:
        """The content, and the ending of its name in lower case. Raises OSError as `read_confined`."""
        return read_confined(self.root, self.path, LARGEST), self.path.suffix.lower()


@dataclass(frozen=True)
class MeshFolders:
    """Folders searched for meshes: `packages`, which package:// counts from, and `base`, the URDF's own folder.

    roots: the folders that a mesh must lie in after all links, where the URDF comes from a stranger, whose package may
    be the folder itself under another name; None: any.
    """

    packages: tuple[Path, ...]
    base: Path | None
    roots: tuple[Path, ...] | None = None
    _found: dict[str, tuple[Path, Path] | None] = field(default_factory=dict, compare=False)  # by name

    def find(self, name: str) -> tuple[Path, Path] | None:
        """The file that a mesh name means, and the folder it must lie in: package://P/x, file:///x, or beside the URDF.

        None where no such file is allowed.
        """
        if name not in self._found:
            self._found[name] = self._first(name)
        return self._found[name]

    def _first(self, name: str) -> tuple[Path, Path] | None:
        if name.startswith("package://"):
            inside = name.removeprefix("package://")
            names = [inside] if self.roots is None else [inside, inside.partition("/")[2]]
            candidates = [folder / each for folder in self.packages for each in names]
        elif name.startswith("file://"):
            candidates = [Path(name.removeprefix("file://"))]
        else:
            candidates = [Path(name)] if self.base is None else [self.base / name, Path(name)]
        return next((found for path in candidates if (found := self._allowed(path))), None)

    def _allowed(self, path: Path) -> tuple[Path, Path] | None:
        try:
            if not path.is_file():  # most are not, and links take longer to resolve
                return None
            real = path.resolve()
            roots = [real.parent] if self.roots is None else [root.resolve() for root in self.roots]
            inside = [root for root in roots if real.is_relative_to(root)]
            return (real, inside[0]) if inside else None
        except (OSError, ValueError, RuntimeError):  # a name too long or with a NUL, a loop of links
            return None


def mesh_folders(packages: Sequence[Path], urdf: Path | None, share: Path | None) -> MeshFolders:
    """The folders for a URDF: those of the caller, those above the file, and example-robot-data's (`share`)."""
    above = () if urdf is None else urdf.resolve().parents
    folders = (*packages, *above, *([] if share is None else [share]))
    return MeshFolders(folders, None if urdf is None else urdf.parent, confining_roots())


_MISSING = {  # by the tag of what has the mesh
    "visual": "meshes that are not found (dynamics do not need them; give package_dirs= to draw them)",
    "collision": "collision meshes that are not found (give package_dirs=, or shapes= to effects.Contact)",
}


def missing_meshes(robot: Element, folders: MeshFolders) -> dict[str, tuple[str, ...]]:
    """The names of meshes without a file, each once, in order, by what the load report says of them."""
    missing = {}
    for kind, what in _MISSING.items():
        shapes = (body.first("geometry") for link in robot.all("link") for body in link.all(kind))
        names = (mesh.attributes.get("filename", "") for shape in shapes if shape for mesh in shape.all("mesh"))
        missing[what] = tuple(name for name in dict.fromkeys(names) if folders.find(name) is None)
    return missing


def drawable_urdf(robot: Element, folders: MeshFolders) -> tuple[str, dict[str, MeshFile], dict[str, MeshFile]]:
    """The URDF as text, meshes by their full path, and the meshes of visuals and of collisions by Pinocchio's name.

    Visuals whose mesh is missing are left out; such collisions stay, for whoever asks for them. A material is defined
    where it first stands, for all visuals after it: one that stands in a visual that is left out moves up to the robot.
    """
    meshes: dict[str, MeshFile] = {}
    collision_meshes: dict[str, MeshFile] = {}
    lost, links = list[Element](), list[Element]()
    defined = {material.attributes.get("name", "") for material in robot.all("material")}
    for link in robot.all("link"):
        drawn = [(visual, _located(visual, folders)) for visual in link.all("visual")]
        for visual, found in drawn:
            material = visual.first("material")
            name = "" if material is None else material.attributes.get("name", "")
            if material is not None and material.children and name and name not in defined:
                defined.add(name)
                lost += [material] if found is None else []
        shown = [found for _, found in drawn if found is not None]
        name = link.attributes.get("name", "")
        meshes |= {f"{name}_{k}": mesh for k, (_, mesh) in enumerate(shown) if mesh is not None}
        solids = [_located(collision, folders) or (collision, None) for collision in link.all("collision")]
        collision_meshes |= {f"{name}_{k}": mesh for k, (_, mesh) in enumerate(solids) if mesh is not None}
        parts = [*link.all("inertial"), *(body for body, _ in (*shown, *solids))]
        links.append(Element("link", link.attributes, link.line, parts))
    kept = [child for child in robot.children if child.tag in ("joint", "material")]
    out = Element("robot", dict(robot.attributes), robot.line, [*kept, *lost, *links])
    return out.to_xml(), meshes, collision_meshes


def _mesh_of(body: Element) -> Element | None:
    """The <mesh> of a visual or collision."""
    geometry = body.first("geometry")
    return None if geometry is None else geometry.first("mesh")


def _located(visual: Element, folders: MeshFolders) -> tuple[Element, MeshFile | None] | None:
    """A visual or collision with the full path of its mesh, and the mesh; None without a shape or a file."""
    mesh = _mesh_of(visual)
    if mesh is None:
        return None if visual.first("geometry") is None else (visual, None)
    found = folders.find(mesh.attributes.get("filename", ""))
    if found is None:
        return None
    located = Element("mesh", {**mesh.attributes, "filename": str(found[0])}, mesh.line)
    file = MeshFile(*found, mesh.attributes.get("scale", "1 1 1"))
    return _with_shape(visual, located), file


def _with_shape(body: Element, shape: Element) -> Element:
    rest = [child for child in body.children if child.tag != "geometry"]
    geometry = Element("geometry", {}, shape.line, [shape])
    return Element(body.tag, body.attributes, body.line, [*rest, geometry])


def without_meshes(text: str) -> str:
    """The text of `drawable_urdf` without collisions, and with a sphere in place of each mesh.

    Pinocchio's reader of URDF would open each mesh, and whatever other files it names.
    """
    robot = parse_xml(text.encode(), "visuals", "utf-8")
    for link in robot.all("link"):
        link.children = [
            _with_shape(child, Element("sphere", {"radius": "1"}, child.line)) if _mesh_of(child) else child
            for child in link.children
            if child.tag != "collision"
        ]
    return robot.to_xml()


class VisualModel(pin.GeometryModel):  # type: ignore[misc]  # pin has no types
    """Shapes to draw. parts: those of their Collada files by path: reading them once more takes as long again."""

    def __init__(self, shapes: pin.GeometryModel, parts: dict[str, tuple[Part, ...]]) -> None:
        super().__init__(shapes)
        self.parts = parts


def set_mesh(item: Any, mesh: MeshFile, tree: bool = True, read: dict[str, tuple[Part, ...]] | None = None) -> None:
    """Give a pin.GeometryObject the shape of a mesh file.

    tree: see `triangle_mesh`. read: the parts of Collada files by path, to which this one's are added.

    Raises
    ------
    ShowError
        Code "mesh-not-readable".
    """
    try:
        scale = tuple(parse_number(part) for part in mesh.scale.split())
        if len(scale) != 3 or not np.isfinite(scale).all():
            raise ValueError(f"its scale is {mesh.scale[:60]!r}, expected 3 numbers")
        (raw, suffix), read = mesh.read(), {} if read is None else read
        if suffix == ".dae" and str(mesh.path) not in read:
            read[str(mesh.path)] = read_collada(raw)
        vertices, faces = read_triangles(raw, suffix, read.get(str(mesh.path)))
        item.geometry = triangle_mesh(vertices * scale, faces, tree)
    except (OSError, ValueError) as error:
        what = f"the mesh {mesh.path.name!r} cannot be read: {getattr(error, 'strerror', None) or error}"
        remedy = f"repair or convert it (readable: {', '.join(SUFFIXES)}), or take it out of the URDF"
        raise ShowError(what, where=f"visual {item.name!r}", remedy=remedy, code="mesh-not-readable") from None
    item.meshPath, item.meshScale = str(mesh.path), np.array(scale)


def triangle_mesh(vertices: Any, faces: Any, tree: bool = True) -> coal.BVHModelOBBRSS:
    """Triangles (m, 3) of corners (n, 3) for Coal.

    tree: with the tree of boxes that collisions need, and pictures do not; it takes a third of the time of a picture.
    """
    shape = coal.BVHModelOBBRSS()
    shape.beginModel(len(faces), len(vertices))
    shape.addVertices(vertices)
    shape.addTriangles(faces)
    if tree:
        shape.endModel()
    return shape
