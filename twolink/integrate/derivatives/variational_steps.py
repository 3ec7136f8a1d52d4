"""Variational steps: derivatives of Runge-Kutta steps by the states they start from, for many steps at once.

    k_i = f(t_i, x_i),   dk_i = f_x(x_i) dx_i + f_p dp
    dx_i = dx + h sum_j a_ij dk_j,   dx_new = dx + h sum_i b_i dk_i

That is the method on the variational equations S' = f_x S + f_p dp. They are linear: where the states of a motion are
known, the derivatives of all its steps do not depend on each other, and are computed as one batch.

Derivatives are along tangent directions (nv), as velocities are: a quaternion's four entries do not appear.

The rate of a state and of its derivatives, x' = f(t, x, p) and S', is the traced one run on dual numbers, along the
entries of x and p: their zeros fold away. One evaluation serves several directions, which share the value and the
matrices.
"""

import copy
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple, cast

import numpy as np

from twolink.algorithms.dual_numbers import Dual, DualNamespace, derivative
from twolink.algorithms.namespaces import Numbers
from twolink.algorithms.spatial import plus, times
from twolink.errors import CertificationError, SceneError
from twolink.integrate.motion.effect_numbers import nominal_vector
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.formulas import traced_rate
from twolink.integrate.motion.pinocchio_rate import rate as rate_by_pinocchio
from twolink.integrate.motion.state import Array, StateSpace
from twolink.integrate.steps.methods import METHODS, Tableau
from twolink.native.instructions import Assembled
from twolink.native.machine import Program, trace
from twolink.native.programs import program_named

CHUNK = 200_000  # numbers in the stages of one batch, which stay in the cache
METHOD = METHODS["dop853"]
TABLEAU = cast("Tableau", METHOD.tableau)
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


