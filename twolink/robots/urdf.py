"""Contents of a URDF as plain values: links with inertias, joints with axes and limits.

Pinocchio accepts NaN masses, zero axes and reversed limits without a message, so every number is checked here, before
Pinocchio sees the file. Python's float() reads a decimal point whatever the locale is.
"""

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from twolink.errors import nearest
from twolink.robots.xml import Element, Reader, Vector

JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar", "spherical")
UNIT_TOLERANCE = 1e-3  # files write quaternions with few digits
_PARTS = {
    "mass": "<mass value=>, kg",
    "inertia": "<inertia ixx= iyy= izz= ixy= ixz= iyz=>, kg m^2 about the centre of mass",
}
_LIMITED = ("revolute", "prismatic")
_RATES = ("acceleration", "deceleration", "jerk")
Ends = tuple[float, float]  # lower and upper
_WITH_AXIS = ("revolute", "continuous", "prismatic", "planar")


@dataclass(frozen=True)
class UrdfLink:
    """A link: mass [kg], centre of mass [m] and inertia [kg m^2] about it, both in the link's frame."""

    name: str
    where: str
    element: Element
    has_inertial: bool
    mass: float = 0.0
    inertia: np.ndarray = field(default_factory=lambda: np.zeros((3, 3)))


class Mimic(NamedTuple):
    """The coupling of a joint to another: its configuration is multiplier * (the other joint's) + offset, rad or m."""

    joint: str
    multiplier: float
    offset: float

    def within(self, limits: Ends, own: Ends) -> Ends | None:
        """The other joint's limits, narrowed so that this one keeps its own; None where that leaves it no room."""
        if self.multiplier == 0.0 or not own[0] < own[1]:
            return limits
        first, last = sorted((end - self.offset) / self.multiplier for end in own)
        lower, upper = max(limits[0], first), min(limits[1], last)
        return (lower, upper) if lower < upper else None


@dataclass(frozen=True)
class UrdfJoint:
    """A joint: the links it connects, its axis as written (None: not in the file) and its limits, rad or m.

    rate_limits: those of acceleration, deceleration and jerk that it has (URDF 1.2). armature: inertia of its motor on
    its own side, kg m^2 or kg, which no version of URDF has; nor has it the type spherical, which PyBullet reads too.
    """

    name: str
    where: str
    element: Element
    type: str
    parent: str
    child: str
    axis: Vector | None
    limits: tuple[float, float] | None
    damping: float
    friction: float
    rate_limits: tuple[str, ...]
    mimic: Mimic | None
    armature: float = 0.0


def read_link(reader: Reader, element: Element) -> UrdfLink:
    """A <link>. Raises RobotError for a negative mass, and for texts that are not finite numbers."""
    name = reader.name(element)
    owner = f"link {name!r}"
    quaternions_to_angles(reader, element, owner)
    inertial = element.first("inertial")
    if inertial is None:
        return UrdfLink(name, reader.where(element, owner), element, has_inertial=False)
    parts: dict[str, Element] = {}
    for tag in _PARTS:
        part = inertial.first(tag)
        if part is None:
            raise reader.error(inertial, owner, f"<inertial> has no <{tag}>", f"add {_PARTS[tag]}")
        parts[tag] = part
    mass = reader.number(parts["mass"], "value", owner)
    if mass < 0:
        raise reader.error(inertial, owner, f"mass {mass} kg is negative", "give its mass, 0 or more")
    xx, yy, zz, xy, xz, yz = (
        reader.number(parts["inertia"], key, owner) for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    )
    turn = _orientation(reader, inertial, owner)
    inertia = turn @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ turn.T
    return UrdfLink(name, reader.where(inertial, owner), element, True, mass, inertia)


