"""What a URDF says, as plain values: links with inertias, joints with axes and limits.

Pinocchio takes NaN masses, zero axes and reversed limits without a word, so every number is checked here, before
Pinocchio sees the file. Python's float() reads a decimal point whatever the locale is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from twolink.errors import RobotError, nearest
from twolink.robots.xml import Element

Vector = tuple[float, ...]

JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
_LIMITED = ("revolute", "prismatic")
_WITH_AXIS = ("revolute", "continuous", "prismatic", "planar")


@dataclass(frozen=True)
class Link:
    """A link: mass [kg], centre of mass [m] and inertia [kg m^2] about it, both in the link's frame."""

    name: str
    where: str
    element: Element
    mass: float
    com: np.ndarray
    inertia: np.ndarray
    has_inertial: bool


@dataclass(frozen=True)
class Joint:
    """A joint: the links it connects, its axis as written (None: not given) and its limits, rad or m."""

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
    mimic: str | None


class Reader:
    """Reads numbers and names out of elements; errors name the file, line, link or joint, and attribute."""

    def __init__(self, source: str) -> None:
        self.source = source

    def where(self, element: Element, owner: str = "") -> str:
        """The place of an element, for errors."""
        return f"{self.source}:{element.line}" + (f", {owner}" if owner else "")

    def name(self, element: Element, owner: str = "") -> str:
        """The name of a link or joint; for a part of one, `owner` says whose."""
        value = element.attributes.get("name", "")
        if not value.strip():
            what = f"<{element.tag}> has no name"
            raise RobotError(what, where=self.where(element, owner), remedy='add name="..."')
        return value

    def numbers(self, element: Element, key: str, owner: str, count: int, default: Vector | None = None) -> Vector:
        """`count` finite numbers from one attribute, or the default where the attribute is absent."""
        text = element.attributes.get(key)
        where = self.where(element, owner)
        if text is None:
            if default is None:
                raise RobotError(f"<{element.tag}> has no {key}", where=where, remedy=f'add {key}="..."')
            return default
        shown = f'<{element.tag} {key}="{text[:60]}">'
        parts = text.split()
        if len(parts) != count:
            expected = f"expected {count} number{'s' if count > 1 else ''}, got {len(parts)}"
            remedy = "write numbers with a decimal point, separated by blanks"
            raise RobotError(f"{shown}: {expected}", where=where, remedy=remedy)
        values = tuple(_number(part, shown, where) for part in parts)
        bad = next((v for v in values if not math.isfinite(v)), None)
        if bad is not None:
            raise RobotError(f"{shown}: {bad} is not finite", where=where, remedy="give a finite number")
        return values

    def number(self, element: Element, key: str, owner: str, default: float | None = None) -> float:
        """One finite number from an attribute."""
        return self.numbers(element, key, owner, 1, None if default is None else (default,))[0]

    def pose(self, parent: Element, owner: str) -> tuple[np.ndarray, np.ndarray]:
        """The <origin> of an element: rotation matrix (3, 3) and translation (3,) [m]."""
        origin = parent.first("origin")
        if origin is None:
            return np.eye(3), np.zeros(3)
        xyz = self.numbers(origin, "xyz", owner, 3, (0.0, 0.0, 0.0))
        rpy = self.numbers(origin, "rpy", owner, 3, (0.0, 0.0, 0.0))
        return rotation(*rpy), np.array(xyz)

    def reference(self, joint: Element, tag: str, owner: str) -> str:
        """The link named by a joint's <parent> or <child>."""
        element = joint.first(tag)
        name = "" if element is None else element.attributes.get("link", "")
        if not name.strip():
            raise RobotError(f"it has no <{tag} link=...>", where=self.where(joint, owner), remedy="add it")
        return name


def _number(text: str, shown: str, where: str) -> float:
    try:
        if "_" in text or not text.isascii():  # float() takes 1_000 and other scripts' digits, URDF does not
            raise ValueError(text)
        return float(text)
    except ValueError:
        comma = "; decimals take a point, not a comma" if "," in text else ""
        raise RobotError(f"{shown}: {text!r} is not a number", where=where, remedy=f"write a number{comma}") from None


