"""The layout of q and v: which entries belong to which joint, which have length 1, the columns of tables, and
limits; options of loading a robot: its gravity field, and joints that are locked.
"""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from twolink.errors import QueryError, RobotError, TwolinkError, require_known
from twolink.io.text import parse_number

JointKind = Literal["vector", "cos-sin", "planar", "quaternion", "free-flyer", "mimic"]

NO_LIMIT = 1e30  # Pinocchio writes no limit as a number beyond this
_UNIT_PART = {"cos-sin": slice(0, 2), "planar": slice(2, 4), "quaternion": slice(0, 4), "free-flyer": slice(3, 7)}
Lock = Mapping[str, float | str | Sequence[float]]
# Single precision carries 6e-8: such states are asked to be normalised rather than used with that error.
UNIT_TOLERANCE = 1e-8
_LINK = "link\0"  # no name in XML holds a NUL
_UNITS = {"rad": {"rad": 1.0, "deg": math.radians(1.0)}, "m": {"m": 1.0, "mm": 1e-3}}
_EFFORTS = {"rad": {"N m": 1.0, "Nm": 1.0}, "m": {"N": 1.0}}
_QUANTITY = re.compile(r"(.*?)\s*(N m|[a-zA-Z]*(?:/s(?:\^2)?)?)", re.DOTALL)
_LONGEST = 100  # letters of a number with its unit
_RATES = {"q": "", "v": "/s", "a": "/s^2"}


@dataclass(frozen=True)
class JointLayout:
    """Joint number `index` of the model: entries q[q] and v[v], and entries q[normalized] of length 1.

    kind: vector (an angle or a length), cos-sin (continuous), planar (x, y, cos, sin), quaternion (x y z w),
    free-flyer (position, quaternion), mimic (no entries of its own). type: in a URDF, such as "revolute". unit: of the
    coordinate, "rad" or "m"; "" where there are several. lower, upper: limits of the entries of q, none where the lower
    one is not below the upper one, as where a file has 0 for both; velocity_limit, effort_limit: of those of v;
    infinite where there are none.
    """

    name: str
    index: int
    kind: JointKind
    q: slice
    v: slice
    normalized: slice | None
    type: str
    unit: str
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    velocity_limit: tuple[float, ...]
    effort_limit: tuple[float, ...]

    def entries(self, letter: str, values: ArrayLike) -> np.ndarray:
        """Values as the joint's entries of "q", "v", "a" or "tau"; one value of a continuous joint's q is its angle.

        One value may be a text with a unit of the coordinate: "90 deg", "30 deg/s", "5 mm", "2 N m". Raises ValueError
        for what is no numbers, or has another unit.
        """
        given = self.in_si(letter, values) if isinstance(values, str) else values
        numbers = np.atleast_1d(np.asarray(given, dtype=float))
        is_angle = letter == "q" and self.kind == "cos-sin" and numbers.size == 1
        return np.append(np.cos(numbers), np.sin(numbers)) if is_angle else numbers

    def remedy(self, letter: str) -> str:
        """The advice for values that `entries` does not take."""
        units = list(self._units(letter))
        numbers = {"q": "the joint's configuration"}.get(letter, "a number for each degree of freedom")
        return f"give {numbers}{' in ' + units[0] if units else ''}" + (f', or as "30 {units[-1]}"' if units else "")

    def _units(self, letter: str) -> Mapping[str, float]:
        """The units of a text with the joint's coordinate, its rates or effort, and their sizes; the first is of SI."""
        sizes = _EFFORTS if letter == "tau" else _UNITS if letter in _RATES else {}
        return {unit + _RATES.get(letter, ""): size for unit, size in sizes.get(self.unit, {}).items()}

    def in_si(self, letter: str, text: str) -> float:
        """The number of a text, in SI units. Raises ValueError as `entries` does."""
        parts = _QUANTITY.fullmatch(text.strip()) if len(text) <= _LONGEST else None  # it takes the length's square
        number, unit = parts.groups() if parts else ("", "")
        if unit and unit not in self._units(letter):
            raise ValueError(f"{unit} is no unit of {self.name}")
        return parse_number(number) * (self._units(letter)[unit] if unit else 1.0)


def unit_of(joints: Iterable[JointLayout]) -> str:
    """The unit of the coordinates of joints, "rad" or "m", or "rad or m"."""
    units = {joint.unit for joint in joints if joint.kind != "mimic"}
    return units.pop() if len(units) == 1 and "" not in units else "rad or m"