def read_joint(reader: Reader, element: Element) -> UrdfJoint:
    """A <joint>. Raises RobotError for an unknown type, a zero axis, or limits that are missing or reversed."""
    name = reader.name(element)
    owner = f"joint {name!r}"
    kind = element.attributes["type"] = element.attributes.get("type", "").strip()
    if kind not in JOINT_TYPES:
        raise reader.error(element, owner, f"type {kind!r} is unknown", nearest(kind, JOINT_TYPES))
    parent, child = (_link_name(reader, element, tag, owner) for tag in ("parent", "child"))
    if parent == child:
        raise reader.error(element, owner, f"parent and child are both {parent!r}", "connect two links")
    quaternions_to_angles(reader, element, owner)
    _orientation(reader, element, owner)
    axis = _axis(reader, element, owner, kind) if kind in _WITH_AXIS else None
    damping = friction = armature = 0.0
    dynamics = element.first("dynamics")
    if dynamics is not None:
        damping, friction, armature = (
            reader.number(dynamics, key, owner, 0.0) for key in ("damping", "friction", "armature")
        )
        if armature < 0 or (armature and kind in ("floating", "planar")):
            what = f"armature {armature} of a {kind} joint"
            raise reader.error(dynamics, owner, what, "give 0 or more, of a joint that turns or slides")
        if "friction" not in dynamics.attributes:  # Pinocchio's parser wants one of the two
            dynamics.attributes.setdefault("damping", "0")
    limits = _limits(reader, element, owner, kind)
    rates, mimic = _rate_limits(reader, element, owner), _mimic(reader, element, owner)
    where = reader.where(element, owner)
    return UrdfJoint(name, where, element, kind, parent, child, axis, limits, damping, friction, rates, mimic, armature)


def written(values: ArrayLike) -> str:
    """Numbers as text, in their shortest exact form."""
    return " ".join(repr(float(x)) for x in np.ravel(values))


def moments_written(inertia: np.ndarray) -> dict[str, str]:
    """The attributes of an <inertia> (3, 3)."""
    return {f"i{'xyz'[i]}{'xyz'[k]}": written(inertia[i, k]) for i in range(3) for k in range(i, 3)}


def joint_element(name: str, kind: str, parent: str, child: str, *more: Element) -> Element:
    """A <joint> between two links, with an <origin> and other elements."""
    ends = [Element("parent", {"link": parent}, 0), Element("child", {"link": child}, 0)]
    return Element("joint", {"name": name, "type": kind}, 0, [*ends, *more])


def roll_pitch_yaw(quaternion: np.ndarray) -> list[float]:
    """The angles [rad] of a unit quaternion (x, y, z, w), exact to rounding at pitch = 90 degrees too."""
    return [float(angle) for angle in pin.rpy.matrixToRpy(pin.Quaternion(quaternion).matrix())]


def quaternions_to_angles(reader: Reader, owner: Element, name: str) -> None:
    """Replace quat_xyzw in the origins inside a link or joint by rpy, which Pinocchio knows too.

    Raises
    ------
    RobotError
        The origin has rpy as well, the quaternion's length is not 1, or the file is of a version that has none.
    """
    for element in owner.children:
        if element.tag != "origin":
            quaternions_to_angles(reader, element, name)
        elif "quat_xyzw" in element.attributes:
            if reader.version < (1, 1):
                what = "quat_xyzw came with URDF 1.1; by this file's version, other programs ignore it"
                raise reader.error(element, name, what, 'write <robot version="1.1">')
            if "rpy" in element.attributes:
                raise reader.error(element, name, "<origin> has both rpy and quat_xyzw", "keep one")
            quaternion = reader.numbers(element, "quat_xyzw", name, 4)
            length = math.hypot(*quaternion)
            if abs(length - 1) > UNIT_TOLERANCE:
                what = f"quat_xyzw has length {length:.6g}, expected 1"
                raise reader.error(element, name, what, "divide it by its length")
            del element.attributes["quat_xyzw"]
            element.attributes["rpy"] = written(roll_pitch_yaw(np.divide(quaternion, length)))


