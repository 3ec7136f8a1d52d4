"""One step of each kind of method, over arrays of numbers or of expressions. Each is as its textbook has it.

A step returns the new state, a list of error estimates, which is empty for methods of fixed steps, and the last change
of its iteration, which must be small; None for explicit steps.
"""

from collections.abc import Callable, Sequence
from typing import Any

from twolink.integrate.motion.state import Array, StateSpace
from twolink.integrate.steps.methods import ITERATIONS
from twolink.integrate.steps.tableau import Tableau

Rate = Callable[[Any, Array], Array]


def explicit_step(tableau: Tableau, rate: Rate, t: Any, x: Array, h: Any) -> tuple[Array, list[Array], None]:
    """k_i = f(t + c_i h, x + h sum_j a_ij k_j), x_new = x + h sum_i b_i k_i (Hairer, Norsett, Wanner, II.1)."""
    stages: list[Array] = []
    for row, c in zip(tableau.a, tableau.c, strict=True):
        stages.append(rate(t + c * h, x + _weighted(row, stages) * h if row else x))
    return x + _weighted(tableau.b, stages) * h, [_weighted(e, stages) * h for e in tableau.errors], None


def semi_implicit_step(space: StateSpace, rate: Rate, t: Any, x: Array, h: Any) -> tuple[Array, list[Array], None]:
    """v_new = v + h a(t, q, v), q_new = q + h q'(q, v_new); states of effects as v."""
    new, q = x + rate(t, x) * h, x[: space.nq]  # for its v
    new[: space.nq] = q + space.rate(q, new[space.v_rows]) * h
    return new, [], None


def diagonally_implicit_step(
    tableau: Tableau, rate: Rate, solve: Callable[[float, Array], Array], t: Any, x: Array, h: Any
) -> tuple[Array, list[Array], Array]:
    """The stages k_i = f(t + c_i h, x + h sum_{j<i} a_ij k_j + h a_ii k_i), one after the other, by Newton's method.

    solve(d, r): (1 - h d J)^-1 r with J = df/dx near the step's middle (simplified Newton; Hairer, Wanner II, IV.8).
    """
    stages: list[Array] = []
    last_change = x * 0.0
    for i, (row, d, c) in enumerate(zip(tableau.a, tableau.diagonal, tableau.c, strict=True)):
        before = x + _weighted(row[:i], stages) * h if any(row[:i]) else x
        at = t + c * h
        if d == 0.0:
            stages.append(rate(at, before))
            continue
        k = stages[-1] if stages else rate(t, x)
        for _ in range(ITERATIONS):
            change = solve(d, rate(at, before + k * (d * h)) - k)
            k = k + change
        last_change = last_change + change * (d * h)
        stages.append(k)
    errors = [_weighted(e, stages) * h for e in tableau.errors]
    return x + _weighted(tableau.b, stages) * h, errors, last_change


def _weighted(weights: Sequence[float], stages: Sequence[Array]) -> Array:
    """sum_i w_i k_i; a weight of 0 leaves no operation behind."""
    terms = [k * w for w, k in zip(weights, stages, strict=False) if w != 0.0]
    total = terms[0]
    for term in terms[1:]:
        total = total + term
    return total
