"""Butcher tableaus: the coefficients of a Runge-Kutta method as frozen data.

    k_i = f(t + c_i h, x + h sum_j a_ij k_j),    x_new = x + h sum_i b_i k_i

The tests prove the orders by the conditions of all rooted trees.
"""

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

Row = tuple[float, ...]


@dataclass(frozen=True)
class Tableau:
    """Rows `a` up to the diagonal (explicit methods: below it), weights `b`, nodes `c`, order.

    errors: weights e whose sum h sum_i e_i k_i estimates the error of a step, being the difference to a method of the
    order named beside it in error_orders; none for a method of fixed steps. Raises ValueError for shapes of no method.
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

    @functools.cached_property
    def c(self) -> Row:
        """The nodes: the sums of the rows, as for every method that treats t like a state."""
        return tuple(math.fsum(row) for row in self.a)

    @functools.cached_property
    def diagonal(self) -> Row:
        """a_ii of each stage; 0 where the stage is explicit."""
        return tuple(row[i] if len(row) > i else 0.0 for i, row in enumerate(self.a))


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
