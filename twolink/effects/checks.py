"""Checks of what effects are given: fields by their declared types, values by joint, frames and points."""

import contextlib
import functools
import sys
from collections.abc import Iterable, Iterator, Mapping
from fractions import Fraction
from types import UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin

import msgspec
import numpy as np

from twolink.algorithms.functions import frame_pose
from twolink.algorithms.motion import GROUND, KinematicState
from twolink.algorithms.spatial import Scalar, Vec, minus, unit
from twolink.dynamics import Robot
from twolink.effects.effect import Effect, Place, all_finite, check_name, finite, number
from twolink.effects.inputs import Bezier, Polynomial, Sampled, check_curve, check_table
from twolink.effects.own_effects import check_own_formula, check_own_methods
from twolink.errors import SceneError, require_known

# By the number of entries: how messages name it, and what to give.
_VECTORS = {3: ("three numbers", "one along each of x, y, z"), 6: ("six numbers", "(xx, xy, xz, yy, yz, zz)")}

_fields = functools.cache(msgspec.structs.fields)  # of a class


Part = TypeVar("Part", bound=msgspec.Struct)


def with_plain_numbers(part: Part) -> Part:
    """The effect, input, condition or shape with tuples and floats of Python in place of NumPy's and of fractions.

    Fields that may be arrays or fractions keep them; an effect inside has its own fields.
    """
    inside = ("of",) if isinstance(getattr(part, "of", None), Effect) else ()
    plain = {name: value for name in (*_without_arrays(type(part)), *inside)
             if (value := _plain(before := getattr(part, name))) is not before}  # fmt: skip
    return msgspec.structs.replace(part, **plain) if plain else part


@functools.cache
def _without_arrays(kind: type[msgspec.Struct]) -> tuple[str, ...]:
    """The fields of a class that are not meant to be such, as some of controllers and of users' effects are."""
    kept = "Any", "ndarray", "Fraction"
    return tuple(one.name for one in _fields(kind) if not any(word in str(one.type) for word in kept))


def _plain(value: Any) -> Any:
    """The value without NumPy's numbers and arrays, and without fractions; itself where it has none."""
    if isinstance(value, Fraction):
        return float(value)  # clocks find the fraction again
    if isinstance(value, np.generic | np.ndarray):
        return _tuples(value.tolist())
    if isinstance(value, msgspec.Struct):
        return with_plain_numbers(value)
    if isinstance(value, dict):
        items = {name: _plain(one) for name, one in value.items()}
        return items if any(items[name] is not value[name] for name in items) else value
    if isinstance(value, tuple | list) and value and isinstance(value[0], np.generic | np.ndarray | msgspec.Struct):
        parts = tuple(map(_plain, value))
        return parts if any(one is not other for one, other in zip(parts, value, strict=True)) else value
    return value


def _tuples(value: Any) -> Any:
    return tuple(map(_tuples, value)) if isinstance(value, list) else value


@contextlib.contextmanager
def errors_inside() -> Iterator[None]:
    """Within it, errors are of the effect inside another one, its `of`."""
    try:
        yield
    except SceneError as error:
        raise error.at(f"of.{error.where}") from None


def check_effect(effect: Effect, robot: Robot) -> None:
    """Require an effect whose fields have the declared types and that fits the robot. Raises SceneError."""
    check_fields(effect, robot)
    own = not type(effect).__module__.startswith("twolink.")
    if own:
        check_own_methods(effect)
    effect.check(robot)
    if own:
        check_own_formula(effect, robot)


def check_fields(part: msgspec.Struct, robot: Robot, place: str = "") -> None:
    """Require values of the declared types in the fields of an effect, input or condition. Raises SceneError.

    Names of links and joints are those of the robot. Where a field declares joints, it names one or more.
    """
    for field in _fields(type(part)):
        value, where, said = getattr(part, field.name), f"{place}{field.name}", declared(field.type)
        _check(value, field.type, where, robot)
        if "of" in said:
            others = getattr(part, said["of"])
            check_subset(value, others, where, f"joint with {'an' if said['of'][0] in 'aei' else 'a'} {said['of']}")
            for joint in others if "each" in said else ():
                check_name(joint, value, where, f"{field.name} for joint")


def declared(kind: Any) -> dict[str, Any]:
    """The entries that a field has beside its type."""
    return (get_origin(kind) is Annotated and get_args(kind)[1].extra_json_schema) or {}


