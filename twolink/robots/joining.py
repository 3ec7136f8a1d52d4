"""Several robots and objects as one robot: their URDFs under one root link, with names that stay unique."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import TypeVar

import coal
import numpy as np
import pinocchio as pin

from twolink.errors import RobotError
from twolink.io.fingerprints import changed_joint
from twolink.io.mesh_files import is_closed, read_triangles
from twolink.io.text import kebab_case
from twolink.robots.collisions import Convex, Shape
from twolink.robots.hull_files import hull_file
from twolink.robots.load import load_model
from twolink.robots.load_report import Finding, LoadReport
from twolink.robots.load_report import findings as findings_about
from twolink.robots.meshes import MeshFile, MeshFolders, set_mesh
from twolink.robots.model import ROOT, FileLaws, RobotModel
from twolink.robots.urdf import joint_element, moments_written, roll_pitch_yaw, written
from twolink.robots.xml import Element, parse_xml

R = TypeVar("R", bound=RobotModel)
COLOURS = ("0.93 0.54 0.16 1", "0.16 0.55 0.67 1", "0.55 0.68 0.25 1", "0.69 0.33 0.45 1")
FIXED = "0.55 0.57 0.6 1"  # the colour of what does not move
BESIDE = " and objects"
_PLACES = (("link", "name"), ("joint", "name"), ("parent", "link"), ("child", "link"), ("mimic", "joint"))


def pose_of(value: object) -> pin.SE3:
    """A pose from a position (3), a position and a quaternion x y z w (7) of any length, or a pin.SE3.

    Raises RobotError for other numbers.
    """
    if isinstance(value, pin.SE3):
        return value
    try:
        numbers = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        numbers = np.empty(0)
    turn = numbers[3:] if numbers.shape == (7,) else np.array([0.0, 0.0, 0.0, 1.0])
    if numbers.shape not in ((3,), (7,)) or not np.isfinite(numbers).all() or not np.any(turn):
        raise RobotError(f"expected 3 or 7 finite numbers, got {value!r:.60}", argument="pose",
                         remedy="give x, y, z [m], and a quaternion x, y, z, w if it is turned")  # fmt: skip
    return pin.SE3(pin.Quaternion(turn / np.linalg.norm(turn)).matrix(), numbers[:3])


def body_of(kind: type[R], shape: Shape | Path, mass: float | None, colour: int) -> R:
    """A robot of one link that a shape or a mesh file fills evenly; without a mass it has no inertia.

    A hull of points becomes a mesh file. Raises RobotError for a size or mass that is not above 0, and for a mesh or a
    hull that encloses no volume.
    """
    if mass is not None and not (np.isfinite(mass) and mass > 0):
        raise RobotError(f"it is {mass!r} kg", argument="mass", remedy="give a mass above 0, or none if it is fixed")
    link = Element("link", {"name": "body"}, 0)
    mesh = hull_file(shape) if isinstance(shape, Convex) else shape
    if isinstance(mesh, Path):
        name = shape.stem if isinstance(shape, Path) else "convex"
        solid, drawn = _solid_of_mesh(mesh), Element("mesh", {"filename": str(mesh.resolve())}, 0)
    else:
        name, solid = kebab_case(type(mesh).__name__), _solid_of_shape(mesh)
        drawn = Element(name, {key: written(value) for key, value in mesh.sizes.items()}, 0)
    place = pin.SE3.Identity() if isinstance(shape, Path) else shape.placement
    if mass is not None:
        if isinstance(mesh, Path) and not is_closed(*read_triangles(mesh.read_bytes(), mesh.suffix.lower())):
            raise _no_volume(mesh, "is not closed, so that its centre and inertia are not known")
        density = mass / solid.computeVolume()
        inertia = place.rotation @ (density * solid.computeMomentofInertiaRelatedToCOM()) @ place.rotation.T
        centre = _origin(pin.SE3(np.eye(3), place.act(np.asarray(solid.computeCOM()))))
        body = [centre, Element("mass", {"value": written(mass)}, 0), Element("inertia", moments_written(inertia), 0)]
        link.children.append(Element("inertial", {}, 0, body))
    rgba = FIXED if mass is None else COLOURS[colour % len(COLOURS)]
    material = Element("material", {"name": f"colour {rgba}"}, 0, [Element("color", {"rgba": rgba}, 0)])
    geometry = [_origin(place), Element("geometry", {}, 0, [drawn])]
    link.children += [Element("visual", {}, 0, [*geometry, material]), Element("collision", {}, 0, geometry)]
    return load_model(
        kind, Element("robot", {"name": name, "version": "1.2"}, 0, [link]).to_xml(), purpose="kinematics"
    )


def _solid_of_shape(shape: Shape) -> coal.CollisionGeometry:
    solid = shape.coal()
    if not solid.computeVolume() > 0:
        raise RobotError(f"{shape!r} has no volume", argument="source", remedy="give sizes above 0, in m")
    return solid


def _solid_of_mesh(path: Path) -> coal.CollisionGeometry:
    item = pin.GeometryObject(path.name, 0, pin.SE3.Identity(), coal.Sphere(1.0))
    set_mesh(item, MeshFile(path.resolve(), path.resolve().parent, "1 1 1"))
    if not item.geometry.computeVolume() > 0:
        raise _no_volume(path, "encloses no volume")
    return item.geometry


def _no_volume(path: Path, what: str) -> RobotError:
    return RobotError(f"the mesh {path.name!r} {what}", argument="source", code="flat-shape",
                      remedy="close it, with all its faces turned outwards")  # fmt: skip


def free_name(wanted: str, taken: Collection[str]) -> str:
    """The name, or with the first number from 2 on that makes it new."""
    names = itertools.chain([wanted], (f"{wanted}_{number}" for number in itertools.count(2)))
    return next(name for name in names if name not in taken)


def joined(robot: R, parts: Sequence[tuple[RobotModel, str, pin.SE3, bool]]) -> R:
    """A robot with others beside it, as one model whose parts only the world connects.

    Parameters
    ----------
    robot : RobotModel
        The first; its names stay.
    parts : sequence of (robot, name, pose, free)
        Each other robot, its name, the pose of its root link in the world, and whether it is free: on a joint of its
        name, whose configuration is its pose in the world. Where links or joints are of names that are
        taken, all of the part's are called NAME_LINK and NAME_JOINT, and the link of a single one NAME.

    Returns
    -------
    RobotModel
        The robot, with the laws of their files. Its load report lists the parts, what was renamed, and what theirs say.

    Raises
    ------
    RobotError
        A name is taken, or the constants of a part were changed after it was loaded.
    """
    everyone: list[RobotModel] = [robot, *(part for part, *_ in parts)]
    root = _element(robot)
    lock, renamed = robot.visuals.lock, list[dict[str, str]]([{}])
    base = first = _root_link(root)
    if robot.root == "free":
        base = free_name("world", _names(root))
        root.children += [Element("link", {"name": base}, 0),
                          joint_element(ROOT, "floating", base, first, _origin(pin.SE3.Identity()))]  # fmt: skip
    findings, laws, coupled = list(robot.report.findings), robot.visuals.laws, any(one.has_mimic for one in everyone)
    if coupled:
        findings += _let_go(robot, root, "")
    for part, name, pose, free in parts:
        element, taken = _element(part), _names(root)
        if name in taken:
            raise RobotError(
                f"the name {name!r} is taken", argument="name", remedy=f"such as {free_name(name, taken)!r}"
            )
        if coupled:
            findings += _let_go(part, element, f"{name}: ")
        names = _new_names(element, name, taken)
        _rename(element, names, name)
        prefixed = f", its names as {name}_..." if len(names) > 1 else ""
        if free and part.root == "free":
            names[ROOT] = name
        lock |= {names.get(joint, joint): q for joint, q in part.visuals.lock.items()}
        kind, place = ("floating", pin.SE3.Identity()) if free else ("fixed", pose)
        root.children += [*element.children, joint_element(name, kind, base, _root_link(element), _origin(place))]
        renamed.append(names)
        at = f"{'free' if free else 'fixed'}, at {written(pose.translation)} m"
        findings.append(Finding("read", f"joined {part.name!r} as {name!r}, {at}{prefixed}"))
        laws, said = _with_laws(laws, part, name, names)
        findings += said
    folders = {mesh.root for one in everyone for meshes in (one.visuals.meshes, one.visuals.collision_meshes)
               for mesh in meshes.values()}  # fmt: skip
    out = load_model(type(robot), root.to_xml(), lock=lock, gravity=robot.gravity.tolist(), unphysical="report",
                     mimic=coupled, foreign="report",
                     meshes=MeshFolders((), None, tuple(folders)))  # fmt: skip
    grounds = [None, *(None if free else pose for *_, pose, free in parts)]
    for one, names, ground in zip(everyone, renamed, grounds, strict=True):
        if joint := changed_joint(one.model, out.model, names if ground is None else {ROOT: "", **names}, ground):
            raise RobotError("its constants were changed after it was loaded", where=f"joint {joint!r}",
                             code="robot-differs", remedy="load what robot.export_urdf(...) writes")  # fmt: skip
    placed = {name: tuple(pin.SE3ToXYZQUAT(pose).tolist()) for _, name, pose, free in parts if free}
    srdf = dataclasses.replace(robot.visuals.srdf, apart=_apart(everyone, renamed))
    visuals = dataclasses.replace(out.visuals, laws=laws, srdf=srdf,
                                  placed={**robot.visuals.placed, **placed})  # fmt: skip
    label = f"{robot.report.source.removesuffix(BESIDE)}{BESIDE}"
    return type(robot)(robot.name, out.model, LoadReport(label, tuple(findings)), visuals)


def _apart(everyone: Sequence[RobotModel], renamed: Sequence[Mapping[str, str]]) -> frozenset[frozenset[str]]:
    """The pairs of links that do not touch, by their new names."""
    return frozenset(
        frozenset(names.get(link, link) for link in pair)
        for one, names in zip(everyone, renamed, strict=True)
        for pair in one.visuals.srdf.apart
    )


def _let_go(part: RobotModel, element: Element, prefix: str) -> list[Finding]:
    """Take <mimic> out of a part whose joints move independently, beside one whose joints follow others."""
    if part.has_mimic:
        return []
    names = [joint.attributes["name"] for joint in element.all("joint") if joint.first("mimic")]
    for joint in element.all("joint"):
        joint.children[:] = [child for child in joint.children if child.tag != "mimic"]
    what = f"{prefix}mimic (beside a robot with mimic=True these joints move independently, and scene_of couples none)"
    return findings_about("ignored", {what: names})


def _with_laws(laws: FileLaws, part: RobotModel, name: str, names: dict[str, str]) -> tuple[FileLaws, list[Finding]]:
    """The laws of the whole with those of a part's file, and what its report says of the part."""

    def renamed(value: object) -> object:
        if isinstance(value, Mapping):
            return {names.get(key, key): renamed(one) for key, one in value.items()}
        return names.get(value, value) if isinstance(value, str) else value

    own = part.visuals.laws
    said = [dataclasses.replace(one, what=f"{name}: {one.what}", names=tuple(names.get(x, x) for x in one.names))
             for one in part.report.findings if one.kind in ("suspicious", "ignored", "repaired")]  # fmt: skip
    effects = [(kind, {key: renamed(value) for key, value in given.items()}) for kind, given in own.effects]
    start = {names.get(joint, joint): q for joint, q in own.start.items()}
    return dataclasses.replace(laws, effects=(*laws.effects, *effects), start={**laws.start, **start}), said


