"""The order conditions of Runge-Kutta methods.

A method has order p if and only if b . Phi(T) = 1 / gamma(T) for every rooted tree T of up to p nodes (Butcher 1963;
Hairer, Norsett, Wanner: Solving Ordinary Differential Equations I, theorem II.2.13).
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator, Sequence

import numpy as np

from twolink.integrate.steps.methods import Row, Tableau

Tree = tuple["Tree", ...]  # the subtrees that hang from its root, sorted
ROUNDING = 1e-13  # what coefficients of 16 digits may miss a condition by


def matrix(tableau: Tableau) -> np.ndarray:
    """a as a full matrix (stages, stages)."""
    full = np.zeros((len(tableau.b), len(tableau.b)))
    for i, row in enumerate(tableau.a):
        full[i, : len(row)] = row
    return full


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


def require_orders(tableau: Tableau) -> None:
    """Require the orders of a method and of its error estimates. Raises ValueError with the condition missed."""
    _require_order(tableau, tableau.b, tableau.order, "b")
    for weights, order in zip(tableau.errors, tableau.error_orders, strict=True):
        embedded = tuple(x - y for x, y in zip(tableau.b, weights, strict=True))
        _require_order(tableau, embedded, order, "b - e")


def _require_order(tableau: Tableau, weights: Row, order: int, name: str) -> None:
    a = matrix(tableau)
    for p in range(1, order + 1):
        missed = defect(a, weights, p)
        if not missed <= ROUNDING * max(1.0, float(np.abs(a).max())):
            raise ValueError(f"{name} misses the conditions of order {p} by {missed:.1e}")
