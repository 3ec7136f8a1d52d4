"""What a sweep can vary, by name: initial states, physical parameters, numbers of effects, effects, accuracy."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from twolink.algorithms.mechanism import parameter_names, split_name
from twolink.dynamics import load_robot
from twolink.dynamics.named_queries import joint_columns
from twolink.errors import SceneError, require_known
from twolink.integrate.effect_numbers import PREFIX, all_effect_numbers
from twolink.io.text import kebab_case
from twolink.robots.joint_layout import turns
from twolink.scenes import Scene

Kind = Literal["q", "v", "parameter", "effect", "accuracy", "robot"]
_UNITS = {"mass": "kg", "com": "m", "inertia": "kg m^2", "origin": "m", "gravity": "m/s^2"}


@dataclass(frozen=True)
class Quantity:
    """A quantity that differs by run.

    entries: of q or v, those that a value sets: two for the angle of a continuous joint. units and description: for
    attributes. place: of an effect that is on or off.
    """

    name: str
    kind: Kind
    units: str
    description: str
    entries: tuple[int, ...] = ()
    place: int = -1


def quantity(scene: Scene, name: str) -> Quantity:
    """The quantity of a name.

    Parameters
    ----------
    scene : Scene
    name : str
        "q.JOINT" or "v.JOINT" (numbered, "v.JOINT.0", where a joint has several), a physical parameter or a number of
        an effect as in `simulate_many`, "effects.1" for an effect that is on or off, "accuracy", or "robot" for other
        robots under the same effects.

    Raises
    ------
    SceneError
        The name is unknown; code "unknown-quantity".
    """
    known = quantities(scene)
    require_known(name, known, SceneError, "there is nothing named {!r} to vary", argument="vary",
                  code="unknown-quantity")  # fmt: skip
    return known[name]


def quantities(scene: Scene) -> dict[str, Quantity]:
    """All that can be varied, by name."""
    return _states(scene) | _others(scene)


def _states(scene: Scene) -> dict[str, Quantity]:
    robot, found = scene.robot, dict[str, Quantity]()
    for joint in robot.joints:
        angle = turns(robot.model, joint)
        unit = ("rad" if angle else "m") if joint.v.stop - joint.v.start == 1 else "rad or m"
        for letter, part, units in (("q", joint.q, unit), ("v", joint.v, f"{unit.replace(' or m', '/s or m')}/s")):
            what = f"{'configuration' if letter == 'q' else 'velocity'} of joint {joint.name} at the start"
            if letter == "q" and joint.kind == "cos-sin":
                found[f"q.{joint.name}"] = Quantity(f"q.{joint.name}", "q", "rad", what, tuple(range(*_span(part))))
                continue
            fixed = joint.unit or slice(0, 0)  # entries of length 1 are not free
            for i, (column, _) in enumerate(joint_columns([joint], letter), part.start):
                if letter == "v" or not fixed.start <= i < fixed.stop:
                    found[column] = Quantity(column, "q" if letter == "q" else "v", units, what, (i,))
    return found


def _others(scene: Scene) -> dict[str, Quantity]:
    found = {}
    for name in parameter_names(scene.robot.model):
        owner, part, entry = split_name(name)
        what = f"{part}.{entry} of {owner}" if owner and entry else f"{entry or part} of {owner or part}"
        found[name] = Quantity(name, "parameter", _UNITS.get(part, "SI units"), what)
    for name in all_effect_numbers(scene):
        place, _, path = name.removeprefix(PREFIX).partition(".")
        kind = kebab_case(type(scene.effects[int(place)]).__name__)
        found[name] = Quantity(name, "parameter", "SI units", f"{path} of effect {place}, {kind}")
    for i, effect in enumerate(scene.effects):
        text = f"whether effect {i}, {kebab_case(type(effect).__name__)}, acts"
        found[f"{PREFIX}{i}"] = Quantity(f"{PREFIX}{i}", "effect", "1", text, place=i)
    found["accuracy"] = Quantity("accuracy", "accuracy", "rad or m", "accuracy asked for")
    found["robot"] = Quantity("robot", "robot", "", "robot, from random_state(1, seed=0)")
    return found


def _span(part: slice) -> tuple[int, int]:
    return part.start, part.stop


def as_values(asked: Quantity, values: Any) -> np.ndarray:
    """Values of a quantity as an array (n,): booleans for effects, names of robots, else floats. Raises SceneError."""
    where = f"vary[{asked.name!r}]"
    array = np.asarray(values)
    if asked.kind == "effect":
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
class Cells:
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


def cells(
    scene: Scene, off: tuple[int, ...], accuracy: float, quantities: Mapping[str, Quantity],
    values: Mapping[str, np.ndarray],
) -> Cells:  # fmt: skip
    """The runs with these values (n,) by name of a variant of a scene, without the effects that are `off`."""
    count = len(next(iter(values.values())))
    q, v = np.tile(scene.q, (count, 1)), np.tile(scene.v, (count, 1))
    parameters = {}
    for name, numbers in values.items():
        what = quantities[name]
        if what.kind in ("q", "v"):
            state = q if what.kind == "q" else v
            angle = len(what.entries) == 2
            state[:, what.entries] = np.stack([np.cos(numbers), np.sin(numbers)], 1) if angle else numbers[:, None]
        elif what.kind == "parameter" and (new := renamed(name, off)) is not None:
            parameters[new] = numbers
    return Cells(scene, accuracy, q, v, parameters)
