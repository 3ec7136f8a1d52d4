"""What plain arithmetic lacks, in two namespaces of equal names: arrays of numbers, and heyoka's expressions.

A formula is written once over a namespace xp. NumPy's numbers run it; expressions, alone or in arrays of objects,
compile it.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from twolink.algorithms.sincos import LIMIT, sin_cos

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
    """The same of heyoka's expressions.

    module: heyoka. own_sine: use the sine and cosine of `algorithms.sincos`, which keep whole vectors in registers but
    reach only to LIMIT, and whose rounding cannot be differentiated. `reach` then holds the squares of their angles by
    the angles' text; equal angles are reduced once, since heyoka keeps one of equal subexpressions.
    """

    def __init__(self, module: Any, *, own_sine: bool = False) -> None:
        self.module = module
        self.reach: dict[str, Any] = {}
        self.sqrt, self.exp, self.tanh, self.atan2 = module.sqrt, module.exp, module.tanh, module.atan2
        self.sin = self._bounded(0) if own_sine else module.sin
        self.cos = self._bounded(1) if own_sine else module.cos
        self.where = np.frompyfunc(self._select, 3, 1)
        self.less = np.frompyfunc(lambda a, b: module.lt(self.lift(a), self.lift(b)), 2, 1)
        self.less_equal = np.frompyfunc(lambda a, b: module.lte(self.lift(a), self.lift(b)), 2, 1)

    def _bounded(self, which: int) -> Callable[[Any], Any]:
        def of_angle(x: Any) -> Any:
            if isinstance(x, self.module.expression):
                self.reach[str(x)] = x * x
            return sin_cos(x)[which]

        return of_angle

    def lift(self, x: Any) -> Any:
        """x as an expression."""
        return x if isinstance(x, self.module.expression) else self.module.expression(float(x))

    def reciprocal(self, x: Any) -> Any:
        """1 / x of a positive x, such as an inertia. Behind a condition it stays one division for all its uses."""
        return self.module.select(self.module.gt(x, self.lift(0.0)), 1.0 / x, self.lift(math.nan))

    def within_reach(self, x: Array) -> Array:
        """x, or NaN where an angle is beyond the reach of `sin_cos`."""
        if not self.reach:
            return x
        total = self.module.sum(list(self.reach.values()))
        return np.asarray(self.where(self.less(total, LIMIT**2), x, np.nan))

    def _select(self, condition: Any, yes: Any, no: Any) -> Any:
        return self.module.select(condition, self.lift(yes), self.lift(no))

    def both(self, a: Any, b: Any) -> Any:
        """Whether both hold."""
        return self.module.logical_and([a, b])

    @staticmethod
    def power(x: Any, exponent: float) -> Any:
        """x to a constant power."""
        return x**exponent
