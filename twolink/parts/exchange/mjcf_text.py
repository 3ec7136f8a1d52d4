"""A robot as an MJCF: bodies with full inertias, joints, and the springs and loops that its own file said."""

import math
import os
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from twolink.algorithms.mechanism import single_bodies
from twolink.dynamics import Robot
from twolink.errors import RobotError
from twolink.parts.exchange.urdf_text import as_limit, write_robot
from twolink.robots.joint_layout import NO_LIMIT, urdf_limits
from twolink.robots.model import COMPENSATION
from twolink.robots.tree import Tree
from twolink.robots.urdf import written
from twolink.robots.xml import Element, Reader
from twolink.scenes.urdf_scene import followers, urdf_tree

_TYPES = {"revolute": "hinge", "continuous": "hinge", "prismatic": "slide", "spherical": "ball", "free-flyer": "free"}
_SHAPES = {"box": ("size",), "sphere": ("radius",), "cylinder": ("radius", "length"), "capsule": ("radius", "length")}


def export_mjcf(robot: Robot, path: str | os.PathLike[str]) -> Path:
    """Write a robot as an MJCF: bodies merged as in `export_urdf`, and the springs and loops of its own file.

    `tl.compare_models` finds it equal but for limits of velocity, which an MJCF has not, and for continuous joints,
    which are hinges there. Meshes, height fields and exclusions of contact are left out.

    Raises
    ------
    RobotError
        It has coupled joints, or joints or forces that are not written to an MJCF (code "no-mjcf").
    """
    return write_robot(robot, path, (".xml", ".mjcf"), mjcf_text)


def mjcf_text(robot: Robot) -> str:
    """The MJCF of a robot without coupled joints."""
    root = ET.Element("mujoco", model=robot.name)
    ET.SubElement(root, "compiler", angle="radian", inertiafromgeom="false")
    ET.SubElement(root, "option", gravity=written(robot.gravity))
    world = ET.SubElement(root, "worldbody")
    said = urdf_tree(robot)
    _frames(world, robot, said, 0, first=0)
    for child in _children(robot.model, 0):
        _body(world, robot, said, child)
    equality = ET.Element("equality")
    equality.extend([*_equalities(root, robot, said)])
    if len(equality):
        root.append(equality)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def _children(model: pin.Model, joint: int) -> list[int]:
    return [k for k in range(1, model.njoints) if model.parents[k] == joint]


def _links(robot: Robot, joint: int) -> list[pin.Frame]:
    return [f for f in robot.model.frames if f.type == pin.FrameType.BODY and f.parentJoint == joint]


