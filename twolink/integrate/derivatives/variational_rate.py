"""The rate of a state and its derivatives along directions: the right-hand side of variational equations.

    x' = f(t, x, p),   S' = (df/dx) S + (df/dp) dp

The traced rate is run on dual numbers, along the entries of x and p: their zeros fold away. One evaluation serves
several directions, which share the value and the matrices.
"""

from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from twolink.algorithms.dual_numbers import Dual, DualNamespace, derivative
from twolink.algorithms.spatial import plus, times
from twolink.errors import CertificationError, SceneError
from twolink.integrate.motion.effect_numbers import nominal_vector
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.formulas import traced_rate
from twolink.integrate.motion.pinocchio_rate import rate as rate_by_pinocchio
from twolink.integrate.motion.state import Array
from twolink.native.instructions import Assembled
from twolink.native.machine import Program, trace
from twolink.native.programs import program_named

MAX_OPERATIONS = 40_000  # of one evaluation, within which it serves as many directions as possible
DERIVATIVE = 2.0  # times as many operations as the value, along one direction
STATES, AROUND = 4, 0.3  # compared with differences of Pinocchio's rates: so many, within [rad, m, per second]
STEPS = 1e-3, 1e-4, 1e-5  # of these differences, whose error is the fourth power; forces may be steep
AGREEMENT = 1e-6  # relative


class VariationalRate(NamedTuple):
    """Call it with rows (., n) and an array for the results.

    Rows: t, the numbers of the state behind (q, v), the parameters, the sides of limits of effort, of each direction
    the changes of what is driven, then x = (q, v) and of each direction that of x. Driven are the last of the numbers,
    if any, and the parameters.
    Results: the rates of x and of each direction. width: of directions.
    """

    call: Program
    width: int


def variational_rate(equations: Equations, directions: int, numbers: int) -> VariationalRate:
    """The program for so many directions, at best all in one evaluation. numbers: how many of them are driven.

    Raises CertificationError when it disagrees with Pinocchio.
    """
    width = max(1, directions)
    while width > 1 and equations.operations * (1.0 + DERIVATIVE * width) > MAX_OPERATIONS:
        width = -(-width // 2)

    def traced() -> Assembled:
        count = sum(row_sizes(equations, width, numbers))
        return trace(lambda rows, xp: traced_variation(equations, width, numbers, rows, xp), count)

    program = program_named(equations.key("variational", str(width), str(numbers)), traced,
                            lambda code: certify_variation(equations, code, width, numbers))  # fmt: skip
    return VariationalRate(program, width)


def constant_rows(equations: Equations) -> Array:
    """The rows (., 1) that are the same for all states: numbers behind (q, v), parameters, and sides of limits."""
    sides = np.array(equations.sides or (), dtype=float)
    return np.concatenate([equations.start[equations.moving :], nominal_vector(equations), sides])[:, None]


def side_count(equations: Equations) -> int:
    """The number of joints that have limits of effort."""
    return len(equations.effort_limits) // 2


def sides_in_turn(equations: Equations) -> Equations:
    """The equations with the sides of limits of effort chosen in turn, to compare one side with Pinocchio each."""
    return replace(equations, sides=tuple(float(i % 3 - 1) for i in range(side_count(equations))))


def row_sizes(equations: Equations, width: int, driven: int) -> list[int]:
    """Numbers of rows of each kind that `traced_variation` takes, in order; see `VariationalRate`."""
    moving, count = equations.moving, len(equations.parameters)
    numbers, directions = equations.space.size - moving, width * (driven + count)
    return [1, numbers, count, side_count(equations), directions, moving, width * moving]


def traced_variation(equations: Equations, width: int, driven: int, rows: Array, xp: Any) -> list[Any]:
    """The rates of x and of each direction as expressions of the rows, ((1 + width) moving)."""
    space, count, moving = equations.space, len(equations.parameters), equations.moving
    constant = space.size - moving - driven
    (t,), numbers, values, sides, directions, x, tangents = np.split(
        rows, np.cumsum(row_sizes(equations, width, driven))[:-1]
    )
    equations = replace(equations, sides=tuple(sides))
    changes = np.concatenate([tangents.reshape(width, moving), directions.reshape(width, driven + count)], axis=1)
    units = iter(np.eye(changes.shape[1]).tolist())  # of df/dx and df/dp, which serve all directions
    state = [Dual(a, next(units)) for a in x]
    state += [Dual(a, [0.0] * changes.shape[1]) for a in numbers[:constant]]
    state += [Dual(a, next(units)) for a in numbers[constant:]]
    constants = {name: Dual(a, next(units)) for name, a in zip(equations.parameters, values, strict=True)}
    whole = np.empty(len(state), dtype=object)
    whole[:] = state
    try:
        out = traced_rate(equations, t, whole, DualNamespace(xp, changes.shape[1]), constants)[:moving]
    except TypeError as error:  # a number that is used as a constant
        raise SceneError(f"one of {', '.join(equations.parameters)} is used as a constant", argument="wrt",
                         remedy="leave it out", code="sensitivities-constant") from error  # fmt: skip
    along = [plus(*map(times, entry.tangents, change)) for change in changes for entry in out]
    return [*(entry.value for entry in out), *along]


def certify_variation(equations: Equations, code: Any, width: int, driven: int) -> None:
    """Compare with differences of Pinocchio's rates. Raises CertificationError."""
    equations = sides_in_turn(equations)
    space, moving, count = equations.space, equations.moving, len(equations.parameters)
    random = np.random.default_rng(1)
    x = np.repeat(equations.start[:, None], STATES, axis=1)
    shift = random.uniform(-AROUND, AROUND, (moving, STATES - 1))
    x[:moving, 1:] += shift
    if equations.constraints is None and not all(effect.analytic for effect in equations.effects):
        x[:moving, 0] -= 0.5 * shift[:, 0]  # a start at rest may be where a formula is not smooth
    along = np.zeros((width, space.size, STATES))
    along[:, :moving] = random.uniform(-1.0, 1.0, (width, moving, STATES))
    rows = np.concatenate([np.zeros((1, STATES)), np.repeat(constant_rows(equations), STATES, axis=1),
                           np.zeros((width * (driven + count), STATES)), x[:moving],
                           along[:, :moving].reshape(-1, STATES)])  # fmt: skip
    ours = np.asarray(code(rows)).reshape(1 + width, moving, STATES)

    def rate(k: float, step: float) -> Array:
        """(width, moving, states)."""
        return np.array([rate_by_pinocchio(equations, 0.0, x + k * step * d)[:moving] for d in along])

    error = np.full(STATES, np.inf)
    for step in STEPS:
        theirs = derivative(partial(rate, step=step), step)
        scale = 1.0 + np.nan_to_num(np.abs(theirs)).max(axis=(0, 1)) + np.nan_to_num(np.abs(ours[0])).max(axis=0)
        error = np.fmin(error, np.abs(ours[1:] - theirs).max(axis=(0, 1)) / scale)
        if equations.constraints is not None or not np.isfinite(theirs).all():
            error[np.isnan(theirs).any(axis=(0, 1)) & (np.arange(STATES) > 0)] = 0.0
        if error.max() <= AGREEMENT:
            return
    raise CertificationError(
        f"compiled derivatives differ from those of Pinocchio's rates by {error.max():.1e}",
        where=f"x = {x[:, int(np.argmax(error))].tolist()}",
        remedy="report it with the URDF",
    )
