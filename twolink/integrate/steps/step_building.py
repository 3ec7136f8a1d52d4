"""Building step maps: the portable one on Pinocchio's rates, the compiled one, and the one compiled in parts.

In parts, the rate and the projection are compiled, and NumPy makes steps of them: a step takes some 0.3 ms more, and
compiling a tenth of the time.
"""

import contextlib
import functools
from collections.abc import Callable
from typing import Any

import numpy as np

from twolink.algorithms.factors import factored, solved
from twolink.algorithms.namespaces import Expressions, Numbers
from twolink.dynamics.kernels import heyoka
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.formulas import projected, traced_rate
from twolink.integrate.motion.pinocchio_rate import rate as rate_by_pinocchio
from twolink.integrate.motion.state import Array
from twolink.integrate.steps.methods import Method
from twolink.integrate.steps.step_control import ROWS, Problem, Step, adaptive_advance, fixed_advance
from twolink.integrate.steps.step_formulas import Rate, diagonally_implicit_step, explicit_step, semi_implicit_step

MAX_NUMBERS = 200_000  # in the Jacobians of one call
Map = Callable[..., None]  # (state, out)
Solver = Callable[[float, Array], Array]


def portable_map(equations: Equations, method: Method) -> Map:
    """The map on Pinocchio's rates; run-time parameters are the robot's own there."""

    def rate(t: Any, x: Array) -> Array:
        return rate_by_pinocchio(equations, t, x)

    def project(x: Array) -> Array:
        return projected(equations, x, Numbers)

    step = _numeric_step(equations, method, rate)

    def call(state: Array, out: Array) -> None:
        with np.errstate(all="ignore"):
            out[:] = _advance(equations, method, step, project, state, Numbers)

    return _few_at_once(equations, method, call)


