"""Parameters: the numbers of a scene by name, and the scene with other values of them.

    q.JOINT, v.JOINT          the initial state; q.JOINT.2, ... where a joint has several coordinates
    LINK.mass, gravity.z, ... physical constants of the robot (`algorithms.mechanism.parameter_names`), and moments of a
                              link about its joint (`algorithms.mechanism.moments`)
    JOINT.damping             beside what effects damp: 0, whatever the URDF says, for that does not act by itself
    effects.1.damping.elbow   a number of an effect: its place in the scene, then fields, keys and positions

Keys are names of joints and links, which may have dots, so that a name is read along the effect (`path_of`).
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal, get_args, get_origin

import msgspec
import numpy as np

from twolink.algorithms.mechanism import moments, nominal_values, split_name
from twolink.effects.effect import Effect
from twolink.effects.inputs import Sampled
from twolink.effects.switching import SwitchingEffect
from twolink.errors import SceneError, nearest, shown
from twolink.io.text import kebab_case
from twolink.robots.joint_layout import joint_columns
from twolink.scenes.scene import Scene

PREFIX = "effects."
Kind = Literal["q", "v", "constant", "effect", "table", "switch", "accuracy", "robot"]
DAMPING = ".damping"
NOT_NEGATIVE = (".mass", ".armature", DAMPING, ".inertia.xx", ".inertia.yy", ".inertia.zz")
_UNITS = {"mass": "kg", "com": "m", "inertia": "kg m^2", "origin": "m", "gravity": "m/s^2",
          "first_moment": "kg m", "origin_inertia": "kg m^2"}  # fmt: skip


@dataclass(frozen=True)
class Parameter:
    """A number of a scene.

    kind: of the initial state, of the robot, of an effect or of a table in one; of a sweep, see `sweeps.design`.
    nominal: the value in the scene. lowest: that it can have. unit, about: for people. entries: of q or v, those that
    it sets, two for the angle of a continuous joint; of a switch, the place of its effect. acts: whether it is an input
    of the equations of motion.
    """

    name: str
    kind: Kind
    nominal: float
    unit: str
    about: str
    lowest: float = -math.inf
    entries: tuple[int, ...] = ()
    acts: bool = False

    def put(self, q: np.ndarray, v: np.ndarray, values: Any) -> None:
        """Write values (...) of a coordinate into configurations (..., nq) or velocities (..., nv)."""
        state, angle = q if self.kind == "q" else v, len(self.entries) == 2
        state[..., self.entries] = np.stack([np.cos(values), np.sin(values)] if angle else [values], -1)


def parameters_of(scene: Scene) -> dict[str, Parameter]:
    """The parameters of a scene by name, without moments of links and values of tables."""
    values = nominal_values(scene.robot.model)
    constants = _constants({name: 0.0 if name.endswith(DAMPING) else x for name, x in values.items()}, acts=True)
    found = [*coordinates_of(scene), *constants, *_numbers(scene.effects)]
    return {parameter.name: parameter for parameter in found}


def named_parameters(scene: Scene, names: Iterable[str], argument: str, others: Iterable[str] = ()) -> list[Parameter]:
    """The parameters of these names, also moments and values of tables ("effects.3.inputs.elbow.values.2").

    Raises SceneError, code "unknown-parameter", with the nearest right name, of parameters or of `others`.
    """
    names, found = list(names), list[Parameter]()
    if not names:
        return found
    known = parameters_of(scene)
    known |= {one.name: one for one in _constants(moments(scene.robot.model), acts=False)}
    for name in names:
        parameter = known.get(name) or _value_of_table(scene, str(name))
        if parameter is None:
            raise _unknown(str(name), [*known, *others], argument)
        found.append(parameter)
    return found


def _unknown(name: str, known: Iterable[str], argument: str) -> SceneError:
    return SceneError(f"there is no parameter {shown(name)}", argument=argument, remedy=nearest(name, known),
                      code="unknown-parameter")  # fmt: skip


def scene_with(scene: Scene, values: Mapping[str, float]) -> Scene:
    """The scene with these values of parameters. A joint's damping acts. Raises SceneError for what cannot be."""
    from twolink.effects import Constants, JointDamping  # only where they are asked for

    q, v, effects = scene.q.copy(), scene.v.copy(), list(scene.effects)
    of_state = {parameter.name: parameter for parameter in coordinates_of(scene)}
    damping, constants = dict[str, float](), dict[str, float]()
    for name, value in values.items():
        if name in of_state:
            of_state[name].put(q, v, value)
        elif name.startswith(PREFIX):
            effects = with_effect_number(effects, name, value)
        elif name.endswith(DAMPING):
            damping[name.removesuffix(DAMPING)] = value
        else:
            constants[name] = value
    if damping:
        effects.append(JointDamping(damping=damping))
    if constants:
        effects.append(Constants(values=constants))
    return Scene(scene.base, q, v, effects, scene.duration, scene.title)