def rate_of(unit: str) -> str:
    """A unit a second, "rad/s" or "m/s", of one that `unit_of` gives."""
    return " or ".join(f"{each}/s" for each in unit.split(" or "))


def joint_columns(joints: Iterable[JointLayout], letter: str) -> list[tuple[str, str]]:
    """The columns of "q", "v", "tau" or "a" in their order, each with its joint: q.JOINT, q.JOINT.0, q.JOINT.1, ..."""
    columns = []
    for joint in joints:
        part = joint.q if letter == "q" else joint.v
        size = part.stop - part.start
        columns += [(f"{letter}.{joint.name}" + (f".{k}" if size > 1 else ""), joint.name) for k in range(size)]
    return columns


def counted_on(angle: np.ndarray, t: np.ndarray | None = None, w: np.ndarray | None = None) -> np.ndarray:
    """Angles (n, ...) that go on beyond a turn: between samples by the turns nearest to the mean of the speeds.

    t (n,), w (n, ...): of the samples, s and rad/s. Without them a joint turns by less than half a turn between two.
    """
    passed = 0.0 if t is None or w is None else (0.5 * np.diff(t) * (w[1:] + w[:-1]).T).T
    turns = np.round((passed - np.diff(angle, axis=0)) / (2.0 * np.pi))
    return angle + 2.0 * np.pi * np.concatenate([np.zeros((1, *angle.shape[1:])), np.cumsum(turns, axis=0)])


def column_forms(joint: JointLayout, letter: str) -> list[list[str]]:
    """The ways to name the columns of a joint's "q", "v", "tau" or "a" in a table, each the whole of them.

    By the joint's name, q.JOINT or q.JOINT.0, q.JOINT.1, ...; by the places in the vector, such as q4; of a continuous
    joint also its angle q.JOINT.
    """
    part = joint.q if letter == "q" else joint.v
    forms = [[column for column, _ in joint_columns([joint], letter)],
             [f"{letter}{i}" for i in range(part.start, part.stop)]]  # fmt: skip
    return [*forms, [f"q.{joint.name}"]] if letter == "q" and joint.kind == "cos-sin" else forms


def columns_to_read(table: Iterable[str], joints: Sequence[JointLayout], letter: str) -> list[str]:
    """The columns of a table to read "q", "v", "tau" or "a" of some joints from, in their order.

    For each joint those of `column_forms` that the table has some of. Where it has none, those of the form that other
    joints have. Numbers and names mix only where each joint has one coordinate: otherwise numbers may count joints.

    Raises
    ------
    QueryError
        The table has columns of one joint in two forms (code "column-twice").
    """
    there = set(table)
    forms = [column_forms(joint, letter) for joint in joints]
    if letter in there:
        if other := sorted(there & {column for of_joint in forms for form in of_joint for column in form}):
            raise _twice(letter, other[0], letter)
        return [letter]
    numbered = any(not there.isdisjoint(numbers) for _, numbers, *_ in forms)
    named = any(not there.isdisjoint(form) for names, _, *angle in forms for form in (names, *angle))
    if named and any(len(numbers) > 1 for _, numbers, *_ in forms):
        numbered, forms = False, [[names, [], *angle] for names, _, *angle in forms]
    wanted: list[str] = []
    for joint, of_joint in zip(joints, forms, strict=True):
        found = [form for form in of_joint if not there.isdisjoint(form)]
        if len(found) > 1:
            first, second = (next(column for column in form if column in there) for form in found[:2])
            raise _twice(first, second, f"{letter} of joint {joint.name!r}")
        wanted += found[0] if found else of_joint[numbered]
    return wanted


def _twice(first: str, second: str, of: str) -> QueryError:
    return QueryError(f"columns {first!r} and {second!r} are both {of}", code="column-twice",
                      remedy="keep one, or say in a map of columns which one is read")  # fmt: skip


def without_angles(table: Mapping[str, np.ndarray], joints: Iterable[JointLayout]) -> dict[str, np.ndarray]:
    """The table with cos and sin, q.JOINT.0 and q.JOINT.1, in place of the angle q.JOINT of continuous joints."""
    changed = dict(table)
    for angle in (f"q.{joint.name}" for joint in joints if joint.kind == "cos-sin"):
        if angle in changed:
            values = changed.pop(angle)
            changed |= {f"{angle}.0": np.cos(values), f"{angle}.1": np.sin(values)}
    return changed


