"""The mesh files that a URDF names: where they are, and the URDF without those that are missing."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from twolink.robots.xml import Element


@dataclass(frozen=True)
class MeshFolders:
    """Where meshes are looked for: `packages`, which package:// counts from, and `base`, the URDF's own folder."""

    packages: tuple[Path, ...]
    base: Path | None

    def file(self, name: str) -> Path | None:
        """The file that a mesh name means, or None: package://P/x, file:///x, or a path beside the URDF."""
        if name.startswith("package://"):
            candidates = [folder / name.removeprefix("package://") for folder in self.packages]
        elif name.startswith("file://"):
            candidates = [Path(name.removeprefix("file://"))]
        else:
            candidates = [Path(name)] if self.base is None else [self.base / name, Path(name)]
        return next((path for path in candidates if path.is_file()), None)


def mesh_folders(packages: Sequence[Path], urdf: Path | None, share: Path | None) -> MeshFolders:
    """The folders for a URDF: those of the caller, those above the file, and example-robot-data's (`share`)."""
    above = () if urdf is None else urdf.resolve().parents
    return MeshFolders((*packages, *above, *([] if share is None else [share])), None if urdf is None else urdf.parent)


def missing_meshes(robot: Element, folders: MeshFolders) -> tuple[str, ...]:
    """The names of visual meshes without a file, each once, in order."""
    shapes = (visual.first("geometry") for visual in _visuals(robot))
    names = (mesh.attributes.get("filename", "") for shape in shapes if shape for mesh in shape.all("mesh"))
    return tuple(dict.fromkeys(name for name in names if folders.file(name) is None))


def drawable_urdf(robot: Element, folders: MeshFolders) -> str:
    """The URDF as text for drawing: meshes by their full path, without collisions and visuals whose mesh is missing.

    A material is defined where it first stands, for all visuals after it: one that stands in a visual that is left out
    moves up to the robot.
    """
    kept = {id(visual): _located(visual, folders) for visual in _visuals(robot)}
    out = Element("robot", dict(robot.attributes), robot.line)
    out.children = [c for c in robot.children if c.tag in ("joint", "material")]
    defined = {material.attributes.get("name", "") for material in robot.all("material")}
    for visual in _visuals(robot):
        material = visual.first("material")
        name = "" if material is None else material.attributes.get("name", "")
        if material is not None and material.children and name and name not in defined:
            defined.add(name)
            if kept[id(visual)] is None:
                out.children.append(material)
    for link in robot.all("link"):
        visuals = [kept[id(visual)] for visual in link.all("visual")]
        parts = [*link.all("inertial"), *(visual for visual in visuals if visual is not None)]
        out.children.append(Element("link", link.attributes, link.line, parts))
    return out.to_xml()


def _visuals(robot: Element) -> Iterator[Element]:
    return (visual for link in robot.all("link") for visual in link.all("visual"))


def _located(visual: Element, folders: MeshFolders) -> Element | None:
    """The visual with the full path of its mesh; None where it has no geometry or the mesh is missing."""
    geometry = visual.first("geometry")
    mesh = None if geometry is None else geometry.first("mesh")
    if geometry is None or mesh is None:
        return visual if geometry is not None else None
    path = folders.file(mesh.attributes.get("filename", ""))
    if path is None:
        return None
    located = Element("mesh", {**mesh.attributes, "filename": str(path.resolve())}, mesh.line)
    shape = Element("geometry", {}, geometry.line, [located])
    rest = [c for c in visual.children if c.tag != "geometry"]
    return Element("visual", visual.attributes, visual.line, [*rest, shape])
