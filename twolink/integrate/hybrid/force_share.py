"""Forces of contacts on more points than determine them: whether any share of the forces obeys the laws.

    lambda = lambda_0 + Z z,   B Z = 0
    margin = max over z of min over contacts:  N_i,  of those that stick  mu N_i - |T_i|

B: the generalized forces of the contacts' rows. The laws hold as long as the margin is not negative. Where it passes 0,
the contacts whose laws are at their limit in the best share give way. It is the optimum of a cone program, found by
Newton's method along the central path (Boyd, Vandenberghe: Convex Optimization, 2004, chapter 11), for many states at
once. Margins beyond ENOUGH of the load are not followed to their optimum.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from twolink.algorithms.namespaces import Numbers
from twolink.integrate.equations import Equations
from twolink.integrate.hybrid.modes import Mode, ModeEquations, contact_places
from twolink.integrate.hybrid.snapshot import Evaluator, Snapshot
from twolink.integrate.state import Array

RANK = 1e-9  # relative: singular values below it are 0
ENOUGH = 0.02  # of the load
SAME_PLACE = 1e-13  # rad or m: configurations that are one
GROWTH, LAST, NEWTON = 8.0, 1e14, 40  # of the weight of the margin on the central path; Newton's steps for each
TIGHT = 1e-2  # of the mean weight of a law in the optimum: it is at its limit
BROKEN = 1e-9  # of the largest force: a law that is broken
EMPTY = 1e-6  # of the load: a normal force that is 0


@dataclass(frozen=True)
class Share:
    """The best share of states (n,). margin: N. forces: (n, contacts, 3). weight: of each law in the optimum."""

    margin: Array
    forces: Array
    weight: Array
    load: float


class ForceShare:
    """The shares of the forces of a mode's closed contacts, which rigid bodies do not determine."""

    def __init__(self, own: ModeEquations, mode: Mode, static: Array) -> None:
        self.own = own
        self.contacts = tuple(own.rows)
        self.sticks = np.array([mode.contacts[i] == "rolling" for i in self.contacts])
        self.friction = np.where(self.sticks, static[list(self.contacts)], 1.0)
        self._ways: tuple[Array, Array] | None = None  # q, and Z there

    def best(self, snapshot: Snapshot) -> Share:
        """The best share of the states of a snapshot."""
        base = self._base(snapshot)
        out = None
        q = snapshot.x[: self.own.equations.space.nq].T
        for first in range(len(q)):
            if out is None or np.isnan(out.margin[first]):
                same = np.abs(q - q[first]).max(axis=1) <= SAME_PLACE
                part = self._solved(base[same], self.ways(snapshot, first))
                out = out or Share(np.full(len(q), np.nan), np.empty(base.shape), np.empty(base.shape[:2]), part.load)
                out.margin[same], out.forces[same], out.weight[same] = part.margin, part.forces, part.weight
        return out or Share(np.empty(0), base, base[:, :, 0], 0.0)

    def ways(self, snapshot: Snapshot, number: int) -> Array:
        """Z at one state, (contacts, 3, k): forces that together do nothing."""
        q = snapshot.x[: self.own.equations.space.nq, number]
        if self._ways is None or np.abs(self._ways[0] - q).max() > SAME_PLACE:
            columns, places = self.columns(snapshot.x[:, number])
            _, sizes, right = np.linalg.svd(columns)
            null = right[int((sizes > RANK * max(1e-300, sizes[0])).sum()) :]
            ways = np.zeros((len(self.contacts), 3, len(null)))
            for row, (contact, entry) in zip(null.T, places, strict=True):
                ways[contact, entry] = row
            self._ways = np.array(q), ways
        return self._ways[1]

    def columns(self, x: Array) -> tuple[Array, list[tuple[int, int]]]:
        """B of the contacts' rows at a state (size,), and of each column its contact and entry."""
        equations = self.own.equations
        constraints = equations.constraints
        if constraints is None:
            return np.empty((equations.space.nv, 0)), []
        counts = constraints.counts[len(constraints.counts) - len(self.contacts) :]
        rows = range(len(constraints.all_rows) - sum(counts), len(constraints.all_rows))
        every = replace(constraints, kept=tuple(constraints.all_rows), shares=None)
        q, v = x[: equations.space.nq], x[equations.space.nq : equations.moving]
        jacobian = every.jacobian(equations.mechanism, q, Numbers)
        numbers = list(x[equations.moving :])
        loops = equations.layout.with_numbers(constraints.loops, numbers)
        forces = np.array(every.force_rows(equations.mechanism, q, v, Numbers, jacobian, loops), dtype=float)
        free = np.array(equations.layout.free(numbers), dtype=float)
        return (forces[rows] * free).T, [(c, k) for c, count in enumerate(counts) for k in range(count)]

    def _base(self, snapshot: Snapshot) -> Array:
        """The multipliers of the kept rows, 0 for the others, (n, contacts, 3)."""
        base = np.zeros((len(snapshot.t), len(self.contacts), 3))
        for c, i in enumerate(self.contacts):
            rows = self.own.contact_forces(snapshot, i)
            base[:, c, : len(rows)] = rows.T
        return base

    def _solved(self, base: Array, ways: Array) -> Share:
        """The best shares of states of one configuration."""
        load = max(1e-300, float(np.abs(base).max(initial=0.0)))
        scaled, y = base / load, np.zeros((len(base), ways.shape[2] + 1))
        # The cones t > |T| with t = mu N - s, and t = N - s: as (t, T), which are linear in y = (z, s).
        cone = np.concatenate([ways, np.zeros((*ways.shape[:2], 1))], axis=2)
        start = scaled.copy()
        cone[:, 0] *= self.friction[:, None]
        start[..., 0] *= self.friction
        cone[~self.sticks, 1:] = start[:, ~self.sticks, 1:] = 0.0
        cone[:, 0, -1] = -1.0
        y[:, -1] = (start[..., 0] - np.linalg.norm(start[..., 1:], axis=2)).min(axis=1) - 1.0
        weight, open_ = 1.0, np.ones(len(y), dtype=bool)
        while weight < LAST and open_.any():
            y[open_] = _central(y[open_], start[open_], cone, weight)
            open_ = y[:, -1] <= ENOUGH
            weight *= GROWTH
        u = start + np.einsum("cik,nk->nci", cone, y)
        size = np.maximum(_square(u), 1e-300)
        forces = scaled + np.einsum("cik,nk->nci", ways, y[:, :-1])
        return Share(load * y[:, -1], load * forces, 2.0 * u[..., 0] / (size * weight / GROWTH), load)


