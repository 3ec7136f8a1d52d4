"""Gravity: a uniform field."""

import math
from numbers import Real

import numpy as np
import pinocchio as pin

from twolink.effects.effect import Effect
from twolink.errors import SceneError


class Gravity(Effect, frozen=True):
    """A uniform gravity field g: each body of mass m feels the force m g at its centre of mass.

    Parameters
    ----------
    field : (3,) floats
        g, m/s^2, along the world's axes; z points up.
    """

    field: tuple[float, float, float] = (0.0, 0.0, -9.81)

    def __post_init__(self) -> None:
        three = isinstance(self.field, (tuple, list, np.ndarray)) and len(self.field) == 3
        if not (three and all(isinstance(g, Real) and math.isfinite(g) for g in self.field)):
            remedy = "give m/s^2, such as (0, 0, -9.81)"
            raise SceneError(f"expected 3 finite numbers, got {self.field!r}", where="gravity.field", remedy=remedy)

    def change(self, model: pin.Model) -> None:
        """Set the model's field, which every query then uses."""
        model.gravity.linear = np.array(self.field)
