"""Texts with a unit in the fields of effects, which are read as numbers when a scene is made."""

import functools
from collections.abc import Mapping
from typing import Any, TypeVar, get_args

import msgspec

from twolink.dynamics import Robot
from twolink.effects.checks import check_joint, declared, errors_inside
from twolink.effects.effect import Effect
from twolink.errors import SceneError

_E = TypeVar("_E", bound=Effect)


def in_si(effect: _E, robot: Robot) -> _E:
    """The effect, and what is inside it, with numbers in SI units in place of texts. Raises SceneError."""
    read: dict[str, Any] = {}
    if isinstance(inner := getattr(effect, "of", None), Effect):
        with errors_inside():
            read["of"] = in_si(inner, robot)
    for field, letter in _quantities(type(effect)).items():
        if isinstance(values := getattr(effect, field), Mapping):
            read[field] = {joint: _read(value, joint, letter, field, robot) for joint, value in values.items()}
    return msgspec.structs.replace(effect, **read) if read else effect


@functools.cache
def _quantities(kind: type[Effect]) -> dict[str, str]:
    """The fields of a class that take texts, each with the letter of its quantity."""
    return {field.name: letter for field in msgspec.structs.fields(kind) if (letter := _letter(field.type))}


def _letter(kind: Any) -> str:
    return declared(kind).get("quantity") or next(filter(None, map(_letter, get_args(kind))), "")


def _read(value: Any, joint: str, letter: str, field: str, robot: Robot) -> Any:
    """A value of a joint, or a pair of them, without texts."""
    if isinstance(value, (tuple, list)):
        return tuple(_read(one, joint, letter, field, robot) for one in value)
    if not isinstance(value, str):
        return value
    check_joint(joint, robot, field, dofs=False)
    layout = next(one for one in robot.joints if one.name == joint)
    try:
        return layout.in_si(letter, value)
    except ValueError:
        what = f"expected a number or a text with its unit, got {value!r:.60}"
        raise SceneError(what, where=f"{field}.{joint}", remedy=layout.remedy(letter)) from None