def within_laws(
    equations: Equations, evaluator: Evaluator, closed: Sequence[Any], t: Array, x: Array, every: Array
) -> Array:
    """Multipliers (rows, n) of all rows at states x (size, n), the best share where those given break a law.

    closed: the constraints of the contacts, with `rolling` and `friction`, which are the last of the equations.
    """
    constraints = equations.constraints
    if constraints is None:
        return every
    numbers = list(range(len(closed)))
    own = ModeEquations(equations, evaluator, contact_places(constraints, numbers))
    mode = Mode(tuple("rolling" if loop.rolling else "sliding" for loop in closed))
    share = ForceShare(own, mode, np.array([loop.friction for loop in closed]))
    ends = np.cumsum(constraints.counts)[-len(closed) :]
    places = [slice(end - (3 if loop.rolling else 1), end) for end, loop in zip(ends, closed, strict=True)]
    margins = [loop.friction * every[p.start] - np.hypot(*every[p][1:]) if loop.rolling else every[p.start]
               for p, loop in zip(places, closed, strict=True)]  # fmt: skip
    bad = np.min(margins, axis=0) < -BROKEN * np.abs(every).max(axis=0, initial=0.0)
    if bad.any():
        best = share.best(evaluator.by_numpy(t[bad], x[:, bad]))
        for c, place in enumerate(places):
            every[place, bad] = best.forces[:, c, : place.stop - place.start].T
    return every


def _square(u: Array) -> Array:
    """t^2 - |T|^2, (n, contacts)."""
    return np.asarray(u[..., 0] ** 2 - (u[..., 1:] ** 2).sum(axis=-1))


def _central(y: Array, start: Array, cone: Array, weight: float) -> Array:
    """The minimum of -weight s - sum log(t^2 - |T|^2), from an interior point y (n, k), by Newton's method."""
    signs = np.array([1.0, -1.0, -1.0])
    for _ in range(NEWTON):
        u = start + np.einsum("cik,nk->nci", cone, y)
        inverse = 1.0 / _square(u)
        rows = np.einsum("cik,nci->nck", cone, signs * u)
        slope = -2.0 * np.einsum("nc,nck->nk", inverse, rows)
        slope[:, -1] -= weight
        bend = 4.0 * np.einsum("nc,nck,ncl->nkl", inverse**2, rows, rows)
        bend -= 2.0 * np.einsum("nc,cik,i,cil->nkl", inverse, cone, signs, cone)
        bend += 1e-13 * np.einsum("nkk->n", bend)[:, None, None] * np.eye(y.shape[1])
        step = -np.linalg.solve(bend, slope[..., None])[..., 0]
        decrease = np.sqrt(np.maximum(0.0, -(slope * step).sum(axis=1)))
        y = y + (step / (1.0 + decrease)[:, None] if decrease.max() > 0.25 else step)
        if decrease.max() <= 1e-3:
            break
    return y