def coordinates_of(scene: Scene) -> Iterator[Parameter]:
    """The coordinates of the initial state that are free: of an angle or a length, or one of several of a joint."""
    for joint in scene.robot.joints:
        angle = joint.unit == "rad"
        unit = ("rad" if angle else "m") if joint.v.stop - joint.v.start == 1 else "rad or m"
        about = f"of joint {joint.name} at the start"
        if joint.kind == "cos-sin":
            x, y = scene.q[joint.q]
            entries = joint.q.start, joint.q.start + 1
            yield Parameter(f"q.{joint.name}", "q", math.atan2(y, x), "rad", f"configuration {about}", entries=entries)
        else:
            fixed = joint.normalized or slice(0, 0)  # entries of length 1 are not free
            for i, (name, _) in enumerate(joint_columns([joint], "q"), joint.q.start):
                if not fixed.start <= i < fixed.stop:
                    yield Parameter(name, "q", float(scene.q[i]), unit, f"configuration {about}", entries=(i,))
        rate = f"{unit.replace(' or m', '/s or m')}/s"
        for i, (name, _) in enumerate(joint_columns([joint], "v"), joint.v.start):
            yield Parameter(name, "v", float(scene.v[i]), rate, f"velocity {about}", entries=(i,))


def _constants(values: Mapping[str, float], *, acts: bool) -> Iterator[Parameter]:
    """Physical constants of the robot."""
    for name, value in values.items():
        owner, part, entry = split_name(name)
        about = f"{part}.{entry} of {owner}" if owner and entry else f"{entry or part} of {owner or part}"
        lowest = 0.0 if name.endswith(NOT_NEGATIVE) else -math.inf
        yield Parameter(name, "constant", value, _UNITS.get(part, "SI units"), about, lowest, acts=acts)


def _numbers(effects: Sequence[Effect]) -> Iterator[Parameter]:
    """The numbers of effects."""
    for place, effect in enumerate(effects):
        for path, value in numbers_of(effect):
            yield _number(place, effect, path, value, acts=_acts(part_of(effect, path)))


def _acts(effect: Effect) -> bool:
    """True if the effect's numbers are inputs of the equations of motion alone."""
    return type(effect).act is not Effect.act and not effect.changes


def _number(place: int, effect: Effect, path: Sequence[str], value: float, *, acts: bool) -> Parameter:
    where, kind = ".".join(path), kebab_case(type(effect).__name__)
    return Parameter(f"{PREFIX}{place}.{where}", "effect", value, "SI units", f"{where} of effect {place}, {kind}",
                     _lowest(effect, path), acts=acts)  # fmt: skip


def _lowest(value: Any, path: Sequence[str]) -> float:
    """The least value that the field admits in which a path ends."""
    declared: Any = None
    for key in path:
        if isinstance(value, msgspec.Struct):
            declared = next(field.type for field in msgspec.structs.fields(value) if field.name == key)
        value = _parts(value, tables=True)[key]
    return _least(declared)


