"""What values with derivatives have in common, forward (`duals`) or reverse (`reverse`): arithmetic and functions."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from twolink.algorithms.jets import Jet
from twolink.algorithms.spatial import Scalar, minus, negative, reciprocal, times


class Differentiated:
    """A value with derivatives. In arithmetic with jets and arrays it is one of their entries."""

    __slots__ = ("value",)
    value: Scalar

    def function(self, value: Scalar, slope: Scalar) -> Any:
        """A function's value, and its slope by self."""
        raise NotImplementedError

    def __add__(self, x: Any) -> Any:
        raise NotImplementedError

    def __mul__(self, x: Any) -> Any:
        raise NotImplementedError

    def __neg__(self) -> Any:
        raise NotImplementedError

    def __sub__(self, x: Any) -> Any:
        return NotImplemented if isinstance(x, (Jet, np.ndarray)) else self + (-x)

    def __rsub__(self, x: Any) -> Any:
        return (-self) + x

    def __truediv__(self, x: Any) -> Any:
        if isinstance(x, (Jet, np.ndarray)):
            return NotImplemented
        return self * (1.0 / x)

    def __rtruediv__(self, x: Any) -> Any:
        return self.inverse(None) * x

    def inverse(self, xp: Any) -> Any:
        """1 / self."""
        inverse = reciprocal(self.value, xp)
        return self.function(inverse, negative(times(inverse, inverse)))


class DifferentiatedNamespace:
    """The functions of another namespace, of values with derivatives of one kind."""

    kind: ClassVar[type[Differentiated]]

    def __init__(self, xp: Any) -> None:
        self.xp = xp
        self.both = xp.both

    def value_of(self, x: Any) -> Any:
        """x without its derivatives."""
        return x.value if isinstance(x, self.kind) else x

    def sin(self, x: Any) -> Any:
        """The sine."""
        if not isinstance(x, self.kind):
            return self.xp.sin(x)
        return x.function(self.xp.sin(x.value), self.xp.cos(x.value))

    def cos(self, x: Any) -> Any:
        """The cosine."""
        if not isinstance(x, self.kind):
            return self.xp.cos(x)
        return x.function(self.xp.cos(x.value), negative(self.xp.sin(x.value)))

    def sqrt(self, x: Any) -> Any:
        """The square root."""
        if not isinstance(x, self.kind):
            return self.xp.sqrt(x)
        root = self.xp.sqrt(x.value)
        return x.function(root, 0.5 / root)

    def tanh(self, x: Any) -> Any:
        """The hyperbolic tangent."""
        if not isinstance(x, self.kind):
            return self.xp.tanh(x)
        value = self.xp.tanh(x.value)
        return x.function(value, minus(1.0, times(value, value)))

    def power(self, x: Any, exponent: float) -> Any:
        """x to a constant power."""
        if not isinstance(x, self.kind):
            return self.xp.power(x, exponent)
        return x.function(self.xp.power(x.value, exponent), times(exponent, self.xp.power(x.value, exponent - 1.0)))

    def reciprocal(self, x: Any) -> Any:
        """1 / x."""
        return x.inverse(self.xp) if isinstance(x, self.kind) else reciprocal(x, self.xp)

    def less(self, a: Any, b: Any) -> Any:
        """Whether a < b, by the values."""
        return self.xp.less(self.value_of(a), self.value_of(b))

    def less_equal(self, a: Any, b: Any) -> Any:
        """Whether a <= b, by the values."""
        return self.xp.less_equal(self.value_of(a), self.value_of(b))
