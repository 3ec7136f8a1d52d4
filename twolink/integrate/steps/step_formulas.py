"""One step of each kind of method, as its textbook has it, and attempts of steps by NumPy.

It is the statement that the native library's attempts are held against, and what computes where there is none. A step
returns the new state, a list of error estimates, which is empty for methods of fixed steps, and the last change of its
iteration, which must be small; None for explicit steps.
"""

import contextlib
import functools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.state import Array, StateSpace
from twolink.integrate.steps.methods import ITERATIONS, Method, Tableau
from twolink.integrate.steps.step_control import ROWS, Step, StepProblem, adaptive_advance, control_rows, fixed_advance
from twolink.native.stepper import Disturbances

MAX_NUMBERS = 200_000  # in the Jacobians of one call


Rate = Callable[[Any, Array], Array]
Formulas = Callable[[Array | None], tuple[Rate, Callable[[Array], Array]]]  # of parameters (p, n): rate and projection


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


class NumericSteps:
    """Attempts of steps by NumPy, as those of `native.stepper.Stepper`."""

    def __init__(self, equations: Equations, method: Method, formulas: Formulas) -> None:
        self._equations, self._method, self._formulas = equations, method, formulas
        self._advance = adaptive_advance if method.adaptive else fixed_advance

    def on(self, states: Array, disturbances: Disturbances | None = None) -> Callable[[int, int], int]:
        """`attempts` on states (most + 1, rows, n) that stay where they are: (count, look) -> how many were made."""
        return lambda count, look: self.attempts(states[: count + 1], count, look, disturbances)

    def attempts(self, states: Array, count: int, look: int, disturbances: Disturbances | None = None) -> int:
        """Up to `count` attempts of each world of states (count + 1, rows, n), of which the first is given.

        Returns how many were made: fewer when all worlds have arrived, or, every `look` attempts, half of them.
        disturbances: added to worlds that have not arrived, before each attempt.
        """
        rows, moving = control_rows(self._equations.space.size), self._equations.moving
        embedded = None if disturbances is None else disturbances.embedded
        for k in range(count):
            now = states[k]
            if disturbances is not None:
                now, x = now.copy(), now[:moving]
                tried = (now[rows.accepted] + now[rows.rejected]).astype(int)
                now[:moving] += np.where(now[rows.time] < now[rows.end], disturbances.added(tried, x), 0.0)
            self._attempt(now, states[k + 1], embedded)
            going = np.count_nonzero(states[k + 1, rows.time] < states[k + 1, rows.end])
            if going == 0 or ((k + 1) % look == 0 and 2 * going < now.shape[1]):
                return k + 1
        return count

    def _attempt(self, state: Array, out: Array, embedded: Array | None) -> None:
        """One attempt of each column. embedded: which go on by the embedded formula."""
        space, width = self._equations.space, state.shape[1] or 1
        if self._method.kind == "implicit":
            width = max(1, MAX_NUMBERS // max(1, space.size) ** 2)
        for begin in range(0, state.shape[1], width):
            part = slice(begin, begin + width)
            with np.errstate(all="ignore"):
                rate, project = self._formulas(state[space.size + ROWS :, part])
                problem = StepProblem(_step(self._equations, self._method, rate), space.size, space.absolute,
                                      space.joint_rows, project, self._method.error_order,
                                      None if embedded is None else embedded[part])  # fmt: skip
                out[:, part] = self._advance(problem, state[:, part])


def _step(equations: Equations, method: Method, rate: Rate) -> Step:
    """The method's step (t, x, h) -> (x_new, error estimates, last change of an iteration)."""
    space, tableau, moving = equations.space, method.tableau, equations.moving
    if tableau is None:
        return functools.partial(semi_implicit_step, space, rate)
    if method.kind == "explicit":
        return functools.partial(explicit_step, tableau, rate)

    def solver(t: Any, x: Array, h: Any) -> Callable[[float, Array], Array]:
        """(d, r) -> (1 - h d J)^-1 r with J = df/dx at (t, x)."""
        jacobian = _jacobian(rate, np.broadcast_to(t, x.shape[1]), x, moving)
        scale = np.broadcast_to(h, x.shape[1])[:, None, None]
        inverses: dict[float, Array] = {}

        def solve(d: float, right: Array) -> Array:
            if d not in inverses:
                inverses[d] = _inverse(np.eye(moving) - scale * d * jacobian)
            out = np.zeros_like(right)  # rows behind (q, v) are constant
            out[:moving] = (inverses[d] @ right[:moving].T[..., None])[..., 0].T
            return out

        return solve

    def implicit(t: Any, x: Array, h: Any) -> tuple[Array, list[Array], Array]:
        solve = solver(t + h * 0.5, x + rate(t, x) * (h * 0.5), h)
        return diagonally_implicit_step(tableau, rate, solve, t, x, h)

    return implicit


def _jacobian(rate: Rate, t: Array, x: Array, moving: int) -> Array:
    """df/dx (n, moving, moving) of states x (size, n) at times t (n,), by central differences in one call."""
    size, diagonal = len(x), np.arange(moving)
    steps = 6e-6 * (1.0 + np.abs(x[:moving]))
    moved = np.repeat(x[:, None], 2 * moving, axis=1)  # (rows, which is moved, worlds)
    moved[diagonal, diagonal] += steps
    moved[diagonal, moving + diagonal] -= steps
    rates = rate(np.tile(t, 2 * moving), moved.reshape(size, -1))[:moving].reshape(moving, 2 * moving, -1)
    return np.ascontiguousarray(((rates[:, :moving] - rates[:, moving:]) / (2.0 * steps)).transpose(2, 0, 1))


def _inverse(matrices: Array) -> Array:
    """Inverses (n, size, size); NaN of what is singular or not finite."""
    out = np.full_like(matrices, np.nan)
    for matrix, inverse in zip(matrices, out, strict=True):
        with contextlib.suppress(np.linalg.LinAlgError):
            inverse[:] = np.linalg.inv(matrix)
    return out
