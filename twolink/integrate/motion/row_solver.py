"""The linear system of motion under constraint rows, over plain arithmetic.

    M a = f + B lambda,   J a = r

With M = L^T D L, Y = J L^-1 D^-1 and Z = L^-T B, the multipliers follow from A lambda = r - Y L^-T f, A = Y Z. Two
rows are coupled only where the force of one causes motion that the other sees. What is not coupled is the constant 0
in A, and the rows are eliminated in an order that keeps most of these zeros: a row of N four-bars takes about N
operations, and not N^3.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from twolink.algorithms.factors import elimination_order, factored, ldlt, ldlt_apply, ldlt_inward, ldlt_outward, solved
from twolink.algorithms.spatial import Matrix, Scalar, is_zero, minus, plus, times


class RowSolver:
    """Solves M a = f + B lambda, J a = r from the factors of M.

    J and B are scaled by rows, so that a pivot of A below `singular` means a singular position: NaN there.
    """

    def __init__(
        self,
        jacobian: Matrix,
        forces: Matrix,
        factors: tuple[Matrix, list[Scalar]],
        parents: list[int],
        scales: Sequence[float],
        xp: Any,
        singular: float,
    ) -> None:
        self._symmetric = symmetric = forces is jacobian
        self._lower, self._inverse = factors
        self._parents = parents
        moved = self._halves(jacobian, scales)  # Z^T for J in place of B
        pushed = moved if symmetric else self._halves(forces, scales)
        seen = [{k: times(self._inverse[k], entry) for k, entry in row.items()} for row in moved]
        matrix = [[_dot(row, column) for column in pushed] for row in seen]
        order = elimination_order(matrix) if symmetric else list(range(len(matrix)))
        self._order, self._scales = order, [scales[i] for i in order]
        self._seen, self._pushed = [seen[i] for i in order], [pushed[i] for i in order]
        self._chain = list(range(-1, len(matrix) - 1))  # every row may depend on those before
        matrix, pivots = [[matrix[i][j] for j in order] for i in order], _Pivots(xp, singular)
        self._factors = ldlt(matrix, self._chain, pivots) if symmetric else factored(matrix, pivots)

    def __call__(self, force: Sequence[Scalar], right: Sequence[Scalar]) -> tuple[list[Scalar], list[Scalar]]:
        """(a, lambda) for f and r."""
        half = ldlt_inward(self._lower, self._parents, force)
        wanted = [minus(times(s, right[i]), _dot(row, half))
                  for i, s, row in zip(self._order, self._scales, self._seen, strict=True)]  # fmt: skip
        scaled = (ldlt_apply(*self._factors, self._chain, wanted) if self._symmetric
                  else solved(*self._factors, wanted))  # fmt: skip
        multipliers: list[Scalar] = [0.0] * len(scaled)
        for i, s, size, column in zip(self._order, self._scales, scaled, self._pushed, strict=True):
            multipliers[i] = times(s, size)
            for k, entry in column.items():
                half[k] = plus(half[k], times(entry, size))
        return ldlt_outward(self._lower, self._inverse, self._parents, half), multipliers

    def _halves(self, rows: Matrix, scales: Sequence[float]) -> list[dict[int, Scalar]]:
        """L^-T of each scaled row, by the entries that are not the constant 0."""
        scaled = ([times(scale, entry) for entry in row] for scale, row in zip(scales, rows, strict=True))
        halves = (ldlt_inward(self._lower, self._parents, row) for row in scaled)
        return [{k: entry for k, entry in enumerate(half) if not is_zero(entry)} for half in halves]


class _Pivots:
    """Reciprocals of pivots: NaN for one that is nearly 0."""

    def __init__(self, xp: Any, singular: float) -> None:
        self._xp, self._singular = xp, singular

    def reciprocal(self, pivot: Scalar) -> Scalar:
        """1 / pivot."""
        return self._xp.where(self._xp.less(self._singular, pivot), 1.0 / pivot, np.nan)


def _dot(row: Mapping[int, Scalar], column: Mapping[int, Scalar] | Sequence[Scalar]) -> Scalar:
    """Row times column, by the entries that are not the constant 0."""
    terms = row.items()
    if isinstance(column, Mapping):
        return plus(*(times(entry, column[k]) for k, entry in terms if k in column))
    return plus(*(times(entry, column[k]) for k, entry in terms))
