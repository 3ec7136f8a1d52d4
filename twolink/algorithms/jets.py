"""Jets: values with their first time derivatives, as truncated Taylor series over plain arithmetic.

A formula of q run on the jets of q(t) gives its rate and its acceleration: with q'' = 0 in the joint velocities, the
first coefficient of a constraint g(q) is J v, and twice the second one is J' v. What is constant folds away.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from twolink.algorithms.spatial import Scalar, minus, negative, plus, times


class Jet:
    """c_0 + c_1 t + c_2 t^2 + ..., truncated after the given coefficients."""

    __slots__ = ("c",)
    __array_ufunc__ = None  # an array times a jet is a jet, not an array of jets

    def __init__(self, coefficients: Sequence[Scalar]) -> None:
        self.c: tuple[Scalar, ...] = tuple(coefficients)

    def _other(self, x: Any) -> tuple[Scalar, ...]:
        return x.c if isinstance(x, Jet) else (x, *(0.0 for _ in self.c[1:]))

    def __add__(self, x: Any) -> Jet:
        return Jet([plus(a, b) for a, b in zip(self.c, self._other(x), strict=True)])

    def __sub__(self, x: Any) -> Jet:
        return Jet([minus(a, b) for a, b in zip(self.c, self._other(x), strict=True)])

    def __rsub__(self, x: Any) -> Jet:
        return (-self).__add__(x)

    def __neg__(self) -> Jet:
        return Jet([negative(a) for a in self.c])

    def __mul__(self, x: Any) -> Jet:
        other = self._other(x)
        return Jet([
            plus(*(times(self.c[i], other[k - i]) for i in range(k + 1)))
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
        """Whether a < b now."""
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