def _orientation(reader: Reader, parent: Element, owner: str) -> np.ndarray:
    """The rotation matrix (3, 3) of an element's <origin>, whose numbers are all checked."""
    origin = parent.first("origin")
    if origin is None:
        return np.eye(3)
    reader.numbers(origin, "xyz", owner, 3, (0.0, 0.0, 0.0))
    return np.asarray(pin.rpy.rpyToMatrix(*reader.numbers(origin, "rpy", owner, 3, (0.0, 0.0, 0.0))))


def _link_name(reader: Reader, joint: Element, tag: str, owner: str) -> str:
    """The link named by a joint's <parent> or <child>."""
    element = joint.first(tag)
    name = "" if element is None else element.attributes.get("link", "")
    if not name.strip():
        raise reader.error(joint, owner, f"it has no <{tag} link=...>", "add it")
    return name


def _axis(reader: Reader, joint: Element, owner: str, kind: str) -> Vector | None:
    """The joint's axis as written; the element gets the one of length 1."""
    element = joint.first("axis")
    axis = None
    if element is not None:
        axis = reader.numbers(element, "xyz", owner, 3)
        length = math.hypot(*axis)
        if not length > 1e-9:
            raise reader.error(element, owner, f"axis {axis} has no direction", 'give one, such as <axis xyz="0 0 1"/>')
        element.attributes["xyz"] = " ".join(repr(x / length) for x in axis)
    if kind == "planar":  # the axis is the plane's normal; Pinocchio moves in x-y, whatever the axis says
        x, y, z = axis or (1.0, 0.0, 0.0)
        if not (x == y == 0.0 and z > 0.0):
            what = f"a planar joint with the normal {(x, y, z)}: Pinocchio's moves in the x-y plane of its frame"
            raise reader.error(joint, owner, what, 'turn its <origin> so that the normal is <axis xyz="0 0 1"/>')
    return axis


def _limits(reader: Reader, joint: Element, owner: str, kind: str) -> tuple[float, float] | None:
    """The lower and upper limit of a joint that needs them; effort and velocity are checked too."""
    element = joint.first("limit")
    if element is None:
        if kind in _LIMITED:
            remedy = "add <limit lower= upper= effort= velocity=>"
            remedy += ', or use type="continuous"' if kind == "revolute" else ""
            raise reader.error(joint, owner, f"a {kind} joint needs <limit>", remedy)
        return None
    optional = 0.0 if reader.version < (1, 2) or kind not in _LIMITED else None
    lower, upper = (reader.number(element, key, owner, optional) for key in ("lower", "upper"))
    for key in ("effort", "velocity"):
        _magnitude(reader, element, key, owner, None if reader.version < (1, 2) else math.inf)
    if kind not in _LIMITED:
        return None
    if lower > upper:
        raise reader.error(element, owner, f"lower limit {lower} is above upper limit {upper}", "swap them")
    return lower, upper


def _magnitude(reader: Reader, limit: Element, key: str, owner: str, default: float | None = None) -> None:
    """Require that a limit is 0 or more."""
    value = reader.number(limit, key, owner, default)
    if value < 0:
        raise reader.error(limit, owner, f"{key} limit {value} is negative", "give its magnitude")


def _rate_limits(reader: Reader, joint: Element, owner: str) -> tuple[str, ...]:
    """The limits of acceleration, deceleration and jerk of a joint; Pinocchio 4.1 cannot hold them."""
    limit = joint.first("limit")
    if limit is None:
        return ()
    found = tuple(key for key in _RATES if key in limit.attributes)
    for key in found:
        _magnitude(reader, limit, key, owner)
        del limit.attributes[key]
    return found


def _mimic(reader: Reader, joint: Element, owner: str) -> Mimic | None:
    """Read a joint's <mimic>; None if it has none."""
    element = joint.first("mimic")
    if element is None:
        return None
    name = element.attributes.get("joint", "")
    if not name:
        raise reader.error(element, owner, "<mimic> has no joint", 'add joint="..."')
    return Mimic(name, reader.number(element, "multiplier", owner, 1.0), reader.number(element, "offset", owner, 0.0))
