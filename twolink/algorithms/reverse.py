"""Reverse-mode differentiation over plain arithmetic: the derivatives of a weighted sum of results by all inputs.

    y = f(x),   x_bar = sum_k w_k dy_k/dx

A formula run on nodes records what each value was made of, with the partial derivatives. Going back through the record
gives the derivatives by all inputs for a few times the operations of the value, however many inputs there are
(Linnainmaa 1976, BIT 16, 146-160; Griewank and Walther, Evaluating Derivatives, 2008, chapter 3). What is constant
folds away.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from twolink.algorithms.jets import Jet
from twolink.algorithms.spatial import Scalar, constant, minus, negative, plus, reciprocal, times


class Node:
    """A value on a record, and the places of the nodes it was made of, with the partial derivatives by them."""

    __slots__ = ("parents", "place", "record", "value")

    def __init__(self, record: list[Node], value: Scalar, parents: tuple[tuple[int, Scalar], ...] = ()) -> None:
        self.record, self.value, self.parents, self.place = record, value, parents, len(record)
        record.append(self)

    def __add__(self, x: Any) -> Any:
        if isinstance(x, (Jet, np.ndarray)):
            return NotImplemented
        if isinstance(x, Node):
            return Node(self.record, plus(self.value, x.value), ((self.place, 1.0), (x.place, 1.0)))
        return self._of(plus(self.value, x), 1.0)

    def __mul__(self, x: Any) -> Any:
        if isinstance(x, (Jet, np.ndarray)):
            return NotImplemented
        if isinstance(x, Node):
            parents = (self.place, x.value), (x.place, self.value)
            return Node(self.record, times(self.value, x.value), parents)
        return self._of(times(self.value, x), x)

    def __neg__(self) -> Node:
        return self._of(negative(self.value), -1.0)

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

    def _inverse(self, xp: Any) -> Node:
        """1 / self."""
        inverse = reciprocal(self.value, xp)
        return self._of(inverse, negative(times(inverse, inverse)))

    def _of(self, value: Scalar, slope: Scalar) -> Node:
        """A function's value, and its slope by self."""
        return Node(self.record, value, ((self.place, slope),))


class NodeNamespace:
    """The functions of another namespace, of nodes."""

    def __init__(self, xp: Any) -> None:
        self.xp = xp
        self.both = xp.both
        self.record: list[Node] = []

    def node(self, value: Scalar) -> Node:
        """A new input."""
        return Node(self.record, value)

    def pulled_back(self, outputs: Sequence[Any], weights: Sequence[Scalar], inputs: Sequence[Node]) -> list[Scalar]:
        """The derivatives of sum_k w_k y_k by the inputs."""
        bars: list[Scalar] = [0.0] * len(self.record)
        for output, weight in zip(outputs, weights, strict=True):
            if isinstance(output, Node):
                bars[output.place] = plus(bars[output.place], weight)
        for node in reversed(self.record):  # which were made of earlier ones
            bar = bars[node.place]
            if constant(bar) and bar == 0.0:
                continue
            for place, partial in node.parents:
                bars[place] = plus(bars[place], times(partial, bar))
        return [bars[node.place] for node in inputs]

    def sin(self, x: Any) -> Any:
        """The sine."""
        return x._of(self.xp.sin(x.value), self.xp.cos(x.value)) if isinstance(x, Node) else self.xp.sin(x)

    def cos(self, x: Any) -> Any:
        """The cosine."""
        return x._of(self.xp.cos(x.value), negative(self.xp.sin(x.value))) if isinstance(x, Node) else self.xp.cos(x)

    def sqrt(self, x: Any) -> Any:
        """The square root."""
        if not isinstance(x, Node):
            return self.xp.sqrt(x)
        root = self.xp.sqrt(x.value)
        return x._of(root, 0.5 / root)

    def tanh(self, x: Any) -> Any:
        """The hyperbolic tangent."""
        if not isinstance(x, Node):
            return self.xp.tanh(x)
        value = self.xp.tanh(x.value)
        return x._of(value, minus(1.0, times(value, value)))

    def power(self, x: Any, exponent: float) -> Any:
        """x to a constant power."""
        if not isinstance(x, Node):
            return self.xp.power(x, exponent)
        return x._of(self.xp.power(x.value, exponent), times(exponent, self.xp.power(x.value, exponent - 1.0)))

    def reciprocal(self, x: Any) -> Any:
        """1 / x."""
        return x._inverse(self.xp) if isinstance(x, Node) else reciprocal(x, self.xp)

    def less(self, a: Any, b: Any) -> Any:
        """Whether a < b, by the values."""
        return self.xp.less(_value(a), _value(b))

    def less_equal(self, a: Any, b: Any) -> Any:
        """Whether a <= b, by the values."""
        return self.xp.less_equal(_value(a), _value(b))

    def where(self, condition: Any, yes: Any, no: Any) -> Any:
        """The one or the other; the slopes by the other are 0."""
        chosen = self.xp.where(condition, _value(yes), _value(no))
        sides = (yes, self.xp.where(condition, 1.0, 0.0)), (no, self.xp.where(condition, 0.0, 1.0))
        parents = tuple((x.place, slope) for x, slope in sides if isinstance(x, Node))
        return Node(self.record, chosen, parents) if parents else chosen

    def lift(self, x: Any) -> Node:
        """x as a node, whose value is the other namespace's."""
        value = self.xp.lift(_value(x))
        return x._of(value, 1.0) if isinstance(x, Node) else Node(self.record, value)


def _value(x: Any) -> Scalar:
    return x.value if isinstance(x, Node) else x
