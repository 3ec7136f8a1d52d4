"""Values with derivatives over plain arithmetic, dual numbers and jets; and derivatives by differences.

A formula of q run on the jets of q(t) gives its rate and its acceleration: with q'' = 0 in the joint velocities, the
first coefficient of a constraint g(q) is J v, and twice the second one is J' v. What is constant folds away.

    (a, da) + (b, db) = (a + b, da + db),   (a, da) (b, db) = (a b, da b + a db),   f(a, da) = (f(a), f'(a) da)

A formula run on duals gives its value and its directional derivatives: forward-mode differentiation (Wengert 1964,
Communications of the ACM 7, 463-464). The value is computed once for all directions, and what is constant folds away.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from twolink.algorithms.spatial import Scalar, is_zero, minus, negative, plus, reciprocal, times


class Jet:
    """c_0 + c_1 t + c_2 t^2 + ..., truncated after the given coefficients."""

    __slots__ = ("c",)
    __array_ufunc__ = None  # an array times a jet is a jet, not an array of jets

    def __init__(self, coefficients: Sequence[Scalar]) -> None:
        self.c: tuple[Scalar, ...] = tuple(coefficients)

    def __add__(self, x: Any) -> Jet:
        if not isinstance(x, Jet):
            return Jet([plus(self.c[0], x), *self.c[1:]])
        return Jet([plus(a, b) for a, b in zip(self.c, x.c, strict=True)])

    def __sub__(self, x: Any) -> Jet:
        return self.__add__(-x)

    def __rsub__(self, x: Any) -> Jet:
        return (-self).__add__(x)

    def __neg__(self) -> Jet:
        return Jet([negative(a) for a in self.c])

    def __mul__(self, x: Any) -> Jet:
        if not isinstance(x, Jet):
            return Jet([times(a, x) for a in self.c])
        return Jet([
            plus(*(times(self.c[i], x.c[k - i]) for i in range(k + 1)))
            for k in range(len(self.c))
        ])  # fmt: skip

    def __truediv__(self, x: Any) -> Jet:
        return self.__mul__(x.inverse() if isinstance(x, Jet) else 1.0 / x)

    def __rtruediv__(self, x: Any) -> Jet:
        return self.inverse().__mul__(x)

    __radd__ = __add__
    __rmul__ = __mul__

    def inverse(self) -> Jet:
        """1 / self, by the recurrence sum_i c_i d_(k-i) = 0."""
        first = 1.0 / self.c[0]
        out = [first]
        for k in range(1, len(self.c)):
            rest = plus(*(times(self.c[i], out[k - i]) for i in range(1, k + 1)))
            out.append(negative(times(rest, first)))
        return Jet(out)


class JetNamespace:
    """sin, cos, sqrt and choices of jets, by those of another namespace. Jets must not be NumPy's to broadcast."""

    def __init__(self, xp: Any) -> None:
        self.xp = xp

    def _both(self, x: Any) -> tuple[Any, Any]:
        if not isinstance(x, Jet):
            return self.xp.sin(x), self.xp.cos(x)
        s, c = [self.xp.sin(x.c[0])], [self.xp.cos(x.c[0])]
        for k in range(1, len(x.c)):  # s' = x' c, c' = -x' s
            s.append(times(1.0 / k, plus(*(times(times(float(j), x.c[j]), c[k - j]) for j in range(1, k + 1)))))
            c.append(times(-1.0 / k, plus(*(times(times(float(j), x.c[j]), s[k - j]) for j in range(1, k + 1)))))
        return Jet(s), Jet(c)

    def sin(self, x: Any) -> Any:
        """The sine."""
        return self._both(x)[0]

    def cos(self, x: Any) -> Any:
        """The cosine."""
        return self._both(x)[1]

    def sqrt(self, x: Any) -> Any:
        """The square root r, by the recurrence of r r = x."""
        if not isinstance(x, Jet):
            return self.xp.sqrt(x)
        r = [self.xp.sqrt(x.c[0])]
        half = 0.5 / r[0]
        for k in range(1, len(x.c)):
            r.append(times(half, minus(x.c[k], plus(*(times(r[i], r[k - i]) for i in range(1, k))))))
        return Jet(r)

    def less(self, a: Any, b: Any) -> Any:
        """True if a < b, by the coefficients of order 0."""
        return self.xp.less(coefficient(a, 0), coefficient(b, 0))

    def where(self, condition: Any, yes: Any, no: Any) -> Any:
        """One of two jets, all of its coefficients."""
        size = max(len(x.c) if isinstance(x, Jet) else 0 for x in (yes, no))
        if not size:
            return self.xp.where(condition, yes, no)
        return Jet([self.xp.where(condition, coefficient(yes, k), coefficient(no, k)) for k in range(size)])


