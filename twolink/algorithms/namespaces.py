"""Functions that plain arithmetic lacks, in two namespaces of equal names: arrays of numbers, and heyoka's expressions.

A formula is written once over a namespace xp. NumPy's numbers run it; expressions, alone or in arrays of objects,
compile it.
"""

import math
from typing import Any

import numpy as np

Array = np.ndarray[Any, np.dtype[Any]]


class Numbers:
    """sin, cos, sqrt, exp, tanh, atan2, and choices by condition, of NumPy arrays."""

    sin, cos, sqrt, exp, tanh, atan2 = np.sin, np.cos, np.sqrt, np.exp, np.tanh, np.arctan2
    less, less_equal, both, where = np.less, np.less_equal, np.logical_and, np.where

    @staticmethod
    def power(x: Any, exponent: float) -> Any:
        """x to a constant power."""
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            return np.power(x, exponent)


class Expressions:
    """The namespace of heyoka's expressions.

    module: heyoka.
    """

    def __init__(self, module: Any) -> None:
        self.module, self.sin, self.cos = module, module.sin, module.cos
        self.sqrt, self.exp, self.tanh, self.atan2 = module.sqrt, module.exp, module.tanh, module.atan2
        self.where = np.frompyfunc(self._select, 3, 1)
        self.less = np.frompyfunc(lambda a, b: module.lt(self.lift(a), self.lift(b)), 2, 1)
        self.less_equal = np.frompyfunc(lambda a, b: module.lte(self.lift(a), self.lift(b)), 2, 1)

    def lift(self, x: Any) -> Any:
        """x as an expression."""
        return x if isinstance(x, self.module.expression) else self.module.expression(float(x))

    def reciprocal(self, x: Any) -> Any:
        """1 / x of a positive x, such as an inertia. Behind a condition it stays one division for all its uses."""
        return self.module.select(self.module.gt(x, self.lift(0.0)), 1.0 / x, self.lift(math.nan))

    def _select(self, condition: Any, yes: Any, no: Any) -> Any:
        return self.module.select(condition, self.lift(yes), self.lift(no))

    def both(self, a: Any, b: Any) -> Any:
        """The conjunction of two conditions."""
        return self.module.logical_and([a, b])

    @staticmethod
    def power(x: Any, exponent: float) -> Any:
        """x to a constant power."""
        return x**exponent