def _check(value: Any, kind: Any, field: str, robot: Robot, words: tuple[str, ...] = ()) -> None:
    """Require a value of a type, in place of which messages name `words`. The effect checks callables."""
    origin, arguments = get_origin(kind), get_args(kind)
    if kind is float:
        finite(value, field)
    elif origin is Annotated:
        if arguments[0] is not float:
            _check(value, arguments[0], field, robot)
        _check_declared(value, declared(kind), field, robot)
    elif origin is Literal:
        require_known(value, arguments, SceneError, where=field)
    elif origin is Mapping:
        if not isinstance(value, Mapping):
            what = f"expected {' or '.join(['values by joint', *map(repr, words)])}, got {value!r:.60}"
            raise SceneError(what, where=field, remedy="such as {'elbow': 1.0}")
        _check_keys(value, arguments[0], field, robot)
        for key, item in value.items():
            _check(item, arguments[1], f"{field}.{key}", robot)
    elif origin is tuple and arguments not in ((float, float), (Place, Place)):  # stops may be infinite
        _check_tuple(value, arguments, field, robot)
    elif origin in (Union, UnionType):
        _check_choice(value, kind, field, robot)


def _check_keys(names: Iterable[str], kind: Any, field: str, robot: Robot) -> None:
    """Require names as declared, of one joint or more."""
    if not names and declared(kind):
        raise SceneError("it names no joint", where=field, remedy="name joints, or leave the effect out")
    for name in names:
        _check(name, kind, field, robot)


def _check_declared(value: Any, said: Mapping[str, Any], field: str, robot: Robot) -> None:
    """Require what a field says beside its type."""
    if "minimum" in said:
        finite(value, field, least=said["minimum"])
    elif "exclusiveMinimum" in said:
        finite(value, field)
        if value < sys.float_info.min:  # what is smaller has no inverse
            raise SceneError(f"expected a number above 0, got {value!r:.60}", where=field, remedy="give SI units")
    elif said.get("format") == "direction":
        unit(value, field)
    elif said.get("format") == "link":
        check_frame(value, robot, field, ground="ground" in said)
    elif said.get("format") == "joint":
        freedom = said.get("freedom")
        check_joint(value, robot, field, dofs=freedom is not None, coordinate=freedom == "coordinate")
    if "maximum" in said and value > said["maximum"]:
        raise SceneError(f"expected a number from 0 to {said['maximum']:g}, got {value!r:.60}", where=field,
                         remedy="more would create energy")  # fmt: skip


def _check_tuple(value: Any, kinds: tuple[Any, ...], field: str, robot: Robot) -> None:
    """Require a tuple or list of so many numbers or inputs; for kinds (float, ...) of any size."""
    if len(kinds) in _VECTORS and not (isinstance(value, (tuple, list)) and len(value) == len(kinds)):
        word, remedy = _VECTORS[len(kinds)]
        raise SceneError(f"expected {word}, got {value!r:.60}", where=field, remedy=f"give {remedy}")
    if kinds[0] is float:
        all_finite(value, field)
    elif (get_origin(kinds[0]) is Annotated and get_args(kinds[0])[0] is float) or Polynomial in get_args(kinds[0]):
        for i, item in enumerate(value):
            _check(item, kinds[0], f"{field}[{i}]", robot)
    elif get_origin(kinds[0]) is Annotated:
        _check_keys(value, kinds[0], field, robot)
    elif _structs(kinds[0]) or get_origin(kinds[0]) is tuple:  # shapes, or points
        if not isinstance(value, (tuple, list)):
            raise SceneError(f"expected a list, got {value!r:.60}", where=field, remedy="put it into brackets: [...]")
        for i, item in enumerate(value):
            _check(item, kinds[0], f"{field}[{i}]", robot)


def _structs(kind: Any) -> bool:
    """True if a type is a union of structs alone, such as shapes."""
    return get_origin(kind) in (Union, UnionType) and all(
        isinstance(one, type) and issubclass(one, msgspec.Struct) for one in get_args(kind)
    )


def _check_choice(value: Any, kind: Any, field: str, robot: Robot) -> None:
    """Require one of the types of a union: an input, a condition, or None or a word in place of the first type."""
    arguments = get_args(kind)
    words = next((get_args(other) for other in arguments if get_origin(other) is Literal), ())
    if isinstance(value, tuple(other for other in arguments if isinstance(other, type) and other not in (float, str))):
        if isinstance(value, msgspec.Struct):
            check_fields(value, robot, f"{field}.")
        if isinstance(value, Sampled):
            check_table(value, field)
        if isinstance(value, Bezier):
            check_curve(value, field)
    elif _structs(kind):
        names = ", ".join(one.__name__ for one in arguments)
        raise SceneError(
            f"expected one of {names}, got {value!r:.60}", where=field, remedy=f"see effects.{arguments[0].__name__}"
        )
    elif Polynomial in arguments and not isinstance(value, (int, float)):
        what = f"expected a number, Polynomial, Bezier, Sine or Sampled, got {value!r:.60}"
        raise SceneError(what, where=field, remedy="such as 1.5")
    elif not (isinstance(value, str) and value in words):
        _check(value, arguments[0], field, robot, words)


