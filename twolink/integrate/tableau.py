"""Butcher tableaus: the coefficients of a Runge-Kutta method as frozen data, checked when made.

    k_i = f(t + c_i h, x + h sum_j a_ij k_j),    x_new = x + h sum_i b_i k_i

The order is proved, not believed: a method has order p if and only if b . Phi(T) = 1 / gamma(T) for every rooted tree T
of up to p nodes (Butcher 1963; Hairer, Norsett, Wanner: Solving Ordinary Differential Equations I, theorem II.2.13).
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

Tree = tuple["Tree", ...]  # the subtrees that hang from its root, sorted
Row = tuple[float, ...]

ROUNDING = 1e-13  # what coefficients of 16 digits may miss a condition by


@dataclass(frozen=True)
class Tableau:
    """Rows `a` up to the diagonal (explicit methods: below it), weights `b`, nodes `c`, order.

    errors: weights e whose sum h sum_i e_i k_i estimates the error of a step, being the difference to a method of the
    order named beside it in error_orders; none for a method of fixed steps. Raises ValueError where the coefficients
    break a condition.
    """

    a: tuple[Row, ...]
    b: Row
    order: int
    errors: tuple[Row, ...] = ()
    error_orders: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        stages = len(self.b)
        if len(self.a) != stages or any(len(row) > i + 1 for i, row in enumerate(self.a)):
            raise ValueError("the rows of a must be as many as the weights, and none may reach beyond the diagonal")
        if any(len(e) != stages for e in self.errors) or len(self.errors) != len(self.error_orders):
            raise ValueError("each error estimate needs a weight a stage, and its order")
        _require_order(self, self.b, self.order, "b")
        for weights, order in zip(self.errors, self.error_orders, strict=True):
            embedded = tuple(x - y for x, y in zip(self.b, weights, strict=True))
            _require_order(self, embedded, order, "b - e")

    @functools.cached_property
    def c(self) -> Row:
        """The nodes: the sums of the rows, as for every method that treats t like a state."""
        return tuple(math.fsum(row) for row in self.a)

    @functools.cached_property
    def diagonal(self) -> Row:
        """a_ii of each stage; 0 where the stage is explicit."""
        return tuple(row[i] if len(row) > i else 0.0 for i, row in enumerate(self.a))

    def matrix(self) -> np.ndarray:
        """a as a full matrix (stages, stages)."""
        full = np.zeros((len(self.b), len(self.b)))
        for i, row in enumerate(self.a):
            full[i, : len(row)] = row
        return full


def tableau_of(
    order: int,
    a: Sequence[Sequence[float | str]],
    b: Sequence[float | str],
    errors: Sequence[Sequence[float | str]] = (),
    embedded: Sequence[Sequence[float | str]] = (),
    error_orders: Sequence[int] = (),
) -> Tableau:
    """A tableau from coefficients that are numbers or fractions as texts; embedded: weights b - e in place of e."""
    weights = [Fraction(w) for w in b]
    estimates = [[Fraction(e) for e in row] for row in errors]
    estimates += [[w - Fraction(e) for w, e in zip(weights, row, strict=True)] for row in embedded]
    return Tableau(
        tuple(tuple(float(Fraction(x)) for x in row) for row in a),
        tuple(map(float, weights)),
        order,
        tuple(tuple(map(float, row)) for row in estimates),
        tuple(error_orders),
    )


def trees(nodes: int) -> Iterator[Tree]:
    """The rooted trees with this many nodes: 1, 1, 2, 4, 9, 20, 48, 115 of 1 to 8."""
    return iter(_trees(nodes))


@functools.cache
def _trees(nodes: int) -> tuple[Tree, ...]:
    return tuple(sorted({tuple(sorted(forest)) for forest in _forests(nodes - 1)}))


def _forests(nodes: int) -> Iterator[Tree]:
    if nodes == 0:
        yield ()
    for first in range(1, nodes + 1):
        for tree in _trees(first):
            for rest in _forests(nodes - first):
                if not rest or tree <= rest[0]:
                    yield (tree, *rest)


@functools.cache
def density(tree: Tree) -> int:
    """gamma: the number of nodes times the densities of the subtrees."""
    return size(tree) * math.prod(map(density, tree))


@functools.cache
def size(tree: Tree) -> int:
    """The number of nodes."""
    return 1 + sum(map(size, tree))


def defect(a: np.ndarray, b: Sequence[float], order: int) -> float:
    """The largest |b . Phi(T) - 1 / gamma(T)| over the trees of exactly `order` nodes."""
    weights: dict[Tree, np.ndarray] = {}

    def phi(tree: Tree) -> np.ndarray:
        if tree not in weights:
            weights[tree] = np.prod([a @ phi(child) for child in tree], axis=0) * np.ones(len(b))
        return weights[tree]

    return max(abs(float(np.dot(b, phi(tree))) - 1 / density(tree)) for tree in _trees(order))


def _require_order(tableau: Tableau, weights: Row, order: int, name: str) -> None:
    a = tableau.matrix()
    for p in range(1, order + 1):
        missed = defect(a, weights, p)
        if not missed <= ROUNDING * max(1.0, float(np.abs(a).max())):
            raise ValueError(f"{name} misses the conditions of order {p} by {missed:.1e}")
