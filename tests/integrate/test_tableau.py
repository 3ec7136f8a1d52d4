"""Tableaus: the rooted trees behind the order conditions, and conditions that refuse what is wrong."""

from dataclasses import replace

import numpy as np
import pytest

from tests.integrate.order_conditions import defect, density, matrix, require_orders, trees
from twolink.integrate.steps.methods import METHODS, Tableau

TABLEAUS = {name: m.tableau for name, m in METHODS.items() if m.tableau is not None}
EVERY = pytest.mark.parametrize("name", TABLEAUS)


def test_numbers_of_rooted_trees() -> None:
    """Sloane's A000081."""
    assert [len(list(trees(n))) for n in range(1, 9)] == [1, 1, 2, 4, 9, 20, 48, 115]


def test_a_sum_over_trees_is_the_exponential() -> None:
    """Of n nodes, sum of n! / (gamma sigma) is the number of increasing labellings of all trees: (n - 1)!."""

    def symmetry(tree: tuple) -> int:
        factor = 1
        for child in set(tree):
            k = tree.count(child)
            factor *= symmetry(child) ** k * int(np.prod(range(1, k + 1)))
        return factor

    factorial = 1
    for n in range(1, 9):
        labellings = sum(factorial * n / (density(t) * symmetry(t)) for t in trees(n))
        assert labellings == pytest.approx(factorial, rel=1e-12)
        factorial *= n


@EVERY
def test_each_corrupted_coefficient_is_refused(name: str) -> None:
    """Every entry of a and b and of the error estimates, one at a time, moved by 1e-6 of itself."""
    tableau = TABLEAUS[name]
    for i, row in enumerate(tableau.a):
        for j in np.flatnonzero(row):
            with pytest.raises(ValueError, match="misses the conditions of order"):
                require_orders(replace(tableau, a=(*tableau.a[:i], _moved(row, j), *tableau.a[i + 1 :])))
    for j in np.flatnonzero(tableau.b):
        with pytest.raises(ValueError, match="misses the conditions of order 1"):
            require_orders(replace(tableau, b=_moved(tableau.b, j)))
    for k, weights in enumerate(tableau.errors):
        for j in np.flatnonzero(weights):
            changed = (*tableau.errors[:k], _moved(weights, j), *tableau.errors[k + 1 :])
            with pytest.raises(ValueError, match="b - e misses"):
                require_orders(replace(tableau, errors=changed))


def _moved(row: tuple[float, ...], j: int) -> tuple[float, ...]:
    return tuple(x * (1 + 1e-6) if i == j else x for i, x in enumerate(row))


@EVERY
def test_methods_and_their_estimates_have_their_orders(name: str) -> None:
    require_orders(TABLEAUS[name])


@EVERY
def test_orders_are_sharp(name: str) -> None:
    """The order is the whole of it: of the next one some condition fails, for the embedded methods too."""
    tableau = TABLEAUS[name]
    a = matrix(tableau)
    assert defect(a, tableau.b, tableau.order) < 1e-12
    assert defect(a, tableau.b, tableau.order + 1) > 1e-7
    with pytest.raises(ValueError, match=f"order {tableau.order + 1}"):
        require_orders(Tableau(tableau.a, tableau.b, tableau.order + 1))
    for weights, order in zip(tableau.errors, tableau.error_orders, strict=True):
        embedded = np.subtract(tableau.b, weights)
        assert defect(a, embedded, order) < 1e-12
        assert defect(a, embedded, order + 1) > 1e-7


def test_published_nodes() -> None:
    """The nodes of the pairs as printed: Dormand, Prince 1980; Bogacki, Shampine 1989; Kennedy, Carpenter 2003."""
    np.testing.assert_allclose(TABLEAUS["rk45"].c, [0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1, 1], atol=1e-14)
    np.testing.assert_allclose(TABLEAUS["rk23"].c, [0, 1 / 2, 3 / 4, 1], atol=1e-15)
    np.testing.assert_allclose(TABLEAUS["esdirk43"].c, [0, 1 / 2, 83 / 250, 31 / 50, 17 / 20, 1], atol=1e-14)
