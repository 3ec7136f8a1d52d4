"""Dual numbers: values with their first derivatives along several directions, over plain arithmetic.

    (a, da) + (b, db) = (a + b, da + db),   (a, da) (b, db) = (a b, da b + a db),   f(a, da) = (f(a), f'(a) da)

A formula run on duals gives its value and its directional derivatives: forward-mode differentiation (Wengert 1964,
Communications of the ACM 7, 463-464). The value is computed once for all directions, and what is constant folds away.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from twolink.algorithms.differentiated import Differentiated, DifferentiatedNamespace
from twolink.algorithms.jets import Jet
from twolink.algorithms.spatial import Scalar, negative, plus, times


class Dual(Differentiated):
    """A value and its derivatives along directions."""

    __slots__ = ("tangents",)

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

    __radd__ = __add__
    __rmul__ = __mul__

    def function(self, value: Scalar, slope: Scalar) -> Dual:
        """A function's value, with its slope in place of that of self."""
        return Dual(value, [times(slope, a) for a in self.tangents])


class DualNamespace(DifferentiatedNamespace):
    """The functions of another namespace, of duals."""

    kind = Dual

    def where(self, condition: Any, yes: Any, no: Any) -> Any:
        """The one or the other, with its derivatives."""
        chosen = self.xp.where(condition, self.value_of(yes), self.value_of(no))
        count = max(len(x.tangents) for x in (yes, no, Dual(0.0, ())) if isinstance(x, Dual))
        if not count:
            return chosen
        pairs = zip(_tangents(yes, count), _tangents(no, count), strict=True)
        return Dual(chosen, [0.0 if _zero(a) and _zero(b) else self.xp.where(condition, a, b) for a, b in pairs])

    def lift(self, x: Any) -> Dual:
        """x as a dual, whose value is the other namespace's."""
        return Dual(self.xp.lift(self.value_of(x)), x.tangents if isinstance(x, Dual) else ())


def _tangents(x: Any, count: int) -> tuple[Scalar, ...]:
    return x.tangents if isinstance(x, Dual) else (0.0,) * count


def _zero(x: Scalar) -> bool:
    return isinstance(x, float) and x == 0.0