def read_columns(
    table: Mapping[str, np.ndarray], joints: Sequence[JointLayout], letter: str
) -> tuple[np.ndarray | None, list[str]]:
    """The values (n, k) of some joints in a table, and the columns that lack for them.

    The values are None where columns lack. Raises QueryError as `columns_to_read` does, and where lengths differ.
    """
    wanted = columns_to_read(table, joints, letter)
    if wanted == [letter]:
        whole = np.asarray(table[letter])
        return whole[:, None] if whole.ndim == 1 else whole, []  # a column of a robot with one coordinate
    lacking = [column for column in wanted if column not in table]
    if lacking:
        return None, lacking
    angles = {f"q.{joint.name}" for joint in joints if letter == "q" and joint.kind == "cos-sin"}
    values = [np.asarray(table[column]) for column in wanted]
    for column, own in zip(wanted, values, strict=True):
        if own.shape[:1] != values[0].shape[:1]:
            raise QueryError(f"{wanted[0]!r} and {column!r} are not equally long", remedy="give a row for each sample")
    pairs = ((np.cos(x), np.sin(x)) if column in angles else (x,) for column, x in zip(wanted, values, strict=True))
    return np.column_stack([x for pair in pairs for x in pair]), []


def _kind(joint: pin.JointModel) -> JointKind:
    if "Mimic" in joint.shortname():
        return "mimic"
    if joint.shortname() == "JointModelPlanar":
        return "planar"
    sizes: dict[tuple[int, int], JointKind] = {(2, 1): "cos-sin", (4, 3): "quaternion", (7, 6): "free-flyer"}
    return sizes.get((joint.nq, joint.nv), "vector")


def urdf_kind(model: pin.Model, joint: int) -> str:
    """The URDF's word for a joint of the model: "revolute", "continuous", "prismatic", "planar" or "floating".

    Of joints that no URDF has, Pinocchio's name in lower case, such as "spherical".
    """
    name = str(model.joints[joint].shortname()).removeprefix("JointModel")
    if "Mimic" in name:
        return "mimic"
    if model.nvs[joint] == 1:
        return "prismatic" if name.startswith("P") else "continuous" if model.nqs[joint] == 2 else "revolute"
    return "floating" if name == "FreeFlyer" else name.lower()


def angular_dofs(joint: JointLayout) -> range:
    """The degrees of freedom of a joint, from its first on, whose velocities are angular [rad/s]."""
    if joint.kind == "vector":
        return range(int(joint.unit == "rad"))
    return {"cos-sin": range(1), "planar": range(2, 3), "quaternion": range(3), "free-flyer": range(3, 6)}.get(
        joint.kind, range(0)
    )


def urdf_limits(model: pin.Model, entry: int) -> tuple[float, float]:
    """The limits (lower, upper) of q[entry] in the URDF; infinite where there is none."""
    lower, upper = _limits(np.array([model.lowerPositionLimit[entry], model.upperPositionLimit[entry]]))
    return (lower, upper) if lower < upper else (-math.inf, math.inf)


def joint_layouts(model: pin.Model) -> tuple[JointLayout, ...]:
    """The layout of every joint of a model but the universe."""
    layouts = []
    for index in range(1, model.njoints):
        kind = _kind(model.joints[index])
        start, part = model.idx_qs[index], _UNIT_PART.get(kind)
        normalized = None if part is None else slice(start + part.start, start + part.stop)
        q = slice(start, start + model.nqs[index])
        v = slice(model.idx_vs[index], model.idx_vs[index] + model.nvs[index])
        turns = str(model.joints[index].shortname()).startswith("JointModelR")
        unit = "" if model.nvs[index] != 1 else "rad" if turns else "m"
        ends = [urdf_limits(model, entry) for entry in range(q.start, q.stop)]
        lower, upper = tuple(low for low, _ in ends), tuple(high for _, high in ends)
        limits = [_limits(all_of[v]) for all_of in (model.velocityLimit, model.upperEffortLimit)]
        layouts.append(JointLayout(model.names[index], index, kind, q, v, normalized, urdf_kind(model, index), unit,
                                   lower, upper, *limits))  # fmt: skip
    return tuple(layouts)


def _limits(values: np.ndarray) -> tuple[float, ...]:
    """Limits, infinite where there is none, which Pinocchio also writes as the largest double."""
    return tuple(float(x) if abs(x) < NO_LIMIT else math.copysign(math.inf, x) for x in values)


