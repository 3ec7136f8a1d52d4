"""The numbers of a scene that are varied: their names, bounds and present values, and the scene with other values."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from twolink.errors import SceneError
from twolink.scenes import Scene
from twolink.scenes.parameters import named_parameters, scene_with


@dataclass(frozen=True, eq=False)
class Variables:
    """k numbers of a scene between bounds.

    names: as `scenes.parameters` has them. low, high (k,): bounds, SI units. own (k,):
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
    own = np.array([parameter.nominal for parameter in named_parameters(scene, wrt, "wrt")])
    low, high = np.array([_bounds(name, pair) for name, pair in wrt.items()]).T
    found = Variables(scene, tuple(wrt), low, high, own)
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
