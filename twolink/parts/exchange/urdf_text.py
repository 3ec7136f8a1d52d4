"""A robot as a URDF in one form: merged bodies, locked joints fixed, inertias about centres of mass along link axes."""

import copy
import math
import os
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin

from twolink.algorithms.mechanism import single_bodies
from twolink.dynamics import Robot
from twolink.errors import RobotError
from twolink.io.files import path_to_write, write_atomic
from twolink.io.tables import require_format
from twolink.robots.joint_layout import NO_LIMIT
from twolink.robots.urdf import moments_written, written
from twolink.scenes.urdf_scene import followers, urdf_tree

_TYPES = {"revolute": "revolute", "continuous": "continuous", "prismatic": "prismatic", "planar": "planar",
          "free-flyer": "floating"}  # fmt: skip


def export_urdf(robot: Robot, path: str | os.PathLike[str]) -> Path:
    """Write a robot as a URDF in one form: bodies merged, locked joints fixed, inertias about centres of mass.

    Links stay as frames; `tl.compare_models` finds it equal, but for what an MJCF says and a URDF has not: gravity,
    springs, loops and compensated weights are left out. Meshes are named by their full paths. A capsule, which a URDF
    has not, is a cylinder with a ball at each end.

    Raises
    ------
    RobotError
        It has coupled joints, or joints that a URDF has not (code "no-urdf").
    """
    return write_robot(robot, path, (".urdf",), urdf_text)


def write_robot(
    robot: Robot, path: str | os.PathLike[str], suffixes: tuple[str, ...], text_of: Callable[[Robot], str]
) -> Path:
    """Write a robot as text to a file with one of the suffixes. Raises RobotError for coupled joints."""
    target = path_to_write(path)
    require_format(target, suffixes)
    if robot.has_mimic:
        raise RobotError("it has coupled joints", where=f"robot {robot.name!r}", code="mimic-joints",
                         remedy="load it with mimic=False: <mimic> is written")  # fmt: skip
    text = text_of(robot)
    return write_atomic(target, lambda file: file.write(text.encode()), error=RobotError)


def urdf_text(robot: Robot) -> str:
    """The URDF of a robot without coupled joints."""
    model, said = robot.model, urdf_tree(robot)
    root = ET.Element("robot", name=robot.name)
    links = [[f for f in model.frames if f.type == pin.FrameType.BODY and f.parentJoint == j]
             for j in range(model.njoints)]  # fmt: skip
    free = robot.root == "free"
    kept = [own[0].name if own else "world" if j == 0 else f"{model.names[j]}_link" for j, own in enumerate(links)]
    for j in range(free, model.njoints):
        _link(root, kept[j], model.inertias[j])
        for frame in links[j][1:]:
            _link(root, frame.name, None)
            _joint(root, f"{frame.name}_fixed", "fixed", kept[j], frame.name, frame.placement)
    for j in range(1 + free, model.njoints):
        _moving_joint(root, robot, j, kept[model.parents[j]], kept[j])
    mimics = followers(robot, said)
    for joint in root.iter("joint"):
        mimic = mimics.get(joint.get("name", ""))
        if mimic is not None and mimic.joint in model.names:
            ET.SubElement(joint, "mimic", joint=mimic.joint, multiplier=repr(mimic.multiplier),
                          offset=repr(mimic.offset))  # fmt: skip
    for link in root.iter("link"):
        shapes = said.links[link.get("name", "")].element.children if link.get("name") in said.links else []
        for shape in shapes:
            if shape.tag in ("visual", "collision"):
                link.extend(_shapes(ET.fromstring(shape.to_xml())))
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def _link(root: ET.Element, name: str, body: pin.Inertia | None) -> None:
    """A link; without an inertia where it has none of its own."""
    link = ET.SubElement(root, "link", name=name)
    if body is None or (body.mass == 0 and not np.any(body.inertia)):
        return
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "origin", xyz=written(body.lever), rpy="0 0 0")
    ET.SubElement(inertial, "mass", value=repr(float(body.mass)))
    ET.SubElement(inertial, "inertia", moments_written(body.inertia))


def _shapes(shape: ET.Element) -> list[ET.Element]:
    """A shape of a link by elements of URDF: of a capsule, which it has not, a cylinder with a ball at each end."""
    capsule = shape.find("geometry/capsule")
    if capsule is None:
        return [shape]
    given = shape.find("origin")
    origin = {} if given is None else given.attrib
    xyz, rpy = (np.array(origin.get(key, "0 0 0").split(), dtype=float) for key in ("xyz", "rpy"))
    half, parts = pin.rpy.rpyToMatrix(rpy)[:, 2] * 0.5 * float(capsule.get("length", 0.0)), list[ET.Element]()
    for side, kind in ((0.0, "cylinder"), (1.0, "sphere"), (-1.0, "sphere")):
        part = copy.deepcopy(shape)
        for old in part.findall("geometry") + part.findall("origin"):
            part.remove(old)
        ET.SubElement(part, "origin", xyz=written(xyz + side * half), rpy=written(rpy))
        sizes = {key: value for key, value in capsule.attrib.items() if kind == "cylinder" or key == "radius"}
        ET.SubElement(ET.SubElement(part, "geometry"), kind, sizes)
        parts.append(part)
    return parts


def _joint(root: ET.Element, name: str, kind: str, parent: str, child: str, place: pin.SE3) -> ET.Element:
    joint = ET.SubElement(root, "joint", name=name, type=kind)
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    angles = pin.rpy.matrixToRpy(place.rotation)
    ET.SubElement(joint, "origin", xyz=written(place.translation), rpy=written(angles))
    return joint


def _moving_joint(root: ET.Element, robot: Robot, index: int, parent: str, child: str) -> None:
    """A joint with its axis, limits, damping and friction."""
    model, kind = robot.model, single_bodies(robot.model).joints[index].kind
    if kind not in _TYPES:
        raise RobotError(f"a URDF has no {kind} joints", where=f"joint {model.names[index]!r}", code="no-urdf",
                         remedy="split it into joints of one axis")  # fmt: skip
    joint = _joint(root, model.names[index], _TYPES[kind], parent, child, model.jointPlacements[index])
    q, v = model.idx_qs[index], model.idx_vs[index]
    if kind != "free-flyer":
        axis = (0.0, 0.0, 1.0) if kind == "planar" else single_bodies(model).joints[index].axis
        ET.SubElement(joint, "axis", xyz=written(np.array(axis, dtype=float)))
        limits = {"effort": model.upperEffortLimit[v], "velocity": model.velocityLimit[v]}
        if kind in ("revolute", "prismatic"):
            limits |= {"lower": model.lowerPositionLimit[q], "upper": model.upperPositionLimit[q]}
        ET.SubElement(joint, "limit", {name: repr(as_limit(float(x))) for name, x in limits.items()})
    numbers = {"damping": model.damping[v], "friction": model.upperDryFrictionLimit[v]}
    if model.armature[v]:
        numbers["armature"] = model.armature[v]  # which other programs leave out
    ET.SubElement(joint, "dynamics", {key: repr(float(value)) for key, value in numbers.items()})


def as_limit(limit: float) -> float:
    """A limit; of none, a number that every reader takes as none."""
    return limit if abs(limit) < NO_LIMIT else math.copysign(NO_LIMIT, limit)