def coefficient(x: Any, k: int) -> Scalar:
    """The k-th coefficient of a jet, or of a constant."""
    return x.c[k] if isinstance(x, Jet) else (x if k == 0 else 0.0)


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
        return self.inverse(None) * x

    __radd__ = __add__
    __rmul__ = __mul__

    def function(self, value: Scalar, slope: Scalar) -> Dual:
        """A function's value, with its slope in place of that of self."""
        return Dual(value, [times(slope, a) for a in self.tangents])

    def inverse(self, xp: Any) -> Any:
        """1 / self."""
        inverse = reciprocal(self.value, xp)
        return self.function(inverse, negative(times(inverse, inverse)))


def _of_duals(name: str, slope: Callable[[Any, Scalar, Scalar], Scalar]) -> Callable[[Any, Any], Any]:
    """A function of another namespace, of duals; its slope by that namespace, of x and the function's value."""

    def function(self: DualNamespace, x: Any) -> Any:
        own = getattr(self.xp, name)
        if not isinstance(x, Dual):
            return own(x)
        value = own(x.value)
        return x.function(value, slope(self.xp, x.value, value))

    return function


class DualNamespace:
    """The functions of another namespace, of duals with so many directions."""

    sin = _of_duals("sin", lambda xp, x, _: xp.cos(x))
    cos = _of_duals("cos", lambda xp, x, _: negative(xp.sin(x)))
    sqrt = _of_duals("sqrt", lambda _, __, root: 0.5 / root)
    exp = _of_duals("exp", lambda _, __, value: value)
    tanh = _of_duals("tanh", lambda _, __, value: minus(1.0, times(value, value)))

    def __init__(self, xp: Any, directions: int = 1) -> None:
        self.xp, self._directions = xp, directions
        self.both = xp.both

    def value_of(self, x: Any) -> Any:
        """x without its derivatives."""
        return x.value if isinstance(x, Dual) else x

    def power(self, x: Any, exponent: float) -> Any:
        """x to a constant power."""
        if not isinstance(x, Dual):
            return self.xp.power(x, exponent)
        return x.function(self.xp.power(x.value, exponent), times(exponent, self.xp.power(x.value, exponent - 1.0)))

    def reciprocal(self, x: Any) -> Any:
        """1 / x."""
        return x.inverse(self.xp) if isinstance(x, Dual) else reciprocal(x, self.xp)

    def less(self, a: Any, b: Any) -> Any:
        """True if a < b, by the values."""
        return self.xp.less(self.value_of(a), self.value_of(b))

    def less_equal(self, a: Any, b: Any) -> Any:
        """True if a <= b, by the values."""
        return self.xp.less_equal(self.value_of(a), self.value_of(b))

    def where(self, condition: Any, yes: Any, no: Any) -> Any:
        """The one or the other, with its derivatives."""
        chosen = self.xp.where(condition, self.value_of(yes), self.value_of(no))
        count = max(len(x.tangents) for x in (yes, no, Dual(0.0, ())) if isinstance(x, Dual))
        if not count:  # an array is no entry beside duals
            return Dual(chosen, [0.0] * self._directions) if isinstance(chosen, np.ndarray) else chosen
        pairs = zip(_tangents(yes, count), _tangents(no, count), strict=True)
        return Dual(chosen, [0.0 if is_zero(a) and is_zero(b) else self.xp.where(condition, a, b) for a, b in pairs])

    def lift(self, x: Any) -> Dual:
        """x as a dual, whose value is the other namespace's."""
        return Dual(self.xp.lift(self.value_of(x)), x.tangents if isinstance(x, Dual) else ())


def _tangents(x: Any, count: int) -> tuple[Scalar, ...]:
    return x.tangents if isinstance(x, Dual) else (0.0,) * count


def derivative(function: Callable[[float], Any], step: float) -> Any:
    """The derivative at 0 of a function by central differences, whose error is the fourth power of the step.

    function(k): its value, a number or an array, at k steps.
    """
    near, far = (function(k) - function(-k) for k in (1.0, 2.0))
    return (8.0 * near - far) / (12.0 * step)
