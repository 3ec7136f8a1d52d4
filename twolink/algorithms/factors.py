"""Factors of matrices over plain arithmetic: branch-sparse ones of a mass matrix, M = L^T D L (Featherstone 2008,
section 6.5), and dense ones of the matrices 1 - h J of implicit steps.

The entry (i, j) of M is zero unless one of the degrees of freedom i and j carries the other. L has zeros in the
same places. parents: the parent of each degree of freedom, -1 at a root (`Mechanism.dof_parents`).

Dense factors have no pivoting: for small h the matrix is near to 1, and a step that is too large for that fails to
converge and is refused by its error. Entries that are the constants 0 and 1 cost no operation.
"""

from collections.abc import Sequence
from typing import Any

from twolink.algorithms.spatial import Matrix, Scalar, Scalars, is_zero, minus, reciprocal, times


def ldlt_solve(matrix: Matrix, parents: Sequence[int], b: Scalars, xp: Any = None) -> list[Scalar]:
    """x of M x = b by M = L^T D L, without fill-in: L has M's sparsity."""
    lower, inverse = ldlt(matrix, parents, xp)
    return ldlt_apply(lower, inverse, parents, b)


def ldlt(matrix: Matrix, parents: Sequence[int], xp: Any = None) -> tuple[Matrix, list[Scalar]]:
    """L (unit lower triangular, its strict part) and 1 / D of M = L^T D L, Featherstone table 6.3."""
    h, inverse = [list(row) for row in matrix], [0.0 for _ in matrix]
    for k in reversed(range(len(matrix))):
        inverse[k] = reciprocal(h[k][k], xp)
        coupled = [i for i in _ancestors(parents, k) if not is_zero(h[k][i])]
        for n, i in enumerate(coupled):
            ratio = times(h[k][i], inverse[k])
            for j in coupled[n:]:
                h[i][j] = minus(h[i][j], times(ratio, h[k][j]))
            h[k][i] = ratio
    return h, inverse


def elimination_order(matrix: Matrix) -> list[int]:
    """An order of the rows for which L of a symmetric matrix gets few entries where the matrix has the constant 0.

    `ldlt` eliminates the last row first: that is the one coupled to the fewest others, then again the one of those
    left, with the couplings that the first has caused (minimum degree: Tinney, Walker: Proc. IEEE 55, 1967).
    """
    coupled = {i: {j for j, entry in enumerate(row) if j != i and not is_zero(entry)} for i, row in enumerate(matrix)}
    order: list[int] = []
    while coupled:
        i = min(coupled, key=lambda i: (len(coupled[i]), -i))
        around = coupled.pop(i)
        for j in around:
            coupled[j] = (coupled[j] | around) - {i, j}
        order.append(i)
    return order[::-1]


def ldlt_apply(lower: Matrix, inverse: Scalars, parents: Sequence[int], b: Scalars) -> list[Scalar]:
    """x of L^T D L x = b, Featherstone table 6.4."""
    return ldlt_outward(lower, inverse, parents, ldlt_inward(lower, parents, b))


def ldlt_inward(lower: Matrix, parents: Sequence[int], b: Scalars) -> list[Scalar]:
    """L^-T b: 0 wherever b has 0 there and in all that is carried."""
    x = list(b)
    for k in reversed(range(len(x))):
        if not is_zero(x[k]):
            for i in _ancestors(parents, k):
                x[i] = minus(x[i], times(lower[k][i], x[k]))
    return x


def ldlt_outward(lower: Matrix, inverse: Scalars, parents: Sequence[int], b: Scalars) -> list[Scalar]:
    """L^-1 D^-1 b."""
    x = list(b)
    for k in range(len(x)):
        x[k] = times(x[k], inverse[k])
        for i in _ancestors(parents, k):
            x[k] = minus(x[k], times(lower[k][i], x[i]))
    return x


def ldlt_inverse(lower: Matrix, inverse: Scalars, parents: Sequence[int]) -> Matrix:
    """M^-1 of M = L^T D L: its lower triangle by L^-1 D^-1 L^-T, column by column, the rest by symmetry."""
    answer: Matrix = [[0.0] * len(parents) for _ in parents]
    for k in range(len(parents)):
        unit = [1.0 if j == k else 0.0 for j in range(len(parents))]
        upwards = ldlt_inward(lower, parents, unit)[: k + 1]
        for j, entry in enumerate(ldlt_outward(lower, inverse, parents, upwards)):
            answer[k][j] = answer[j][k] = entry
    return answer


def _ancestors(parents: Sequence[int], k: int) -> list[int]:
    path = []
    while (k := parents[k]) >= 0:
        path.append(k)
    return path


def factored(matrix: Sequence[Sequence[Scalar]], xp: Any = None) -> tuple[Matrix, list[Scalar]]:
    """(L below the diagonal and U above it, 1 / the pivots) of a square matrix, by Gauss's elimination.

    xp: whose reciprocal the pivots' is; plain division without.
    """
    rows = [list(row) for row in matrix]
    inverses: list[Scalar] = []
    for k, pivot in enumerate(rows):
        inverses.append(1.0 / pivot[k] if xp is None else xp.reciprocal(pivot[k]))
        for row in rows[k + 1 :]:
            row[k] = times(row[k], inverses[k])
            for j in range(k + 1, len(rows)):
                row[j] = minus(row[j], times(row[k], pivot[j]))
    return rows, inverses


def solved(rows: Matrix, inverses: Sequence[Scalar], right: Sequence[Scalar]) -> list[Scalar]:
    """The solution for one right-hand side, from the factors of `factored`."""
    y = list(right)
    for k, row in enumerate(rows):
        for j in range(k):
            y[k] = minus(y[k], times(row[j], y[j]))
    for k in reversed(range(len(rows))):
        for j in range(k + 1, len(rows)):
            y[k] = minus(y[k], times(rows[k][j], y[j]))
        y[k] = times(inverses[k], y[k])
    return y
