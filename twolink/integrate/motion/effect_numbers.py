"""Numbers of effects in equations of motion: the values that their parameters have, and others in their place.

Numbers of what acts while the robot moves are parameters of the equations, as the robot's physical constants are.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from twolink.algorithms.mechanism import nominal, nominal_values
from twolink.effects.inputs import Slot
from twolink.effects.switching import Switching
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.state import Array
from twolink.scenes.parameters import DAMPING, PREFIX, number_at, numbers_of, path_of, with_number


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
    """Physical constants of the robot among values by name."""
    return {name: value for name, value in values.items() if not name.startswith(PREFIX)}


def nominal_value(equations: Equations, name: str) -> float:
    """The value that a parameter has in the equations, SI units.

    It is 0 of an effect that does not act, and of a joint's damping, which is beside what damps it already.
    Raises QueryError for an unknown physical constant.
    """
    if not name.startswith(PREFIX):
        value = nominal(equations.robot.model, name)
        return 0.0 if name.endswith(DAMPING) else value
    found = _found(equations, name)
    if found is None:
        return 0.0
    i, path = found
    return number_at(acting_parts(equations)[i], path)


def nominal_vector(equations: Equations) -> Array:
    """The values (p,) that the parameters of the equations have in them, SI units."""
    constants = nominal_values(equations.robot.model)
    return np.array([constants[name] if name in constants and not name.endswith(DAMPING) else
                     nominal_value(equations, name) for name in equations.parameters], dtype=float)  # fmt: skip


def _found(equations: Equations, name: str) -> tuple[int, tuple[str, ...]] | None:
    """Place of a number among the equations' effects, then loops, and the path to it there; None where none has it."""
    _, place, rest = name.split(".", 2)
    parts = acting_parts(equations)
    if place == "contacts":
        number, _, rest = rest.partition(".")
        slot = contact_slots(int(number))[0]
        found = [i for i, part in enumerate(parts) if slot in getattr(part, "before", ())]
    else:
        found = [i for i, other in enumerate(equations.places) if other == int(place)]
    for i in found:
        path = path_of(parts[i], rest) or path_of(parts[i], rest.removeprefix("of."))
        return None if path is None else (i, path)
    return None


def contact_slots(i: int) -> tuple[Slot, Slot]:
    """The slots of `before` of contact i, which is sliding."""
    return Slot(f"contact {i}.0"), Slot(f"contact {i}.1")


def contact_numbers(switching: Switching) -> dict[str, float]:
    """The numbers of the law and of the shapes of each contact, by name, such as "effects.contacts.0.friction"."""
    return {PREFIX + ".".join(("contacts", str(i), *path)): value for i, (_, contact) in enumerate(switching.contacts)
            for path, value in numbers_of(contact.constraint(False, contact_slots(i)))}  # fmt: skip


def acting_parts(equations: Equations) -> list[Any]:
    """The equations' effects, then their loops."""
    return [*equations.effects, *(equations.constraints.loops if equations.constraints else ())]
