"""Attempts of steps over arrays of numbers by NumPy: the statement that the native library's attempts are held against,
and what computes where there is none.
"""

import contextlib
import functools
from collections.abc import Callable
from typing import Any

import numpy as np

from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.state import Array
from twolink.integrate.steps.methods import Method
from twolink.integrate.steps.step_control import ROWS, Step, StepProblem, adaptive_advance, fixed_advance
from twolink.integrate.steps.step_formulas import Rate, diagonally_implicit_step, explicit_step, semi_implicit_step

MAX_NUMBERS = 200_000  # in the Jacobians of one call
Map = Callable[[Array, Array, Array | None], None]  # (state, out, which columns go on by the embedded formula)
Solver = Callable[[float, Array], Array]
Formulas = Callable[[Array], tuple[Rate, Callable[[Array], Array]]]  # of parameters (p, n): rate and projection


def numeric_map(equations: Equations, method: Method, formulas: Formulas) -> Map:
    """The map state -> state after one attempt of each column, on a rate and a projection."""
    space = equations.space
    advance = adaptive_advance if method.adaptive else fixed_advance
    each = max(1, MAX_NUMBERS // max(1, space.size) ** 2) if method.kind == "implicit" else 0

    def attempt(state: Array, out: Array, embedded: Array | None) -> None:
        with np.errstate(all="ignore"):
            rate, project = formulas(state[space.size + ROWS :])
            step = _step(equations, method, rate)
            problem = StepProblem(
                step, space.size, space.absolute, space.joint_rows, project, method.error_order, embedded
            )
            out[:] = advance(problem, state)

    def call(state: Array, out: Array, embedded: Array | None = None) -> None:
        width = each or state.shape[1] or 1
        for begin in range(0, state.shape[1], width):
            part = slice(begin, begin + width)
            attempt(state[:, part], out[:, part], None if embedded is None else embedded[part])

    return call


def _step(equations: Equations, method: Method, rate: Rate) -> Step:
    """The method's step (t, x, h) -> (x_new, error estimates, last change of an iteration)."""
    space, tableau, moving = equations.space, method.tableau, equations.moving
    if tableau is None:
        return functools.partial(semi_implicit_step, space, rate)
    if method.kind == "explicit":
        return functools.partial(explicit_step, tableau, rate)

    def solver(t: Any, x: Array, h: Any) -> Solver:
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
