"""The numbers of a scene that are varied: their names, bounds and present values, and the scene with other values."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np

from twolink.algorithms.mechanism import nominal, parameter_names
from twolink.effects.inputs import Sampled
from twolink.errors import SceneError, require_known
from twolink.integrate.effect_numbers import PREFIX, all_effect_numbers
from twolink.scenes import Scene
from twolink.simulation.world_scenes import world_scene


@dataclass(frozen=True, eq=False)
class Variables:
    """k numbers of a scene between bounds.

    names: as sensitivities have them, and of all other numbers of effects. low, high (k,): bounds, SI units. own (k,):
    the values that the scene has.
    """

    scene: Scene
    names: tuple[str, ...]
    low: np.ndarray
    high: np.ndarray
    own: np.ndarray

    @property
    def width(self) -> np.ndarray:
        """high - low, (k,)."""
        return np.asarray(self.high - self.low)

    def named(self, x: np.ndarray) -> dict[str, float]:
        """Values (k,) by name."""
        return dict(zip(self.names, x.tolist(), strict=True))

    def scene_at(self, x: np.ndarray) -> Scene:
        """The scene with these values (k,)."""
        return scene_with(self.scene, self.named(x))


def variables_of(scene: Scene, wrt: Mapping[str, Sequence[float]]) -> Variables:
    """The variables that `wrt` names, with bounds. Raises SceneError."""
    if not isinstance(scene, Scene):
        raise SceneError(f"expected a Scene, got {type(scene).__name__}", argument="scene", remedy="tl.load_scene(...)")
    if not isinstance(wrt, Mapping) or not wrt:
        raise SceneError(f"expected bounds by name, got {wrt!r}", argument="wrt",
                         remedy="such as {'v.elbow': (-1.0, 1.0)}", code="no-variables")  # fmt: skip
    known = values_of(scene)
    bounds = []
    for name, pair in wrt.items():
        require_known(name, known, SceneError, "there is no number {!r} to vary", argument="wrt",
                      code="unknown-variable")  # fmt: skip
        bounds.append(_bounds(name, pair))
    low, high = np.array(bounds).T
    found = Variables(scene, tuple(wrt), low, high, np.array([known[name] for name in wrt]))
    for corner in (low, high):
        found.scene_at(corner)  # refuses what cannot be
    return found


def _bounds(name: str, pair: Any) -> tuple[float, float]:
    """Two bounds. Raises SceneError."""
    numbers = isinstance(pair, Sequence | np.ndarray) and len(pair) == 2
    low, high = (float(bound) for bound in pair) if numbers else (math.nan, math.nan)
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise SceneError(f"expected finite bounds (low, high) with low < high, got {pair!r}", argument="wrt",
                         where=f"wrt[{name!r}]", remedy="such as (-1.0, 1.0)", code="bounds")  # fmt: skip
    return low, high


def values_of(scene: Scene) -> dict[str, float]:
    """The numbers of a scene that can be varied, by name, with the values that they have."""
    values: dict[str, float] = {}
    for joint in scene.robot.joints:
        q, v = scene.q[joint.q], scene.v[joint.v]
        if joint.kind == "cos-sin":
            values[f"q.{joint.name}"] = math.atan2(q[1], q[0])
        elif len(q) == 1:
            values[f"q.{joint.name}"] = float(q[0])
        places = [""] if len(v) == 1 else [f".{k}" for k in range(len(v))]
        values.update({f"v.{joint.name}{place}": float(rate) for place, rate in zip(places, v, strict=True)})
    values.update({name: nominal(scene.robot.model, name) for name in parameter_names(scene.robot.model)})
    values.update(all_effect_numbers(scene))
    for place, effect in enumerate(scene.effects):
        values.update({PREFIX + f"{place}.{path}": value for path, value in _tables(effect)})
    return values


def _tables(value: Any, path: str = "") -> Iterator[tuple[str, float]]:
    """The values of the tables in an effect, with the paths to them."""
    if isinstance(value, Sampled):
        for i, number in enumerate(value.values):
            yield f"{path}values.{i}", float(number)
    elif isinstance(value, msgspec.Struct):
        for name in value.__struct_fields__:
            yield from _tables(getattr(value, name), f"{path}{name}.")
    elif isinstance(value, Mapping):
        for key, part in value.items():
            yield from _tables(part, f"{path}{key}.")
    elif isinstance(value, tuple | list):
        for i, part in enumerate(value):
            yield from _tables(part, f"{path}{i}.")


def scene_with(scene: Scene, values: Mapping[str, float]) -> Scene:
    """The scene with these values of numbers by name."""
    q, v, others = scene.q.copy(), scene.v.copy(), dict(values)
    for joint in scene.robot.joints:
        angle = others.pop(f"q.{joint.name}", None)
        if angle is not None:
            q[joint.q] = joint.configuration(angle)
        rates = range(joint.v.start, joint.v.stop)
        for k, entry in enumerate(rates):
            v[entry] = others.pop(f"v.{joint.name}" if len(rates) == 1 else f"v.{joint.name}.{k}", v[entry])
    moved = Scene(scene.base, q, v, scene.effects, scene.duration, scene.title)
    return world_scene(moved, others) if others else moved


def derivative_of(scene: Scene, name: str) -> tuple[str, int]:
    """The name and the column of sensitivities that belong to a variable: v.JOINT.2 is column 2 of v.JOINT."""
    several = {f"v.{joint.name}" for joint in scene.robot.joints if joint.v.stop - joint.v.start > 1}
    head, _, column = name.rpartition(".")
    return (head, int(column)) if head in several else (name, 0)