def _least(declared: Any) -> float:
    if get_origin(declared) is Annotated:
        said = getattr(declared.__metadata__[0], "extra_json_schema", None) or {}
        own = said.get("minimum", said.get("exclusiveMinimum", -math.inf))
        return float(max(own, _least(declared.__origin__)))
    return max(map(_least, get_args(declared)), default=-math.inf)


def _value_of_table(scene: Scene, name: str) -> Parameter | None:
    """The value of a table in an effect; None where there is none of this name."""
    place, path = _place_of(scene.effects, name)
    if path[-2:-1] != ("values",):
        return None
    effect = scene.effects[place]
    number = _number(place, effect, path, number_at(effect, path), acts=False)
    return replace(number, kind="table", about=f"value of a table, {number.about}")


def _place_of(effects: Sequence[Effect], name: str) -> tuple[int, tuple[str, ...]]:
    """The effect that has the number of a name, by its place, and the path in it; empty where there is none."""
    place, _, rest = name.removeprefix(PREFIX).partition(".")
    if not (name.startswith(PREFIX) and place.isdecimal() and int(place) < len(effects)):
        return -1, ()
    return int(place), path_of(effects[int(place)], rest) or ()


def part_of(effect: Effect, path: Sequence[str]) -> Effect:
    """The effect at which a path begins: the given one, or the one that is released."""
    return effect.acting()[0] if path[0] == "of" and isinstance(effect, SwitchingEffect) else effect


def effect_numbers(scene: Scene) -> dict[str, float]:
    """The numbers of all effects, by name."""
    return {parameter.name: parameter.nominal for parameter in _numbers(scene.effects)}


def with_effect_number(effects: Sequence[Effect], name: str, number: float) -> list[Effect]:
    """Effects with another value of the number of this name. Raises SceneError, code "unknown-parameter"."""
    place, path = _place_of(effects, name)
    if not path:
        raise _unknown(name, [parameter.name for parameter in _numbers(effects)], "parameters")
    own = list(effects)
    own[place] = with_number(own[place], path, number)
    return own


def path_of(value: Any, name: str) -> tuple[str, ...] | None:
    """The fields, keys and positions to a number whose names, joined by dots, are `name`; None where there is none."""
    for key, part in _parts(value, tables=True).items():
        if key == name and not _parts(part, tables=True):
            return (key,)
        if name.startswith(f"{key}.") and (rest := path_of(part, name[len(key) + 1 :])) is not None:
            return (key, *rest)
    return None


def numbers_of(value: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], float]]:
    """The numbers in an effect, with the paths to them."""
    for name, part in _parts(value).items():
        if isinstance(part, (int, float)) and not isinstance(part, bool):
            yield (*path, name), float(part)
        else:
            yield from numbers_of(part, (*path, name))


def number_at(value: Any, path: Sequence[str]) -> float:
    """The number at the end of a path in an effect."""
    for key in path:
        value = _parts(value, tables=True)[key]
    return float(value)


def with_number(value: Any, path: Sequence[str], number: Any) -> Any:
    """An effect, or a part of one, with another number at the end of a path."""
    if not path:  # a whole number, such as a seed, stays one
        return int(number) if isinstance(value, int) and isinstance(number, float) and number.is_integer() else number
    key, rest = path[0], path[1:]
    if isinstance(value, msgspec.Struct):
        return msgspec.structs.replace(value, **{key: with_number(getattr(value, key), rest, number)})
    if isinstance(value, Mapping):
        return {k: with_number(part, rest, number) if str(k) == key else part for k, part in value.items()}
    return tuple(with_number(part, rest, number) if str(i) == key else part for i, part in enumerate(value))


def _parts(value: Any, *, tables: bool = False) -> dict[str, Any]:
    """The parts of a value, by name; none for a number or a text, and for a table unless it is asked for."""
    if isinstance(value, msgspec.Struct) and (tables or not isinstance(value, Sampled)):
        return {name: getattr(value, name) for name in value.__struct_fields__}
    if isinstance(value, Mapping):
        return {str(key): part for key, part in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return {str(i): part for i, part in enumerate(value)}
    return {}
