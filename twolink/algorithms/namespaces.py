"""What plain arithmetic lacks, in two namespaces of equal names: arrays of numbers, and arrays of expressions.

Steps and their control are written once over arrays x (size,) or (size, worlds): NumPy's floats for the portable way,
objects that are heyoka's expressions for the compiled one.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from twolink.algorithms import sincos

Array = np.ndarray[Any, np.dtype[Any]]


class Numbers:
    """sin, cos, sqrt, tanh, and choices by condition, of NumPy arrays."""

    sin, cos, sqrt, tanh = np.sin, np.cos, np.sqrt, np.tanh
    less, less_equal, both = np.less, np.less_equal, np.logical_and

    @staticmethod
    def where(condition: Any, yes: Any, no: Any) -> Any:
        """yes where the condition holds, else no."""
        return np.where(condition, yes, no)

    @staticmethod
    def power(x: Any, exponent: float) -> Any:
        """x to a constant power."""
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            return np.power(x, exponent)


class Expressions(sincos.Traced):
    """The same of heyoka's expressions.

    own_sine: take the sine and cosine of `dynamics.sincos`, which keep whole vectors in registers but reach only to
    sincos.LIMIT, and whose rounding cannot be differentiated.
    """

    def __init__(self, module: Any, *, own_sine: bool = False) -> None:
        super().__init__(module, own_sine=own_sine)
        self._where = np.frompyfunc(self._select, 3, 1)
        self.less = np.frompyfunc(lambda a, b: module.lt(self.lift(a), self.lift(b)), 2, 1)
        self.less_equal = np.frompyfunc(lambda a, b: module.lte(self.lift(a), self.lift(b)), 2, 1)
        self.tanh = module.tanh

    def within_reach(self, x: Array) -> Array:
        """x, or NaN where an angle was beyond the reach of our sine."""
        if not self.reach:
            return x
        total = self.module.sum(list(self.reach.values()))
        return np.asarray(self.where(self.less(total, sincos.LIMIT**2), x, np.nan))

    def _select(self, condition: Any, yes: Any, no: Any) -> Any:
        return self.module.select(condition, self.lift(yes), self.lift(no))

    def where(self, condition: Any, yes: Any, no: Any) -> Any:
        """yes where the condition holds, else no."""
        return self._where(condition, yes, no)

    def both(self, a: Any, b: Any) -> Any:
        """Whether both hold."""
        return self.module.logical_and([a, b])

    @staticmethod
    def power(x: Any, exponent: float) -> Any:
        """x to a constant power."""
        return x**exponent
