"""Dual numbers: values with their first derivatives along several directions, over plain arithmetic.

    (a, da) + (b, db) = (a + b, da + db),   (a, da) (b, db) = (a b, da b + a db),   f(a, da) = (f(a), f'(a) da)

A formula run on duals gives its value and its directional derivatives: forward-mode differentiation (Wengert 1964,
Communications of the ACM 7, 463-464). The value is computed once for all directions, and what is constant folds away.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from twolink.algorithms.jets import Jet
from twolink.algorithms.spatial import Scalar, minus, negative, plus, reciprocal, times


class Dual:
    """A value and its derivatives along directions. In arithmetic with jets and arrays it is one of their entries."""

    __slots__ = ("tangents", "value")

    def __init__(self, value: Scalar, tangents: Sequence[Scalar]) -> None:
        self.value, self.tangents = value, tuple(tangents)

    def __add__(self, x: Any) -> Any:
        if isinstance(x, (Jet, np.ndarray)):
            return NotImplemented
        if isinstance(x, Dual):
            pairs = zip(self.tangents, x.tangents, strict=True)
            return Dual(plus(self.value, x.value), [plus(a, b) for a, b in pairs])
        return Dual(plus(self.value, x), self.tangents)

    def __mul__(self, x: Any) -> Any:
        if isinstance(x, (Jet, np.ndarray)):
            return NotImplemented
        if isinstance(x, Dual):
            pairs = zip(self.tangents, x.tangents, strict=True)
            return Dual(times(self.value, x.value), [plus(times(a, x.value), times(self.value, b)) for a, b in pairs])
        return Dual(times(self.value, x), [times(a, x) for a in self.tangents])

    def __neg__(self) -> Dual:
        return Dual(negative(self.value), [negative(a) for a in self.tangents])

    def __sub__(self, x: Any) -> Any:
        return NotImplemented if isinstance(x, (Jet, np.ndarray)) else self + (-x)

    def __rsub__(self, x: Any) -> Any:
        return (-self) + x

    def __truediv__(self, x: Any) -> Any:
        if isinstance(x, (Jet, np.ndarray)):
            return NotImplemented
        return self * (1.0 / x)

    def __rtruediv__(self, x: Any) -> Any:
        return self._inverse(None) * x

    __radd__ = __add__
    __rmul__ = __mul__

    def _inverse(self, xp: Any) -> Dual:
        """1 / self."""
        inverse = reciprocal(self.value, xp)
        return self._of(inverse, negative(times(inverse, inverse)))

    def _of(self, value: Scalar, slope: Scalar) -> Dual:
        """A function's value, with its slope in place of that of self."""
        return Dual(value, [times(slope, a) for a in self.tangents])


class DualNamespace:
    """The functions of another namespace, of duals."""

    def __init__(self, xp: Any) -> None:
        self.xp = xp
        self.both = xp.both

    def sin(self, x: Any) -> Any:
        """The sine."""
        return x._of(self.xp.sin(x.value), self.xp.cos(x.value)) if isinstance(x, Dual) else self.xp.sin(x)

    def cos(self, x: Any) -> Any:
        """The cosine."""
        return x._of(self.xp.cos(x.value), negative(self.xp.sin(x.value))) if isinstance(x, Dual) else self.xp.cos(x)

    def sqrt(self, x: Any) -> Any:
        """The square root."""
        if not isinstance(x, Dual):
            return self.xp.sqrt(x)
        root = self.xp.sqrt(x.value)
        return x._of(root, 0.5 / root)

    def tanh(self, x: Any) -> Any:
        """The hyperbolic tangent."""
        if not isinstance(x, Dual):
            return self.xp.tanh(x)
        value = self.xp.tanh(x.value)
        return x._of(value, minus(1.0, times(value, value)))

    def power(self, x: Any, exponent: float) -> Any:
        """x to a constant power."""
        if not isinstance(x, Dual):
            return self.xp.power(x, exponent)
        return x._of(self.xp.power(x.value, exponent), times(exponent, self.xp.power(x.value, exponent - 1.0)))

    def reciprocal(self, x: Any) -> Any:
        """1 / x."""
        return x._inverse(self.xp) if isinstance(x, Dual) else reciprocal(x, self.xp)

    def less(self, a: Any, b: Any) -> Any:
        """Whether a < b, by the values."""
        return self.xp.less(_value(a), _value(b))

    def less_equal(self, a: Any, b: Any) -> Any:
        """Whether a <= b, by the values."""
        return self.xp.less_equal(_value(a), _value(b))

    def where(self, condition: Any, yes: Any, no: Any) -> Any:
        """The one or the other, with its derivatives."""
        chosen = self.xp.where(condition, _value(yes), _value(no))
        count = max(len(x.tangents) for x in (yes, no, Dual(0.0, ())) if isinstance(x, Dual))
        if not count:
            return chosen
        pairs = zip(_tangents(yes, count), _tangents(no, count), strict=True)
        return Dual(chosen, [0.0 if _zero(a) and _zero(b) else self.xp.where(condition, a, b) for a, b in pairs])

    def lift(self, x: Any) -> Dual:
        """x as a dual, whose value is the other namespace's."""
        return Dual(self.xp.lift(_value(x)), x.tangents if isinstance(x, Dual) else ())


def _value(x: Any) -> Scalar:
    return x.value if isinstance(x, Dual) else x


def _tangents(x: Any, count: int) -> tuple[Scalar, ...]:
    return x.tangents if isinstance(x, Dual) else (0.0,) * count


def _zero(x: Scalar) -> bool:
    return isinstance(x, float) and x == 0.0