def gravity_field(value: Any, error: type[TwolinkError]) -> np.ndarray:
    """A gravity field as an array (3,) [m/s^2]. Raises the error unless it has 3 finite numbers."""
    try:
        field = np.asarray(value, dtype=float)
    except (TypeError, ValueError, OverflowError):
        field = np.empty(0)
    if field.shape != (3,) or not np.isfinite(field).all():
        remedy = "give m/s^2 in the world's axes, such as (0, 0, -9.81)"
        raise error(f"expected 3 finite numbers, got {value!r:.60}", argument="gravity", remedy=remedy)
    return field


def lock_configuration(model: pin.Model, lock: Lock) -> tuple[tuple[int, ...], np.ndarray]:
    """The indices of the joints to lock, and a configuration (nq,) that holds their values.

    Parameters
    ----------
    model : pin.Model
        The model with all joints.
    lock : mapping
        The configuration of each joint to lock, by name [rad, m]; of a continuous joint, an angle or (cos, sin).

    Raises
    ------
    RobotError
        A joint does not exist, or its value is no configuration of it.
    """
    if not isinstance(lock, Mapping):
        what = f"expected joints with their configurations, got {lock!r:.60}"
        raise RobotError(what, argument="lock", remedy="such as {'elbow': 0.5}")
    reference = np.asarray(pin.neutral(model))
    layouts = {joint.name: joint for joint in joint_layouts(model)}
    for name, value in lock.items():
        what = "there is no moving joint {!r} to lock"
        require_known(name, layouts, RobotError, what, argument="lock", code="unknown-joint")
        joint = layouts[name]
        size = joint.q.stop - joint.q.start
        try:
            values = joint.entries("q", value)
        except (TypeError, ValueError, OverflowError):
            values = np.empty(0)
        if values.shape != (size,) or not np.isfinite(values).all():
            what = f"expected {size} finite number{'s' if size > 1 else ''}, got {value!r:.60}"
            raise RobotError(what, where=f"lock[{name!r}]", argument="lock", remedy=joint.remedy("q"))
        reference[joint.q] = values
        length = 1.0 if joint.normalized is None else float(np.linalg.norm(reference[joint.normalized]))
        if not abs(length - 1) <= UNIT_TOLERANCE:
            what = f"quaternion or (cos, sin), expected length 1, got {length:.12g}"
            raise RobotError(what, where=f"lock[{name!r}]", argument="lock", remedy="divide it by its length")
    return tuple(sorted(layouts[name].index for name in lock)), reference


def beyond_limits(model: pin.Model, locked: Sequence[int], reference: np.ndarray) -> list[str]:
    """The names of the locked joints whose configuration is not within their limits."""
    starts = {index: model.idx_qs[index] for index in locked if model.nqs[index] == 1}
    limits = {index: urdf_limits(model, k) for index, k in starts.items()}
    return [model.names[index] for index, (low, high) in limits.items() if not low <= reference[starts[index]] <= high]


def without_joints(model: pin.Model, locked: Sequence[int], reference: np.ndarray) -> pin.Model:
    """A copy of the model where the locked joints are fixed."""
    if not locked:
        return model.copy()
    try:
        reduced = pin.buildReducedModel(_with_marked_links(model), list(locked), reference)
    except Exception as error:
        what = f"Pinocchio cannot lock these joints: {' '.join(str(error).split())}"
        raise RobotError(what, argument="lock", remedy="load it without lock=", code="pinocchio") from None
    for frame in _links(reduced):
        frame.name = frame.name.removeprefix(_LINK)
    return reduced


def shapes_without_joints(
    model: pin.Model, shapes: pin.GeometryModel, locked: Sequence[int], reference: np.ndarray
) -> pin.GeometryModel:
    """The shapes of a model, for the model of `without_joints`."""
    if not locked:
        return shapes
    return pin.buildReducedModel(_with_marked_links(model), shapes, list(locked), reference)[1]


def _with_marked_links(model: pin.Model) -> pin.Model:
    """A copy in which no link has a joint's name: buildReducedModel finds the joints' frames by their names alone."""
    marked = model.copy()
    for frame in _links(marked):
        frame.name = _LINK + frame.name
    return marked


def _links(model: pin.Model) -> list[pin.Frame]:
    return [frame for frame in model.frames if frame.type == pin.FrameType.BODY]
