"""Finding the mesh files a URDF names, and leaving out those that are not there."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from twolink.robots.xml import Element


def resolve(name: str, package_dirs: Sequence[Path], base: Path | None) -> Path | None:
    """The file a mesh name means, or None: package://P/x below a package folder, file://, or beside the URDF."""
    if name.startswith("package://"):
        candidates: Iterable[Path] = (folder / name.removeprefix("package://") for folder in package_dirs)
    elif name.startswith("file://"):
        candidates = (Path(name.removeprefix("file://")),)
    else:
        candidates = (Path(name),) if base is None else (base / name, Path(name))
    return next((path for path in candidates if path.is_file()), None)


def search_path(given: Sequence[Path], urdf: Path | None, share: Path | None) -> tuple[Path, ...]:
    """Where package:// counts from: the folders given, those above the URDF, and example-robot-data's."""
    above = () if urdf is None else tuple(urdf.resolve().parents)
    return (*given, *above, *(() if share is None else (share,)))


def missing(robot: Element, package_dirs: Sequence[Path], base: Path | None) -> tuple[str, ...]:
    """The names of visual meshes that no file is found for, each once, in order."""
    names = (mesh.attributes.get("filename", "") for mesh in _visual_meshes(robot))
    return tuple(dict.fromkeys(n for n in names if resolve(n, package_dirs, base) is None))


def without_missing(robot: Element, package_dirs: Sequence[Path], base: Path | None) -> str:
    """The URDF as text, visuals only, with found meshes by full path and the visuals of the others left out.

    A material is defined where it first stands, for all visuals after it: one that stands in a visual left out moves up
    to the robot.
    """
    out = Element("robot", dict(robot.attributes), robot.line, [])
    out.children = [c for c in robot.children if c.tag in ("joint", "material")]
    out.children += _orphaned_materials(robot, package_dirs, base)
    for link in robot.all("link"):
        kept = [c for c in link.children if c.tag == "inertial"]
        kept += [v for v in (_located(v, package_dirs, base) for v in link.all("visual")) if v is not None]
        out.children.append(Element("link", link.attributes, link.line, kept))
    return out.to_xml()


def _located(visual: Element, package_dirs: Sequence[Path], base: Path | None) -> Element | None:
    geometry = visual.first("geometry")
    mesh = None if geometry is None else geometry.first("mesh")
    if geometry is None or mesh is None:
        return visual if geometry is not None else None
    path = resolve(mesh.attributes.get("filename", ""), package_dirs, base)
    if path is None:
        return None
    located = Element("mesh", {**mesh.attributes, "filename": str(path.resolve())}, mesh.line)
    shape = Element("geometry", {}, geometry.line, [located])
    rest = [c for c in visual.children if c.tag != "geometry"]
    return Element("visual", visual.attributes, visual.line, [*rest, shape])


def _orphaned_materials(robot: Element, package_dirs: Sequence[Path], base: Path | None) -> list[Element]:
    """The materials that others may use by name and that are defined in a visual that is left out."""
    known = {material.attributes.get("name", "") for material in robot.all("material")}
    orphaned = []
    for visual in (visual for link in robot.all("link") for visual in link.all("visual")):
        material = visual.first("material")
        name = "" if material is None else material.attributes.get("name", "")
        if material is None or not material.children or not name or name in known:
            continue
        known.add(name)
        if _located(visual, package_dirs, base) is None:
            orphaned.append(material)
    return orphaned


def _visual_meshes(robot: Element) -> Iterable[Element]:
    for link in robot.all("link"):
        for visual in link.all("visual"):
            geometry = visual.first("geometry")
            if geometry is not None:
                yield from geometry.all("mesh")