def _body(above: ET.Element, robot: Robot, said: Tree, joint: int) -> None:
    """The body of a joint; joints that move nothing but the next one are joints of the next one's body."""
    model, chain = robot.model, [joint]
    while model.inertias[chain[-1]].mass == 0 and len(following := _children(model, chain[-1])) == 1:
        chain += following
    last, places = chain[-1], [model.jointPlacements[k] for k in chain]
    place = pin.SE3.Identity()
    for each in places:
        place = place * each
    links = _links(robot, last)
    body = ET.SubElement(above, "body", {"name": links[0].name if links else model.names[last], **_pose(place)})
    seen = pin.SE3.Identity()  # the joint's frame in the body's, at zero
    for k, each in zip(reversed(chain), reversed(places), strict=True):
        body.insert(0, _joint(robot, k, seen, chain))
        seen = seen * each.inverse()
    inertia = model.inertias[last]
    if inertia.mass > 0:
        if np.linalg.eigvalsh(inertia.inertia)[0] <= 0:
            raise RobotError("MuJoCo takes no point masses and thin rods", where=f"link {body.get('name')!r}",
                             code="no-mjcf", remedy="give it an inertia about each axis")  # fmt: skip
        moments = [inertia.inertia[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
        ET.SubElement(body, "inertial", pos=written(inertia.lever), mass=repr(float(inertia.mass)),
                      fullinertia=written(moments))  # fmt: skip
    if links:
        _geoms(body, said, links[0].name, links[0].placement)
    _frames(body, robot, said, last, first=1)
    for child in _children(model, last):
        _body(body, robot, said, child)


def _joint(robot: Robot, index: int, seen: pin.SE3, chain: list[int]) -> ET.Element:
    """A joint, whose frame is at `seen` in its body's."""
    model, mechanism = robot.model, single_bodies(robot.model).joints[index]
    kind, name = mechanism.kind, model.names[index]
    base = model.parents[index] == 0 and model.jointPlacements[index].isIdentity(1e-12)
    if kind not in _TYPES or (kind == "free-flyer" and not (base and len(chain) == 1)):
        raise RobotError(f"an MJCF has no such {kind} joint", where=f"joint {name!r}", code="no-mjcf",
                         remedy="split it into joints of one axis; hang free bodies on the world's origin")  # fmt: skip
    q, v = model.idx_qs[index], model.idx_vs[index]
    joint = ET.Element("joint", name=name, type=_TYPES[kind], pos=written(seen.translation))
    numbers = {"damping": model.damping[v], "armature": model.armature[v]}
    if kind == "free-flyer":
        joint.attrib.pop("pos")
    elif kind != "spherical":
        joint.set("axis", written(seen.rotation @ np.array(mechanism.axis, dtype=float)))
        numbers["frictionloss"] = model.upperDryFrictionLimit[v]
        effort = float(model.upperEffortLimit[v])
        if 0 < effort < NO_LIMIT:
            joint.set("actuatorfrcrange", written([-effort, effort]))
        for effect, given in robot.visuals.laws.effects:
            if effect == "joint-spring" and name in given["stiffness"]:
                numbers |= {"stiffness": given["stiffness"][name], "springref": given["rest"].get(name, 0.0)}
    if kind in ("revolute", "prismatic") and np.isfinite(limits := urdf_limits(model, q)).any():
        joint.set("range", written([*map(as_limit, limits)]))
    for key, value in numbers.items():
        if value:
            joint.set(key, repr(float(value)))
    return joint


def _frames(above: ET.Element, robot: Robot, said: Tree, joint: int, first: int) -> None:
    """Links that are fixed to a body, as bodies without mass of their own."""
    for frame in _links(robot, joint)[first:]:
        if joint == 0 and frame.name == "world":
            _geoms(above, said, frame.name, frame.placement)
        else:
            _geoms(ET.SubElement(above, "body", {"name": frame.name, **_pose(frame.placement)}), said, frame.name,
                   pin.SE3.Identity())  # fmt: skip


def _geoms(body: ET.Element, said: Tree, link: str, place: pin.SE3) -> None:
    """The simple shapes of a link; meshes are left out."""
    for shape in said.links[link].element.children if link in said.links else []:
        solid = next((s for g in shape.all("geometry") for s in g.children if s.tag in _SHAPES), None)
        if shape.tag not in ("visual", "collision") or solid is None:
            continue
        reader, owner = Reader(said.name, lines=False), f"link {link!r}"
        sizes = {key: reader.numbers(solid, key, owner, 3 if key == "size" else 1) for key in _SHAPES[solid.tag]}
        size = [x if key == "radius" else 0.5 * x for key, values in sizes.items() for x in values]
        bits = {"contype": "0", "conaffinity": "0"} if shape.tag == "visual" else {"group": "3"}
        origin = shape.first("origin") or Element("origin", {}, 0)
        xyz, rpy = (np.array(reader.numbers(origin, key, owner, 3, (0.0, 0.0, 0.0))) for key in ("xyz", "rpy"))
        own = pin.SE3(pin.rpy.rpyToMatrix(rpy), xyz)
        ET.SubElement(body, "geom", {"type": solid.tag, "size": written(size), **_pose(place * own), **bits})


def _equalities(root: ET.Element, robot: Robot, said: Tree) -> Iterator[ET.Element]:
    """Mimic joints and couplings; the loops that the robot's own file said, between sites that are added."""
    for joint, other in followers(robot, said).items():
        if {joint, other.joint} <= set(robot.joint_names):
            yield ET.Element("joint", joint1=joint, joint2=other.joint,
                             polycoef=written([other.offset, other.multiplier, 0, 0, 0]))  # fmt: skip
    for number, (effect, given) in enumerate(robot.visuals.laws.effects):
        if effect in ("point-loop", "weld-loop"):
            turned = pin.rpy.rpyToMatrix(*given.get("rpy", (0.0, 0.0, 0.0)))  # of a in b
            for end, rotation in (("a", np.eye(3)), ("b", turned)):
                place = pin.SE3(rotation, np.array(given[f"point_{end}"]))
                _named(root, robot, given[end]).append(ET.Element("site", {"name": f"{end}{number}", **_pose(place)}))
            kind = "connect" if effect == "point-loop" else "weld"
            yield ET.Element(kind, site1=f"a{number}", site2=f"b{number}")
        elif effect == COMPENSATION:
            _compensate(root, robot, given)


def _named(root: ET.Element, robot: Robot, link: str) -> ET.Element:
    """The body of a link."""
    found = next((body for body in root.iter("body") if body.get("name") == link), None)
    world = root.find("worldbody")
    if found is None and link == "world" and world is not None:
        return world
    if found is None:
        raise RobotError("a loop or force acts on a link without mass, which is not written", code="no-mjcf",
                         where=f"robot {robot.name!r}, link {link!r}", remedy="use its own file")  # fmt: skip
    return found


def _compensate(root: ET.Element, robot: Robot, given: Mapping[str, Any]) -> None:
    """Write a body's gravity compensation; it has to act at the body's centre of mass."""
    frame = robot.model.frames[robot.model.getFrameId(given["frame"], pin.FrameType.BODY)]
    inertia = robot.model.inertias[frame.parentJoint]
    away = np.abs(frame.placement.act(np.array(given["point"])) - inertia.lever).max()
    links = _links(robot, frame.parentJoint)
    if away > 1e-9:
        raise RobotError("gravity compensation that acts elsewhere than at a body's centre of mass", code="no-mjcf",
                         where=f"robot {robot.name!r}, link {frame.name!r}", remedy="use its own file")  # fmt: skip
    _named(root, robot, links[0].name).set("gravcomp", repr(_shortest(given["mass"] / float(inertia.mass))))


def _shortest(value: float) -> float:
    """The number with the fewest decimal digits within four roundings of a value: what a file said before it was
    multiplied and divided again."""
    rounded = (float(f"{value:.{digits}g}") for digits in range(1, 18))
    return next(x for x in rounded if abs(x - value) <= 4 * math.ulp(value))


def _pose(place: pin.SE3) -> dict[str, str]:
    x, y, z, w = pin.Quaternion(place.rotation).coeffs()
    return {"pos": written(place.translation), "quat": written([w, x, y, z])}
