"""What a sweep can vary, by name: parameters of the scene, effects that are on or off, accuracy, and the robot."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from twolink.dynamics import load_robot
from twolink.errors import SceneError
from twolink.io.text import kebab_case
from twolink.scenes import Scene
from twolink.scenes.parameters import PREFIX, Parameter, named_parameters, parameters_of

OF_VARIANTS = ("switch", "accuracy", "robot")


def named_quantities(scene: Scene, names: Iterable[str]) -> dict[str, Parameter]:
    """What names of a sweep stand for: numbers of the scene (`scenes.parameters`), or what makes a variant of it.

    These are "effects.1" for an effect that is on or off, "accuracy", and "robot" for other robots under the same
    effects. Raises SceneError for an unknown name, code "unknown-parameter".
    """
    of_variants, names = _of_variants(scene), list(names)
    numbers = named_parameters(scene, [name for name in names if name not in of_variants], "vary", of_variants)
    known = of_variants | {number.name: number for number in numbers}
    return {name: known[name] for name in names}


def quantities(scene: Scene) -> dict[str, Parameter]:
    """All that can be varied, by name, without values of tables."""
    return parameters_of(scene) | _of_variants(scene)


def _of_variants(scene: Scene) -> dict[str, Parameter]:
    """What makes another variant of the scene."""
    found = [Parameter("accuracy", "accuracy", math.nan, "rad or m", "accuracy asked for"),
             Parameter("robot", "robot", math.nan, "", "robot, from random_state(1, seed=0)")]  # fmt: skip
    for i, effect in enumerate(scene.effects):
        text = f"whether effect {i}, {kebab_case(type(effect).__name__)}, acts"
        found.append(Parameter(f"{PREFIX}{i}", "switch", math.nan, "1", text, entries=(i,)))
    return {one.name: one for one in found}


def as_values(asked: Parameter, values: Any) -> np.ndarray:
    """Values of a quantity as an array (n,): booleans for effects, names of robots, else floats. Raises SceneError."""
    where = f"vary[{asked.name!r}]"
    array = np.asarray(values)
    if asked.kind == "switch":
        if array.dtype != bool or array.ndim != 1 or not array.size:
            raise SceneError(f"expected true or false, got {values!r:.60}", where=where, argument="vary",
                             remedy="such as [False, True]")  # fmt: skip
        return array
    if asked.kind == "robot":
        if array.dtype.kind not in "UO" or array.ndim != 1 or not all(isinstance(x, str) for x in array.tolist()):
            raise SceneError(f"expected names of robots, got {values!r:.60}", where=where, argument="vary",
                             remedy='such as ["panda", "ur5"]')  # fmt: skip
        return array.astype(object)
    if array.dtype.kind not in "fiu" or array.ndim != 1 or not array.size or not np.isfinite(array).all():
        raise SceneError(f"expected finite numbers (n,), got {values!r:.60}", where=where, argument="vary",
                         remedy="such as [0.5, 1.0, 1.5]")  # fmt: skip
    if asked.kind == "accuracy" and (array <= 0.0).any():
        raise SceneError(f"expected numbers above 0, got {float(array.min()):g}", where=where, argument="vary",
                         remedy="such as [1e-3, 1e-6]")  # fmt: skip
    return np.asarray(array, dtype=float)


@dataclass(frozen=True, eq=False)
class RunInputs:
    """Runs of one variant of a scene, which differ in numbers.

    scene: without the effects that are off. accuracy: of all. q (n, nq), v (n, nv): the starts. parameters: values (n,)
    by name, in the numbering of the variant's effects.
    """

    scene: Scene
    accuracy: float
    q: np.ndarray
    v: np.ndarray
    parameters: dict[str, np.ndarray]


def variant(scene: Scene, off: tuple[int, ...], robot: str = "") -> Scene:
    """The scene without the effects at these places, and with another robot; the same object where nothing differs."""
    effects = [effect for place, effect in enumerate(scene.effects) if place not in off]
    if robot:
        base = load_robot(robot)
        q, v = base.random_state(1, seed=0)
        return Scene(base, q[0], v[0], effects, scene.duration, scene.title)
    return scene.with_effects(effects) if off else scene


def renamed(name: str, off: tuple[int, ...]) -> str | None:
    """A parameter's name in the variant without the effects at these places; None for one of theirs."""
    if not name.startswith(PREFIX):
        return name
    place, _, path = name.removeprefix(PREFIX).partition(".")
    if int(place) in off:
        return None
    return f"{PREFIX}{int(place) - sum(other < int(place) for other in off)}.{path}"


def run_inputs(
    scene: Scene, off: tuple[int, ...], accuracy: float, quantities: Mapping[str, Parameter],
    values: Mapping[str, np.ndarray],
) -> RunInputs:  # fmt: skip
    """The runs with these values (n,) by name of a variant of a scene, without the effects that are `off`."""
    count = len(next(iter(values.values())))
    q, v = np.tile(scene.q, (count, 1)), np.tile(scene.v, (count, 1))
    parameters = {}
    for name, numbers in values.items():
        what = quantities[name]
        if what.kind in ("q", "v"):
            what.put(q, v, numbers)
        elif what.kind not in OF_VARIANTS and (new := renamed(name, off)) is not None:
            parameters[new] = numbers
    return RunInputs(scene, accuracy, q, v, parameters)
