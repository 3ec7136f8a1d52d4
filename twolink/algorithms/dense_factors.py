"""Linear systems over plain arithmetic, for the matrices 1 - h J of implicit steps.

There is no pivoting: for small h the matrix is near to 1, and a step that is too large for that fails to converge
and is refused by its error. Entries that are the constants 0 and 1 cost no operation.
"""

from collections.abc import Sequence
from typing import Any

from twolink.algorithms.spatial import Matrix, Scalar, minus, times


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
