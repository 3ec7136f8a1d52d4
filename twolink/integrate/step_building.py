"""Building step maps: the portable one on Pinocchio's rates, and the compiled one."""

import functools
from collections.abc import Callable
from typing import Any

import numpy as np

from twolink.algorithms.dense_factors import factored, solved
from twolink.algorithms.namespaces import Expressions, Numbers
from twolink.dynamics.kernels import heyoka
from twolink.integrate.equations import Equations
from twolink.integrate.formulas import projected, traced_rate
from twolink.integrate.methods import Method
from twolink.integrate.pinocchio_rate import rate as rate_by_pinocchio
from twolink.integrate.state import Array
from twolink.integrate.step_control import ROWS, Problem, Step, adaptive_advance, fixed_advance
from twolink.integrate.step_formulas import Rate, diagonally_implicit_step, explicit_step, semi_implicit_step

Jacobian = Callable[[Any, Array], list[list[Any]]]


def portable_map(equations: Equations, method: Method) -> Callable[[Array, Array], None]:
    """The map on Pinocchio's rates; run-time parameters are the robot's own there."""

    def rate(t: Any, x: Array) -> Array:
        return rate_by_pinocchio(equations, t, x)

    step = _step(equations, method, rate, _differences(rate))

    def call(state: Array, out: Array) -> None:
        with np.errstate(all="ignore"):
            out[:] = _advance(equations, method, step, state, Numbers)

    return call


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

    step = _step(equations, method, rate, jacobian)

    def within_reach(t: Any, x: Array, h: Any) -> tuple[Array, list[Array], Array | None]:
        new, errors, change = step(t, x, h)
        return xp.within_reach(new), [xp.within_reach(e) for e in errors], change

    out = _advance(equations, method, within_reach, state, xp)
    return module.cfunc([xp.lift(e) for e in out], vars=list(state))


def _advance(equations: Equations, method: Method, step: Step, state: Array, xp: Any) -> Array:
    """The state array after one attempted step."""
    space = equations.space
    constants = dict(zip(equations.parameters, state[space.size + ROWS :], strict=True))

    def project(x: Array) -> Array:
        return projected(equations, x, xp, constants)

    problem = Problem(step, space.size, space.absolute, project, method.error_order)
    return (adaptive_advance if method.adaptive else fixed_advance)(problem, state, xp)


def _step(equations: Equations, method: Method, rate: Rate, jacobian: Jacobian) -> Step:
    """The method's step (t, x, h) -> (x_new, error estimates, last change of an iteration)."""
    space, tableau = equations.space, method.tableau
    if tableau is None:
        return functools.partial(semi_implicit_step, space.nq, space.rate, rate)
    if method.kind == "explicit":
        return functools.partial(explicit_step, tableau, rate)

    def implicit(t: Any, x: Array, h: Any) -> tuple[Array, list[Array], Array]:
        matrix = jacobian(t + h * 0.5, x + rate(t, x) * (h * 0.5))
        factors: dict[float, tuple[list[list[Any]], list[Any]]] = {}

        def solve(d: float, right: Array) -> Array:
            if d not in factors:
                factors[d] = factored(_one_minus(h * d, matrix))
            answer = np.empty_like(right)
            answer[:] = solved(*factors[d], list(right))
            return answer

        return diagonally_implicit_step(tableau, rate, solve, t, x, h)

    return implicit


def _one_minus(h: Any, matrix: list[list[Any]]) -> list[list[Any]]:
    """1 - h J; a constant 0 of J leaves the constant 0 or 1."""
    unit = np.eye(len(matrix)).tolist()
    return [
        [one if type(e) is float and e == 0.0 else one - e * h for one, e in zip(ones, row, strict=True)]
        for ones, row in zip(unit, matrix, strict=True)
    ]


def _differences(rate: Rate) -> Jacobian:
    """df/dx by central differences, for the portable map."""

    def jacobian(t: Any, x: Array) -> list[list[Any]]:
        columns = []
        for j in range(len(x)):
            step = 6e-6 * (1.0 + np.abs(x[j]))
            ahead, behind = x.copy(), x.copy()
            ahead[j] += step
            behind[j] -= step
            columns.append((rate(t, ahead) - rate(t, behind)) / (2.0 * step))
        return [[column[i] for column in columns] for i in range(len(x))]

    return jacobian