def rotation(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """R = Rz(yaw) Ry(pitch) Rx(roll), URDF's convention, (3, 3)."""
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(x), math.sin(x)) for x in (roll, pitch, yaw))
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def read_link(reader: Reader, element: Element) -> Link:
    """A <link>. Raises RobotError for a mass that is negative or a number that is none."""
    name = reader.name(element)
    owner = f"link {name!r}"
    inertial = element.first("inertial")
    if inertial is None:
        zero = np.zeros(3)
        return Link(name, reader.where(element, owner), element, 0.0, zero, np.zeros((3, 3)), False)
    where = reader.where(inertial, owner)
    parts: dict[str, Element] = {}
    for tag in ("mass", "inertia"):
        part = inertial.first(tag)
        if part is None:
            raise RobotError(f"<inertial> has no <{tag}>", where=where, remedy="add it, or drop <inertial>")
        parts[tag] = part
    mass = reader.number(parts["mass"], "value", owner)
    if mass < 0:
        raise RobotError(f"mass {mass} kg is negative", where=where, remedy="give its mass, 0 or more")
    xx, yy, zz, xy, xz, yz = (
        reader.number(parts["inertia"], key, owner) for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    )
    turn, com = reader.pose(inertial, owner)
    inertia = turn @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ turn.T
    return Link(name, where, element, mass, com, inertia, True)


def read_joint(reader: Reader, element: Element) -> Joint:
    """A <joint>. Raises RobotError for an unknown type, a zero axis, or limits that are missing or reversed."""
    name = reader.name(element)
    owner = f"joint {name!r}"
    where = reader.where(element, owner)
    kind = element.attributes.get("type", "").strip()
    if kind not in JOINT_TYPES:
        raise RobotError(f"type {kind!r} is unknown", where=where, remedy=nearest(kind, JOINT_TYPES))
    parent, child = (reader.reference(element, tag, owner) for tag in ("parent", "child"))
    if parent == child:
        raise RobotError(f"parent and child are both {parent!r}", where=where, remedy="connect two links")
    reader.pose(element, owner)
    axis = _axis(reader, element, owner) if kind in _WITH_AXIS else None
    if kind == "planar":
        _require_planar_axis(axis, where)
    damping = friction = 0.0
    dynamics = element.first("dynamics")
    if dynamics is not None:
        damping = reader.number(dynamics, "damping", owner, 0.0)
        friction = reader.number(dynamics, "friction", owner, 0.0)
    mimic = element.first("mimic")
    if mimic is not None:
        reader.number(mimic, "multiplier", owner, 1.0)
        reader.number(mimic, "offset", owner, 0.0)
    target = None if mimic is None else mimic.attributes.get("joint", "")
    limits = _limits(reader, element, owner, kind)
    return Joint(name, where, element, kind, parent, child, axis, limits, damping, friction, target)


def _axis(reader: Reader, joint: Element, owner: str) -> Vector | None:
    element = joint.first("axis")
    if element is None:
        return None
    axis = reader.numbers(element, "xyz", owner, 3)
    if not math.hypot(*axis) > 1e-9:
        raise RobotError(
            f"axis {axis} has no direction",
            where=reader.where(element, owner),
            remedy='give one, such as <axis xyz="0 0 1"/>',
        )
    return axis


def _require_planar_axis(axis: Vector | None, where: str) -> None:
    """A planar joint's axis is its plane's normal; Pinocchio moves in x-y, whatever the axis says."""
    normal = (1.0, 0.0, 0.0) if axis is None else axis
    if not (normal[0] == normal[1] == 0.0 and normal[2] > 0.0):
        raise RobotError(
            f"a planar joint with the normal {normal}: Pinocchio's moves in the x-y plane of its frame",
            where=where,
            remedy='turn its <origin> so that the normal is <axis xyz="0 0 1"/>',
        )


def _limits(reader: Reader, joint: Element, owner: str, kind: str) -> tuple[float, float] | None:
    element = joint.first("limit")
    if element is None:
        if kind in _LIMITED:
            remedy = "add <limit lower= upper= effort= velocity=>"
            remedy += ', or use type="continuous"' if kind == "revolute" else ""
            raise RobotError(f"a {kind} joint needs <limit>", where=reader.where(joint, owner), remedy=remedy)
        return None
    lower, upper = (reader.number(element, key, owner, 0.0) for key in ("lower", "upper"))
    for key in ("effort", "velocity"):
        value = reader.number(element, key, owner)
        if value < 0:
            raise RobotError(
                f"{key} limit {value} is negative",
                where=reader.where(element, owner),
                remedy="give its magnitude",
            )
    if kind not in _LIMITED:
        return None
    if lower > upper:
        raise RobotError(
            f"lower limit {lower} is above upper limit {upper}",
            where=reader.where(element, owner),
            remedy="swap them",
        )
    return lower, upper