def check_joints(values: Any, robot: Robot, field: str, *, dofs: bool = False, coordinates: bool = False) -> None:
    """Require values by joint, for one joint or more. Raises SceneError.

    dofs: joints with one degree of freedom only. coordinates: joints with one coordinate only, an angle or a length.
    """
    if not values:
        raise SceneError("it names no joint", where=field, remedy="name joints, or leave the effect out")
    for joint in values:
        check_joint(joint, robot, field, dofs=dofs or coordinates, coordinate=coordinates)


def check_joint(joint: str, robot: Robot, field: str, *, dofs: bool = True, coordinate: bool = False) -> None:
    """Require a joint that moves: with one degree of freedom, or with one coordinate. Raises SceneError."""
    if not isinstance(joint, str):
        raise SceneError(f"expected the name of a joint, got {joint!r:.60}", where=field,
                         remedy=f"such as {next(iter(robot.joint_names), 'elbow')!r}")  # fmt: skip
    if joint in robot.visuals.lock:
        raise SceneError(f"joint {joint!r} is locked", where=field, remedy="leave it out, or load the robot without")
    check_name(joint, robot.joint_names, field, "joint")
    if dofs:
        check_name(joint, single_joints(robot), field, "joint of one degree of freedom")
    if coordinate and next(j.kind for j in robot.joints if j.name == joint) != "vector":
        what = f"joint {joint!r} is continuous: its configuration is (cos, sin), which does not count turns"
        remedy = 'give the joint limits in the URDF (type="revolute"), so that it has an angle'
        raise SceneError(what, where=field, remedy=remedy)


def check_subset(values: Any, joints: Iterable[str], field: str, what: str) -> None:
    """Require values by joint for some of the joints alone, which are each a `what`. Raises SceneError."""
    for joint in values:
        check_name(joint, joints, field, what)


def check_values_or_urdf(values: Mapping[str, float | str] | None, urdf: Any, field: str, what: str = "") -> None:
    """Require values by joint; or None, and values (nv,) in the URDF, named `what`. Raises SceneError."""
    if values is None and not urdf.any():
        remedy = "give it by joint, or leave the effect out"
        raise SceneError(f"the URDF gives no joint {what or field}", where=field, remedy=remedy)


def values_by_dof(values: Mapping[str, float | str] | None, urdf: Any, motion: KinematicState) -> dict[int, float]:
    """The values of each degree of freedom that has one: those by joint, or for None the URDF's (nv,)."""
    if values is None:
        return dict(enumerate(urdf.tolist()))
    return {k: number(value) for joint, value in values.items() for k in motion.dofs(joint)}


def single_joints(robot: Robot) -> list[str]:
    """The joints with one degree of freedom."""
    return [j.name for j in robot.joints if j.v.stop - j.v.start == 1]


def check_frame(frame: str, robot: Robot, field: str, *, ground: bool = False) -> int:
    """Require a link that moves, or with `ground` any link or the ground. Raises SceneError.

    Returns the number of the body that carries the link's frame; the ground is body 0.
    """
    names = [f.name for f in robot.model.frames if f.type.name == "BODY"]
    if frame == GROUND and frame not in names:
        body = 0
    else:
        check_name(frame, [*names, GROUND] if ground else names, field, "frame")
        body = frame_pose(robot.model, frame)[0]
    if body == 0 and not ground:
        what = f"frame {frame!r} does not move, so the effect changes nothing"
        raise SceneError(what, where=field, remedy="name a link that moves")
    return body


def apart(motion: KinematicState, a: str, point_a: Vec, b: str, point_b: Vec) -> list[Scalar]:
    """x_a - x_b of two frames' points, along the axes that the motion is seen in, m."""
    ends = motion.position(a, point_a), motion.position(b, point_b)
    return [minus(x, y) for x, y in zip(*ends, strict=True)]


def floats(vector: tuple[float, float, float]) -> Vec:
    """Three numbers as floats, which a formula folds as constants."""
    x, y, z = map(number, vector)
    return x, y, z
