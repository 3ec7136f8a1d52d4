"""Numbers of effects by name, such as "effects.1.damping.elbow": looking them up, and putting others in their place.

A name is the place of the effect in the scene and the fields, keys and positions that lead to the number. Keys are
names of joints and links, which may have dots, so that a name is read along the effect (`path_of`). Numbers of what
acts while the robot moves are parameters of the equations, as the robot's physical constants are.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import msgspec

from twolink.algorithms.mechanism import nominal, nominal_values
from twolink.effects.effect import Effect
from twolink.effects.inputs import Sampled, Slot
from twolink.effects.switching import Switching, SwitchingEffect
from twolink.errors import SceneError
from twolink.integrate.equations import Equations
from twolink.scenes import Scene

PREFIX = "effects."


def effect_numbers(scene: Scene) -> dict[str, float]:
    """The numbers of what acts while the robot moves, by name."""
    found = {}
    for place, effect in enumerate(scene.effects):
        released = isinstance(effect, SwitchingEffect)
        for acting in effect.acting() if isinstance(effect, SwitchingEffect) else (effect,):
            if type(acting).act is not Effect.act:
                start = (str(place), "of") if released else (str(place),)
                found.update({PREFIX + ".".join((*start, *path)): value for path, value in numbers_of(acting)})
    return found


def all_effect_numbers(scene: Scene) -> dict[str, float]:
    """The numbers of all effects, by name: also of those that change the robot's constants or that switch."""
    return {PREFIX + ".".join((str(place), *path)): value
            for place, effect in enumerate(scene.effects) for path, value in numbers_of(effect)}  # fmt: skip


def with_effect_numbers(equations: Equations, values: Mapping[str, Any]) -> Equations:
    """The equations with other numbers in their effects, which may be expressions; names of other things are left."""
    chosen = {name: value for name, value in values.items() if name.startswith(PREFIX)}
    if not chosen:
        return equations
    constraints, count = equations.constraints, len(equations.effects)
    parts = acting_parts(equations)
    for name, value in chosen.items():
        found = _found(equations, name)
        if found is not None:
            parts[found[0]] = with_number(parts[found[0]], found[1], value)
    if constraints is not None:
        constraints = replace(constraints, loops=tuple(parts[count:]))
    return replace(equations, effects=tuple(parts[:count]), constraints=constraints)


def physical(values: Mapping[str, Any]) -> dict[str, Any]:
    """Those of values by name that are physical constants of the robot."""
    return {name: value for name, value in values.items() if not name.startswith(PREFIX)}


def nominal_value(equations: Equations, name: str) -> float:
    """The value that a parameter has in the equations, SI units; 0 of an effect that does not act.

    Raises QueryError for an unknown physical constant.
    """
    if not name.startswith(PREFIX):
        return nominal(equations.robot.model, name)
    found = _found(equations, name)
    if found is None:
        return 0.0
    i, path = found
    return number_at(acting_parts(equations)[i], path)


def nominal_vector(equations: Equations) -> list[float]:
    """The values that the parameters of the equations have in them, SI units."""
    constants = nominal_values(equations.robot.model)
    return [constants[name] if name in constants else nominal_value(equations, name) for name in equations.parameters]


def number_at(value: Any, path: Sequence[str]) -> float:
    """The number at the end of a path in an effect."""
    for key in path:
        value = _parts(value)[key]
    return float(value)


def _found(equations: Equations, name: str) -> tuple[int, tuple[str, ...]] | None:
    """Which of the equations' effects, then loops, has the number, and the path to it there; None where none does."""
    _, place, rest = name.split(".", 2)
    parts = acting_parts(equations)
    if place == "contacts":
        number, _, rest = rest.partition(".")
        slot = contact_slots(int(number))[0]
        found = [i for i, part in enumerate(parts) if slot in getattr(part, "before", ())]
    else:
        found = [i for i, other in enumerate(equations.places) if other == int(place)]
    for i in found:
        path = path_of(parts[i], rest if hasattr(parts[i], "of") else rest.removeprefix("of."))
        return None if path is None else (i, path)
    return None


def path_of(value: Any, name: str) -> tuple[str, ...] | None:
    """The fields, keys and positions to a number whose names, joined by dots, are `name`; None where there is none."""
    for key, part in _parts(value, tables=True).items():
        if key == name and not _parts(part, tables=True):
            return (key,)
        if name.startswith(f"{key}.") and (rest := path_of(part, name[len(key) + 1 :])) is not None:
            return (key, *rest)
    return None


def with_effect_number(effects: Sequence[Effect], name: str, number: float) -> list[Effect]:
    """A scene's effects with another value of the number of this name. Raises SceneError where there is none."""
    _, place, rest = name.split(".", 2)
    own = list(effects)
    path = path_of(own[int(place)], rest)
    if path is None:
        raise SceneError(f"there is no number {name!r}", where=f"effects[{place}]", code="unknown-variable",
                         remedy="`all_effect_numbers(scene)` lists them")  # fmt: skip
    own[int(place)] = with_number(own[int(place)], path, number)
    return own


def contact_slots(i: int) -> tuple[Slot, Slot]:
    """The slots of the direction in which contact i began to slide."""
    return Slot(f"contact {i}.0"), Slot(f"contact {i}.1")


def contact_numbers(switching: Switching) -> dict[str, float]:
    """The numbers of the law and of the shapes of each contact, by name, such as "effects.contacts.0.friction"."""
    return {PREFIX + ".".join(("contacts", str(i), *path)): value for i, (_, contact) in enumerate(switching.contacts)
            for path, value in numbers_of(contact.constraint(False, contact_slots(i)))}  # fmt: skip


def acting_parts(equations: Equations) -> list[Any]:
    """The equations' effects, then their loops."""
    return [*equations.effects, *(equations.constraints.loops if equations.constraints else ())]


def _parts(value: Any, *, tables: bool = False) -> dict[str, Any]:
    """What a value consists of, by name; nothing for a number or a text, and for a table unless it is asked for."""
    if isinstance(value, msgspec.Struct) and (tables or not isinstance(value, Sampled)):
        return {name: getattr(value, name) for name in value.__struct_fields__}
    if isinstance(value, Mapping):
        return {str(key): part for key, part in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return {str(i): part for i, part in enumerate(value)}
    return {}


def numbers_of(value: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], float]]:
    """The numbers in an effect, with the paths to them."""
    for name, part in _parts(value).items():
        if isinstance(part, (int, float)) and not isinstance(part, bool):
            yield (*path, name), float(part)
        else:
            yield from numbers_of(part, (*path, name))


def with_number(value: Any, path: Sequence[str], number: Any) -> Any:
    """An effect, or a part of one, with another number at the end of a path."""
    if not path:
        return number
    key, rest = path[0], path[1:]
    if isinstance(value, msgspec.Struct):
        return msgspec.structs.replace(value, **{key: with_number(getattr(value, key), rest, number)})
    if isinstance(value, Mapping):
        return {k: with_number(part, rest, number) if str(k) == key else part for k, part in value.items()}
    return tuple(with_number(part, rest, number) if str(i) == key else part for i, part in enumerate(value))