def map_in_parts(
    equations: Equations, method: Method, rate_code: Any, projection_code: Any, constants: Array | None = None
) -> Map:
    """The map on a compiled rate, and on a compiled projection where there are constraints.

    constants (p,): of the run-time parameters, where the state array has no rows for them.
    """
    size = equations.space.size

    @functools.lru_cache(4)  # those of a step, and of its Jacobian: filling in the constants takes longer than the rate
    def with_constants(width: int) -> Array:
        rows = np.empty((1 + size + len(own), width))
        rows[1 + size :] = own[:, None]
        return rows

    own = np.empty(0) if constants is None else constants

    def call(state: Array, out: Array, *, batch_parallel: bool = False) -> None:
        values, worlds = state[size + ROWS :], state.shape[1]
        if constants is not None:
            values = np.broadcast_to(constants[:, None], (len(constants), worlds))

        def rate(t: Any, x: Array) -> Array:
            width = x.shape[1]
            if constants is None:
                rows = np.empty((1 + size + len(values), width))
                rows[1 + size :] = values if width == worlds else np.tile(values, width // worlds)
            else:
                rows = with_constants(width)
            rows[0], rows[1 : 1 + size] = t, x
            return np.asarray(rate_code(rows, batch_parallel=batch_parallel))

        def project(x: Array) -> Array:
            if equations.constraints is None:
                return projected(equations, x, Numbers)
            return np.asarray(projection_code(np.concatenate([x, values]), batch_parallel=batch_parallel))

        with np.errstate(all="ignore"):
            step = _numeric_step(equations, method, rate)
            out[:] = _advance(equations, method, step, project, state, Numbers)

    return _few_at_once(equations, method, call)


def _few_at_once(equations: Equations, method: Method, call: Map) -> Map:
    """The map for a few worlds at a time, where the Jacobians of all would take much memory."""
    if method.kind != "implicit":
        return call
    each = max(1, MAX_NUMBERS // max(1, equations.space.size) ** 2)

    def chunked(state: Array, out: Array, **options: Any) -> None:
        for begin in range(0, state.shape[1], each):
            part = slice(begin, begin + each)
            call(state[:, part], out[:, part], **options)

    return chunked


def compiled_rate(equations: Equations, **options: Any) -> Any:
    """heyoka's function of the rows t, x and the run-time parameters: x' (size,)."""
    module = heyoka()
    xp, first = Expressions(module), 1 + equations.space.size
    rows = np.array([module.expression(f"x{i}") for i in range(first + len(equations.parameters))], dtype=object)
    constants = dict(zip(equations.parameters, rows[first:], strict=True))
    out = traced_rate(equations, rows[0], rows[1:first], xp, constants)
    return module.cfunc([xp.lift(e) for e in out], vars=list(rows), **options)


def compiled_projection(equations: Equations, **options: Any) -> Any:
    """heyoka's function of the rows x and the run-time parameters: x (size,) on its manifold."""
    module = heyoka()
    xp, size = Expressions(module), equations.space.size
    rows = np.array([module.expression(f"x{i}") for i in range(size + len(equations.parameters))], dtype=object)
    out = projected(equations, rows[:size], xp, dict(zip(equations.parameters, rows[size:], strict=True)))
    return module.cfunc([xp.lift(e) for e in out], vars=list(rows), **options)


def compiled_map(equations: Equations, method: Method) -> Any:
    """The map as heyoka's compiled function of the state's rows."""
    module = heyoka()
    xp = Expressions(module, own_sine=method.kind != "implicit")  # whose Jacobian is differentiated
    first = equations.space.size + ROWS
    rows = first + len(equations.parameters)
    state = np.array([module.expression(f"x{i}") for i in range(rows)], dtype=object)
    constants = dict(zip(equations.parameters, state[first:], strict=True))

    def rate(t: Any, x: Array) -> Array:
        return traced_rate(equations, t, x, xp, constants)

    def jacobian(t: Any, x: Array) -> list[list[Any]]:
        """df/dx by differentiating the rate at new symbols y, for which x is substituted."""
        names = [f"y{i}" for i in range(len(x))]
        y = np.array([module.expression(name) for name in names], dtype=object)
        tensors = module.diff_tensors(list(rate(t, y)), diff_args=list(y), diff_order=1)
        entries = module.subs([e for row in tensors.jacobian for e in row], dict(zip(names, x, strict=True)))
        zero, one = module.expression(0.0), module.expression(1.0)
        folded = [0.0 if e == zero else 1.0 if e == one else e for e in entries]
        return [folded[i * len(x) : (i + 1) * len(x)] for i in range(len(x))]

    def solver(t: Any, x: Array, h: Any) -> Solver:
        matrix = jacobian(t, x)
        factors: dict[float, tuple[list[list[Any]], list[Any]]] = {}

        def solve(d: float, right: Array) -> Array:
            if d not in factors:
                factors[d] = factored(_one_minus(h * d, matrix))
            answer = np.empty_like(right)
            answer[:] = solved(*factors[d], list(right))
            return answer

        return solve

    def project(x: Array) -> Array:
        return projected(equations, x, xp, constants)

    step = _step(equations, method, rate, solver)

    def within_reach(t: Any, x: Array, h: Any) -> tuple[Array, list[Array], Array | None]:
        new, errors, change = step(t, x, h)
        return xp.within_reach(new), [xp.within_reach(e) for e in errors], change

    out = _advance(equations, method, within_reach, project, state, xp)
    return module.cfunc([xp.lift(e) for e in out], vars=list(state))


def _advance(
    equations: Equations, method: Method, step: Step, project: Callable[[Array], Array], state: Array, xp: Any
) -> Array:
    """The state array after one attempted step."""
    space = equations.space
    problem = Problem(step, space.size, space.absolute, space.joint_rows, project, method.error_order)
    return (adaptive_advance if method.adaptive else fixed_advance)(problem, state, xp)


def _step(equations: Equations, method: Method, rate: Rate, solver: Callable[[Any, Array, Any], Solver]) -> Step:
    """The method's step (t, x, h) -> (x_new, error estimates, last change of an iteration).

    solver: (t, x, h) -> the solver (d, r) -> (1 - h d J)^-1 r with J = df/dx at (t, x).
    """
    space, tableau = equations.space, method.tableau
    if tableau is None:
        return functools.partial(semi_implicit_step, space, rate)
    if method.kind == "explicit":
        return functools.partial(explicit_step, tableau, rate)

    def implicit(t: Any, x: Array, h: Any) -> tuple[Array, list[Array], Array]:
        solve = solver(t + h * 0.5, x + rate(t, x) * (h * 0.5), h)
        return diagonally_implicit_step(tableau, rate, solve, t, x, h)

    return implicit


def _one_minus(h: Any, matrix: list[list[Any]]) -> list[list[Any]]:
    """1 - h J; a constant 0 of J leaves the constant 0 or 1."""
    unit = np.eye(len(matrix)).tolist()
    return [
        [one if type(e) is float and e == 0.0 else one - e * h for one, e in zip(ones, row, strict=True)]
        for ones, row in zip(unit, matrix, strict=True)
    ]


def _numeric_step(equations: Equations, method: Method, rate: Rate) -> Step:
    """The step over numbers, the matrices of its iterations by LAPACK."""
    moving = equations.space.moving

    def solver(t: Any, x: Array, h: Any) -> Solver:
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

    return _step(equations, method, rate, solver)


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