class VariationalSteps:
    """Derivatives of steps of DOP853 by the state and by p parameters.

    states: the rows of a derivative: 2 nv of q in the tangent space and of v, and those of effects. directions: these
    and p. width: of directions in a batch. gains (r, p): the derivatives of what is driven (`VariationalRate`) by the
    parameters. numbers: times (n,) -> the numbers (k, n) behind the state then, where they change on the way.
    """

    def __init__(self, equations: Equations, gains: Array) -> None:
        self.equations, self.space, self.gains = equations, equations.space, gains
        self.states = equations.space.tangent
        self.directions = self.states + gains.shape[1]
        numbers = len(gains) - len(equations.parameters)
        self._rate, self.width = variational_rate(equations, self.directions, numbers)
        self._constant = constant_rows(equations)
        self.numbers: Callable[[Array], Array] | None = None

    def starting(
        self, equations: Equations, gains: Array, numbers: Callable[[Array], Array] | None = None
    ) -> "VariationalSteps":
        """Copy the steps for another segment of these equations, with the values that it has."""
        other = copy.copy(self)
        other.equations, other.gains, other._constant = equations, gains, constant_rows(equations)
        other.numbers = numbers
        return other

    def matrices(self, t: Array, x: Array, end: Array, tolerance: float) -> tuple[Array, Array]:
        """The derivatives (n, 2 nv, 2 nv + p) of steps by their starts and the parameters, and e^2 (n,).

        As `derivatives` along all directions.
        """
        seeds = np.broadcast_to(np.eye(self.directions)[:, :, None], (self.directions, self.directions, len(t)))
        found, square = self.derivatives(t, x, end, seeds, tolerance)
        return found.transpose(2, 1, 0), square

    def derivatives(
        self, t: Array, x: Array, end: Array, seeds: Array, tolerance: float = np.inf
    ) -> tuple[Array, Array]:
        """Derivatives of the states at times `end`, by one step each, along directions.

        Parameters
        ----------
        t, end : ndarray (n,)
            When the steps begin and end, s.
        x : ndarray (nq + nv, n)
            The states at their begin.
        seeds : ndarray (m, 2 nv + p, n)
            The directions: of q in the tangent space, of v, and of the parameters.
        tolerance : float
            Of errors, relative to 1 or the largest derivative in a step.

        Returns
        -------
        derivatives : ndarray (m, 2 nv, n)
        square : ndarray (n,)
            e^2, the square of the error estimate over what the tolerance admits.
        """
        size = max(64, CHUNK // (len(TABLEAU.b) * self.equations.moving * (1 + self.width)))
        out, square = np.empty((len(seeds), self.states, len(t))), np.zeros(len(t))
        for first in range(0, len(t), size):
            part = slice(first, first + size)
            for group in range(0, len(seeds), self.width):
                chosen = slice(group, group + self.width)
                own = seeds[chosen, :, part]
                before, stages = self._stages(t[part], x[:, part], end[part], own)
                h = (end - t)[part]
                after = before + _weighted(TABLEAU.b, stages).reshape(before.shape) * h
                out[chosen, :, part] = self._tangents(after, len(own))
                if np.isfinite(tolerance):
                    new = after[1 : 1 + len(own)]
                    admitted = tolerance * (1.0 + np.abs(new).max(axis=(0, 1)))
                    scaled = [_weighted(e, stages).reshape(before.shape)[1 : 1 + len(own)] * (h / admitted)
                              for e in TABLEAU.errors]  # fmt: skip
                    high, low = (np.einsum("krn,krn->kn", e, e).max(axis=0) / e.shape[1] for e in scaled)
                    square[part] = np.fmax(square[part], high * high / (high + 0.01 * low + 1e-300))
        return out, square

    def rates(self, t: Array, x: Array, seeds: Array) -> Array:
        """The rates (m, 2 nv, n) of derivatives (m, 2 nv + p, n) at states x (nq + nv, n), in a space that is flat."""
        out = np.empty((len(seeds), self.states, len(t)))
        for group in range(0, len(seeds), self.width):
            own = seeds[group : group + self.width]
            before, rows = self._rows(t, x, own)
            rows[0] = t
            out[group : group + self.width] = np.asarray(self._rate(rows)).reshape(before.shape)[1 : 1 + len(own)]
        return out

    def _stages(self, t: Array, x: Array, end: Array, seeds: Array) -> tuple[Array, Array]:
        """(x and its derivatives (1 + width, nq + nv, n), the rates of all stages (s, rows, n))."""
        before, rows = self._rows(t, x, seeds)
        h, flat = end - t, before.reshape(-1, len(t))
        state, stages = rows[len(rows) - len(flat) :], np.empty((len(TABLEAU.b), *flat.shape))
        for i, (weights, c) in enumerate(zip(TABLEAU.a, TABLEAU.c, strict=True)):
            rows[0] = t + c * h
            if weights:
                np.multiply(_weighted(weights, stages), h, out=state)
                state += flat
            self._rate(rows, stages[i])
        return before, stages

    def _rows(self, t: Array, x: Array, seeds: Array) -> tuple[Array, Array]:
        """(x and its derivatives (1 + width, nq + nv, n), the rows of the rate, without the time)."""
        space, moving, nv = self.space, self.equations.moving, self.space.nv
        count, n = len(seeds), x.shape[1]
        before = np.zeros((1 + self.width, moving, n))
        before[0] = x
        before[1 : 1 + count, : space.nq] = _from_tangent(space, x[: space.nq], seeds[:, :nv])
        before[1 : 1 + count, space.nq :] = seeds[:, nv : self.states]
        directions = np.zeros((self.width, len(self.gains), n))
        if directions.size:
            directions[:count] = np.einsum("rp,mpn->mrn", self.gains, seeds[:, self.states :])
        fixed = np.repeat(self._constant, n, axis=1)
        if self.numbers is not None:
            held = self.numbers(t)
            fixed[: len(held)] = held
        return before, np.concatenate([np.empty((1, n)), fixed, directions.reshape(-1, n), before.reshape(-1, n)])

    def _tangents(self, after: Array, count: int) -> Array:
        """Derivatives (count, 2 nv, n) in the tangent space of states and derivatives (1 + width, nq + nv, n)."""
        space, new = self.space, after[1 : 1 + count]
        if not space.curved:
            return new
        q = space.normalized(after[0], Numbers)[: space.nq]
        return np.concatenate([to_tangent(space, q, new[:, : space.nq]), new[:, space.nq :]], axis=1)


def to_tangent(space: StateSpace, q: Array, change: Array) -> Array:
    """Changes (m, nq, n) of configurations (nq, n) as tangent vectors (m, nv, n), without what leaves the manifold."""
    basis = tangent_basis(space, q)  # whose columns are orthogonal to each other
    return np.asarray(np.einsum("qkn,mqn->mkn", basis / (basis * basis).sum(axis=0), change))


def _from_tangent(space: StateSpace, q: Array, tangents: Array) -> Array:
    """The changes (m, nq, n) of configurations (nq, n) along tangent vectors (m, nv, n)."""
    return np.asarray(np.einsum("qkn,mkn->mqn", tangent_basis(space, q), tangents)) if space.curved else tangents


def tangent_basis(space: StateSpace, q: Array) -> Array:
    """q' of each unit velocity, (nq, nv, n)."""
    units = np.repeat(np.eye(space.nv)[:, :, None], q.shape[1], axis=2)
    return np.stack([space.rate(q, unit) for unit in units], axis=1)


def _weighted(weights: tuple[float, ...], stages: Array) -> Array:
    """sum_i w_i k_i of stages (s, rows, n), by one product of matrices."""
    shape = stages.shape[1:]
    flat = stages[: len(weights)].reshape(len(weights), -1)
    return np.asarray(np.asarray(weights) @ flat).reshape(shape)