def _element(robot: RobotModel) -> Element:
    return parse_xml(robot.visuals.text.encode(), robot.report.source, "utf-8")


def _root_link(element: Element) -> str:
    children = {child.attributes["link"] for joint in element.all("joint") for child in joint.all("child")}
    return next(link.attributes["name"] for link in element.all("link") if link.attributes["name"] not in children)


def _names(element: Element) -> set[str]:
    named = {one.attributes.get("name", "") for one in element.children if one.tag in ("link", "joint")}
    return named | {ROOT, "ground"}


def _new_names(element: Element, name: str, taken: Collection[str]) -> dict[str, str]:
    """New names of the links and joints of a part, by the old ones, where theirs are taken or it is one body."""
    own = [one.attributes["name"] for one in element.children if one.tag in ("link", "joint")]
    if len(own) == 1:
        return {own[0]: name}
    return {old: f"{name}_{old}" for old in own} if {*own} & {*taken, name} else {}


def _rename(element: Element, names: dict[str, str], prefix: str) -> None:
    """Give links and joints their new names, and materials, which may differ between parts, a prefix."""
    for child in element.children:
        for tag, key in _PLACES:
            if child.tag == tag and child.attributes.get(key) in names:
                child.attributes[key] = names[child.attributes[key]]
        if child.tag == "material" and child.attributes.get("name"):
            child.attributes["name"] = f"{prefix} {child.attributes['name']}"
        _rename(child, names, prefix)


def _origin(place: pin.SE3) -> Element:
    angles = roll_pitch_yaw(pin.Quaternion(place.rotation).coeffs())
    return Element("origin", {"xyz": written(place.translation), "rpy": written(angles)}, 0)
