"""Building step maps: the portable one on Pinocchio's rates, the compiled one, and the comparison of the two."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from twolink.algorithms.dense_factors import factored, solved
from twolink.algorithms.mechanism import nominal
from twolink.algorithms.namespaces import Expressions, Numbers
from twolink.dynamics.kernels import heyoka
from twolink.errors import CertificationError, SceneError
from twolink.integrate import step_control as control
from twolink.integrate.assembly import assembled
from twolink.integrate.equations import Equations
from twolink.integrate.formulas import projected, traced_rate
from twolink.integrate.methods import Method
from twolink.integrate.pinocchio_rate import rate as rate_by_pinocchio
from twolink.integrate.state import Array
from twolink.integrate.step_formulas import Rate, diagonally_implicit_step, explicit_step, semi_implicit_step
from twolink.integrate.stiffness import fastest
from twolink.integrate.tableau import Tableau

if TYPE_CHECKING:
    from twolink.integrate.step_map import StepMap

AGREEMENT = 1e-8  # what portable and compiled steps may differ by, relative to the step
STATES = 8  # that they are compared on
NO_TABLEAU = Tableau((), (), 0)
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
    own = equations.space.size + control.ROWS
    rows = own + len(equations.parameters)
    state = np.array([module.expression(f"x{i}") for i in range(rows)], dtype=object)
    constants = dict(zip(equations.parameters, state[own:], strict=True))

    def rate(t: Any, x: Array) -> Array:
        return traced_rate(equations, t, x, xp, constants)

    def jacobian(t: Any, x: Array) -> list[list[Any]]:
        """df/dx by differentiating expressions of symbols of its own, for which x is put in."""
        names = [f"y{i}" for i in range(len(x))]
        own = np.array([module.expression(name) for name in names], dtype=object)
        tensors = module.diff_tensors(list(rate(t, own)), diff_args=list(own), diff_order=1)
        entries = module.subs([e for row in tensors.jacobian for e in row], dict(zip(names, x, strict=True)))
        zero, one = module.expression(0.0), module.expression(1.0)
        folded = [0.0 if e == zero else 1.0 if e == one else e for e in entries]
        return [folded[i * len(x) : (i + 1) * len(x)] for i in range(len(x))]

    step = _step(equations, method, rate, jacobian)

    def within_reach(t: Any, x: Array, h: Any) -> tuple[Array, list[Array], Array | None]:
        new, errors, moved = step(t, x, h)
        return xp.within_reach(new), [xp.within_reach(e) for e in errors], moved

    out = _advance(equations, method, within_reach, state, xp)
    return module.cfunc([xp.lift(e) for e in out], vars=list(state))


def _advance(equations: Equations, method: Method, step: control.Step, state: Array, xp: Any) -> Array:
    space = equations.space
    constants = dict(zip(equations.parameters, state[space.size + control.ROWS :], strict=True))

    def settle(x: Array) -> Array:
        return projected(equations, x, xp, constants)

    problem = control.Problem(step, space.size, space.absolute, settle, method.error_order)
    return (control.adaptive_advance if method.adaptive else control.fixed_advance)(problem, state, xp)


def _step(equations: Equations, method: Method, rate: Rate, jacobian: Jacobian) -> control.Step:
    """The method's step (t, x, h) -> (new, errors, what an iteration still moved)."""
    space, tableau = equations.space, method.tableau or NO_TABLEAU

    def semi_implicit(t: Any, x: Array, h: Any) -> tuple[Array, list[Array], None]:
        return *semi_implicit_step(space.nq, space.rate, rate, t, x, h), None

    def explicit(t: Any, x: Array, h: Any) -> tuple[Array, list[Array], None]:
        return *explicit_step(tableau, rate, t, x, h), None

    def implicit(t: Any, x: Array, h: Any) -> tuple[Array, list[Array], Array]:
        matrix = jacobian(t + h * 0.5, x + rate(t, x) * (h * 0.5))
        known: dict[float, tuple[list[list[Any]], list[Any]]] = {}

        def solve(d: float, right: Array) -> Array:
            if d not in known:
                known[d] = factored(_one_minus(h * d, matrix))
            answer = np.empty_like(right)
            answer[:] = solved(known[d][0], known[d][1], list(right))
            return answer

        return diagonally_implicit_step(tableau, rate, solve, t, x, h)

    return {"semi-implicit": semi_implicit, "explicit": explicit, "implicit": implicit}[method.kind]


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


def _on_manifold(equations: Equations, x: Array) -> Array:
    """States (size, n) with unit lengths and closed loops; the start where a loop cannot be closed."""
    x = equations.space.normalized(x, Numbers)
    if equations.constraints is None:
        return x
    moving = equations.moving
    for column in range(x.shape[1]):
        try:
            x[:moving, column] = assembled(equations.constraints, x[:moving, column])
        except SceneError:
            x[:, column] = equations.start
    return x


def _lock_some(equations: Equations, x: Array) -> None:
    """In each state but the first lock some joint, if the loops leave it a choice."""
    lockable = equations.layout.lockable
    first = equations.space.size - 2 * len(lockable)
    x[first : first + len(lockable)] = 0.0
    for column in range(1, x.shape[1]):
        for i in range(len(lockable)):
            if (i + column) % 2:
                continue
            if equations.constraints is not None:
                jacobian = equations.constraints.jacobian_at(
                    x[: equations.space.nq, column], equations.constraints.kept
                )
                free = [1.0 - x[first + j, column] for j in range(len(lockable))]
                for j, dof in enumerate(lockable):
                    jacobian[:, dof] *= free[j] if j != i else 0.0
                if np.linalg.matrix_rank(jacobian, tol=1e-3) < len(jacobian):
                    continue
            x[first + i, column] = 1.0


def certify(equations: Equations, method: Method, portable: StepMap, compiled: StepMap) -> None:
    """Compare one step of both maps, from the start and from random states around it.

    Raises CertificationError with the worst state.
    """
    size = equations.space.size
    x = np.repeat(equations.start[:, None], STATES, axis=1)
    x[:, 1:] += np.random.default_rng(1).uniform(-1, 1, (size, STATES - 1))
    x = _on_manifold(equations, x)
    _lock_some(equations, x)
    change = np.abs(rate_by_pinocchio(equations, 0.0, x)).max(axis=0, initial=0.0)
    h = 0.05 / (1.0 + np.maximum(change, fastest(equations, x)[0]))
    values = [nominal(equations.robot.model, name) for name in equations.parameters]
    state = portable.initial(x, 0.0, h, h, np.inf, np.array(values)[:, None] if values else None)
    ours, theirs = np.empty_like(state), np.empty_like(state)
    compiled(state, ours)
    portable(state, theirs)
    scale = 1.0 + np.abs(x).max(axis=0) + np.abs(theirs[:size] - x).max(axis=0)
    error = np.abs(ours[:size] - theirs[:size]).max(axis=0) / scale
    if equations.constraints is not None:  # beside a singular position a compiled step gives no number, on purpose
        error[np.isnan(ours[:size]).any(axis=0) & (np.arange(STATES) > 0)] = 0.0
    if not error.max() <= AGREEMENT:
        worst = int(np.argmax(np.where(np.isnan(error), np.inf, error)))
        raise CertificationError(
            f"the compiled step of {method.name} differs from Pinocchio's by {error[worst]:.1e}",
            where=f"x = {x[:, worst].tolist()}, h = {h[worst]:.3g}",
            remedy='report it with the URDF; method="scipy-dop853" does without compiled steps',
        )
