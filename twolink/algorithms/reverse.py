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

from twolink.algorithms.differentiated import Differentiated, DifferentiatedNamespace
from twolink.algorithms.jets import Jet
from twolink.algorithms.spatial import Scalar, constant, negative, plus, times


class Node(Differentiated):
    """A value on a record, and the places of the nodes it was made of, with the partial derivatives by them."""

    __slots__ = ("parents", "place", "record")

    def __init__(self, record: list[Node], value: Scalar, parents: tuple[tuple[int, Scalar], ...] = ()) -> None:
        self.record, self.value, self.parents, self.place = record, value, parents, len(record)
        record.append(self)

    def __add__(self, x: Any) -> Any:
        if isinstance(x, (Jet, np.ndarray)):
            return NotImplemented
        if isinstance(x, Node):
            return Node(self.record, plus(self.value, x.value), ((self.place, 1.0), (x.place, 1.0)))
        return self.function(plus(self.value, x), 1.0)

    def __mul__(self, x: Any) -> Any:
        if isinstance(x, (Jet, np.ndarray)):
            return NotImplemented
        if isinstance(x, Node):
            parents = (self.place, x.value), (x.place, self.value)
            return Node(self.record, times(self.value, x.value), parents)
        return self.function(times(self.value, x), x)

    def __neg__(self) -> Node:
        return self.function(negative(self.value), -1.0)

    __radd__ = __add__
    __rmul__ = __mul__

    def function(self, value: Scalar, slope: Scalar) -> Node:
        """A function's value, and its slope by self."""
        return Node(self.record, value, ((self.place, slope),))


class NodeNamespace(DifferentiatedNamespace):
    """The functions of another namespace, of nodes."""

    kind = Node

    def __init__(self, xp: Any) -> None:
        super().__init__(xp)
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

    def where(self, condition: Any, yes: Any, no: Any) -> Any:
        """The one or the other; the slopes by the other are 0."""
        chosen = self.xp.where(condition, self.value_of(yes), self.value_of(no))
        sides = (yes, self.xp.where(condition, 1.0, 0.0)), (no, self.xp.where(condition, 0.0, 1.0))
        parents = tuple((x.place, slope) for x, slope in sides if isinstance(x, Node))
        return Node(self.record, chosen, parents) if parents else chosen

    def lift(self, x: Any) -> Node:
        """x as a node, whose value is the other namespace's."""
        value = self.xp.lift(self.value_of(x))
        return x.function(value, 1.0) if isinstance(x, Node) else Node(self.record, value)
