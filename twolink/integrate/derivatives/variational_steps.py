"""Variational steps: derivatives of Runge-Kutta steps by the states they start from, for many steps at once.

    k_i = f(t_i, x_i),   dk_i = f_x(x_i) dx_i + f_p dp
    dx_i = dx + h sum_j a_ij dk_j,   dx_new = dx + h sum_i b_i dk_i

That is the method on the variational equations S' = f_x S + f_p dp. They are linear: where the states of a motion are
known, the derivatives of all its steps do not depend on each other, and are computed as one batch.

Derivatives are along tangent directions (nv), as velocities are: a quaternion's four entries do not appear.
"""

import copy
from collections.abc import Callable
from typing import cast

import numpy as np

from twolink.algorithms.namespaces import Numbers
from twolink.integrate.derivatives.variational_rate import constant_rows, variational_rate
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.state import Array, StateSpace
from twolink.integrate.steps.methods import METHODS
from twolink.integrate.steps.tableau import Tableau

CHUNK = 200_000  # numbers in the stages of one batch, which stay in the cache
METHOD = METHODS["dop853"]
TABLEAU = cast("Tableau", METHOD.tableau)


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
