"""Forces of contacts on more points than determine them: whether any share of the forces obeys the laws.

    lambda = lambda_0 + Z z,   F B Z = 0,   torques of locked joints = those of lambda_0 - B Z z
    margin = max over z of min over contacts:  N_i,  of those that stick  mu N_i - |T_i|
                       and over locked joints: how far their torques are within what locks them

B: the generalized forces of the rows of contacts, and of loops, which have no law; F: those on joints that are not
locked. The laws hold as long as the margin is not negative. Where it passes 0, the contacts and joints whose laws are
at their limit in the best share give way. It is the optimum of a cone program, found by Newton's method along the
central path (Boyd, Vandenberghe: Convex Optimization, 2004, chapter 11), for many states at once. A margin counts up to
ENOUGH of the load: where the smallest forces have that, nothing is optimized.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from twolink.integrate.hybrid.contact_problem import lock_limits
from twolink.integrate.hybrid.modes import Mode, ModeEquations, ModeState, contact_places
from twolink.integrate.hybrid.snapshot import Evaluator, Snapshot
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.state import Array

RANK = 1e-6  # relative: singular values below it are 0; slow slips have directions with so much rounding
ENOUGH = 0.02  # of the load
SAME = 1e-13  # relative: generalized forces that are the same
GROWTH, LAST, NEWTON = 32.0, 1e14, 40  # of the weight of the margin on the central path; Newton's steps for each
BISECTIONS = 50
MOST, TINY = 1.0, 1e-300  # of the load: the largest margin that is looked for
ALONG = 6  # steps of the search for the minimum along one of those
TIGHT = 1e-2  # of the mean weight of a law in the optimum: it is at its limit
BROKEN = 1e-9  # of the largest force: a law that is broken
EMPTY = 1e-6  # of the load: a normal force that is 0
SIGNS = np.array([1.0, -1.0, -1.0])  # of t^2 - |T|^2


@dataclass(frozen=True)
class ForceDistribution:
    """The best forces in states (n,). margin: N. forces: (n, supports, 3). weight: of each law in the optimum."""

    margin: Array
    forces: Array
    weight: Array
    load: float


@dataclass(frozen=True)
class Support:
    """A joint that is locked: its row of the snapshot's `locks`, its degree of freedom, what can lock it, N m or N."""

    row: int
    dof: int
    least: float
    greatest: float

    @property
    def both(self) -> bool:
        """True if its torque has two limits."""
        return math.isfinite(self.least) and math.isfinite(self.greatest)

    def within(self, torque: Array) -> Array:
        """The torque (n,) as a contact's force (n, 3): N is what is left to the one limit, or N and T of two."""
        out = np.zeros((len(torque), 3))
        if self.both:
            out[:, 0] = 0.5 * (self.greatest - self.least)
            out[:, 1] = torque - 0.5 * (self.greatest + self.least)
        elif math.isfinite(self.least) or math.isfinite(self.greatest):
            out[:, 0] = torque - self.least if math.isfinite(self.least) else self.greatest - torque
        return out

    def torque(self, force: Array) -> float:
        """The torque of such a force (3,)."""
        if self.both:
            return float(force[1]) + 0.5 * (self.greatest + self.least)
        return float(force[0]) + self.least if math.isfinite(self.least) else self.greatest - float(force[0])


def share_of(state: ModeState) -> ForceDistributionProblem:
    """The shares of the forces of what touches and what is locked in a state of its mode."""
    system = state.system
    supports = [Support(system.lockable.index(k), k, *limits) for k, limits in lock_limits(state).items()]
    return ForceDistributionProblem(state.own, state.mode, np.array([one.static for one in system.contacts]), supports)


class ForceDistributionProblem:
    """The shares of the forces of a mode's closed contacts, not determined by rigid bodies. supports: locked joints."""

    def __init__(self, own: ModeEquations, mode: Mode, static: Array, supports: Sequence[Support] = ()) -> None:
        self.own, self.supports = own, tuple(supports)
        self.contacts = tuple(own.rows)
        sticks = np.array([mode.contacts[i] == "rolling" for i in self.contacts])
        self.friction = np.append(np.where(sticks, static[list(self.contacts)], 1.0), np.ones(len(self.supports)))
        self.entries = [(c, k) for c, rolls in enumerate(sticks) for k in range(3 if rolls else 1)]  # of columns
        self.sticks = np.append(sticks, np.array([one.both for one in self.supports], dtype=bool))
        self.free = np.ones(own.equations.space.nv)
        self.free[sorted(mode.locked)] = 0.0
        self._ways: tuple[Array, Array] | None = None  # B, and Z of it

    def best(self, snapshot: Snapshot) -> ForceDistribution:
        """The best share of the states of a snapshot."""
        base, columns = self._base(snapshot), self._every_column(snapshot)
        load = max(1e-300, float(np.abs(base).max(initial=0.0)))
        out = ForceDistribution(np.empty(len(base)), np.empty_like(base), np.empty(base.shape[:2]), load)
        for chosen, ways in self.ways(columns):
            part = self._solved(base[chosen], ways, load)
            out.margin[chosen], out.forces[chosen], out.weight[chosen] = part.margin, part.forces, part.weight
        return out

    def ways(self, columns: Array) -> Iterator[tuple[Array, Array]]:
        """Z of states with B (n, nv, columns): states with k ways in common, and Z (states or 1, supports, 3, k).

        Its columns are forces of contacts that together move nothing, each of size 1 and orthogonal to the others, and
        below them what they do to the joints that are locked.
        """
        small = SAME * np.abs(columns).max(initial=0.0)
        if self._ways is not None and (np.abs(columns - self._ways[0]) <= small).all():
            yield np.arange(len(columns)), self._ways[1]
            return
        apart = np.abs(np.diff(columns, axis=0)).max(axis=(1, 2)) > small
        place = np.cumsum(np.concatenate([[False], apart]))  # of each state, its B
        columns_of = columns[np.searchsorted(place, np.arange(place[-1] + 1))]
        _, sizes, right = np.linalg.svd(columns_of * self.free[:, None])
        ranks = (sizes > RANK * np.maximum(1e-300, sizes[:, :1])).sum(axis=1)
        for rank in np.unique(ranks):
            these = np.flatnonzero(ranks == rank)
            ways = np.zeros((len(these), len(self.contacts) + len(self.supports), 3, columns.shape[2] - rank))
            for k, (contact, entry) in enumerate(self.entries):
                ways[:, contact, entry] = right[these, rank:, columns.shape[2] - len(self.entries) + k]
            for c, one in enumerate(self.supports, len(self.contacts)):
                torque = -np.einsum("sk,swk->sw", columns_of[these, one.dof], right[these, rank:])
                ways[:, c, int(one.both)] = torque if one.both or math.isfinite(one.least) else -torque
            chosen = np.flatnonzero(ranks[place] == rank)
            of_states = ways[np.searchsorted(these, place[chosen])]
            if chosen[-1] == len(columns) - 1:
                self._ways = columns[-1:], of_states[-1:]
            yield chosen, of_states

    def columns(self, snapshot: Snapshot) -> Array:
        """F B of the rows of loops, then of contacts, at the states of a snapshot, (n, nv, columns)."""
        return self._every_column(snapshot) * self.free[:, None]

    def _every_column(self, snapshot: Snapshot) -> Array:
        """B."""
        count = len(snapshot.t)
        return snapshot.columns.T.reshape(count, -1, len(self.free)).swapaxes(1, 2)

    def _base(self, snapshot: Snapshot) -> Array:
        """The multipliers of the kept rows, 0 for the others, and what locks joints, (n, supports, 3)."""
        base = np.zeros((len(snapshot.t), len(self.contacts) + len(self.supports), 3))
        for c, i in enumerate(self.contacts):
            rows = self.own.contact_forces(snapshot, i)
            base[:, c, : len(rows)] = rows.T
        for c, one in enumerate(self.supports, len(self.contacts)):
            base[:, c] = one.within(snapshot.locks[one.row])
        return base

    def _solved(self, base: Array, ways: Array, load: float) -> ForceDistribution:
        """The best shares of states, of Z (states or 1, supports, 3, k)."""
        scaled, y = base / load, np.zeros((len(base), ways.shape[3] + 1))
        own, count = slice(len(self.contacts)), 3 * len(self.contacts)
        excess = scaled[:, own].reshape(len(base), 1, count) @ ways[:, own].reshape(len(ways), count, ways.shape[3])
        scaled = scaled - _applied(ways, excess[:, 0])  # the smallest forces
        inner = self._margin(scaled)
        if inner.min() > ENOUGH:
            return ForceDistribution(np.full(len(base), load * ENOUGH), load * scaled, np.zeros(base.shape[:2]), load)
        # The cones t > |T| with t = mu N - s, and t = N - s: as (t, T), which are linear in y = (z, s).
        cone = np.concatenate([ways, np.zeros((*ways.shape[:3], 1))], axis=3)
        start = scaled.copy()
        cone[:, :, 0] *= self.friction[:, None]
        start[..., 0] *= self.friction
        cone[:, ~self.sticks, 1:] = start[:, ~self.sticks, 1:] = 0.0
        cone[:, :, 0, -1] = -1.0
        cone = np.broadcast_to(cone, (len(base), *cone.shape[1:]))
        y[:, -1] = inner - 1.0
        weight, open_ = 1.0, inner <= ENOUGH
        while weight < LAST and open_.any():
            y[open_] = _central(y[open_], start[open_], cone[open_], weight)
            open_ &= y[:, -1] <= ENOUGH
            weight *= GROWTH
        u = start + _applied(cone, y)
        size = np.maximum(_square(u), 1e-300)
        more = _applied(ways, y[:, :-1])
        forces = scaled + self._least(scaled, more, inner)[:, None, None] * more
        margin = np.where(inner > ENOUGH, ENOUGH, np.minimum(y[:, -1], ENOUGH))
        return ForceDistribution(load * margin, load * forces, 2.0 * u[..., 0] / (size * weight / GROWTH), load)

    def _margin(self, forces: Array) -> Array:
        """The margins (n,) of forces (n, supports, 3)."""
        across = np.sqrt(forces[..., 1] ** 2 + forces[..., 2] ** 2) * self.sticks
        return np.asarray((self.friction * forces[..., 0] - across).min(axis=1))

    def _least(self, smallest: Array, more: Array, inner: Array) -> Array:
        """The least parts (n,) of what is added to the smallest forces that make a margin ENOUGH; 1 where none does.

        So forces go on from the smallest ones, whose margins are `inner`, and what is jammed is not pressed at will.
        """
        least, most = np.zeros(len(inner)), np.ones(len(inner))
        for _ in range(BISECTIONS):
            middle = 0.5 * (least + most)
            fine = self._margin(smallest + middle[:, None, None] * more) >= ENOUGH
            least, most = np.where(fine, least, middle), np.where(fine, middle, most)
        return np.where(inner > ENOUGH, 0.0, most)


def margins(equations: Equations, closed: Sequence[Any], look: Snapshot, supports: Sequence[Support]) -> Array:
    """Margins of the best shares within the laws of the states of a snapshot with the columns of all closed contacts.

    (n,), N. closed, supports: see `_of_loops`.
    """
    return _of_loops(equations, closed, supports)[1].best(look).margin


def _of_loops(
    equations: Equations, closed: Sequence[Any], supports: Sequence[Support]
) -> tuple[Evaluator, ForceDistributionProblem]:
    """The shares of equations with contacts.

    closed: the constraints of the contacts, with `rolling` and `friction`, which are the last of the equations.
    supports: the joints that are locked at all states.
    """
    evaluator = Evaluator(equations, columns_of=len(closed))
    rows = {} if equations.constraints is None else contact_places(equations.constraints, range(len(closed)))
    mode = Mode(tuple("rolling" if loop.rolling else "sliding" for loop in closed),
                locked=frozenset(one.dof for one in supports))  # fmt: skip
    static = np.array([loop.friction for loop in closed])
    return evaluator, ForceDistributionProblem(ModeEquations(equations, evaluator, rows), mode, static, supports)


def within_laws(equations: Equations, closed: Sequence[Any], t: Array, x: Array, every: Array) -> Array:
    """Multipliers (rows, n) of all rows at states x (size, n), the best share where those given break a law.

    closed: see `_of_loops`.
    """
    constraints = equations.constraints
    if constraints is None:
        return every
    evaluator, share = _of_loops(equations, closed, ())
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


def _applied(ways: Array, y: Array) -> Array:
    """Forces (n, contacts, 3) of ways (n or 1, contacts, 3, k) by weights y (n, k)."""
    return np.asarray((ways @ y[:, None, :, None])[..., 0])


def _central(y: Array, start: Array, cone: Array, weight: float) -> Array:
    """The minimum of -weight s - sum log(t^2 - |T|^2), from an interior point y (n, k), by Newton's method.

    Of what is jammed there is none: contacts press as hard as one likes. Its s goes as far as MOST.
    """
    n, contacts, _, k = cone.shape
    flat = cone.reshape(n, 3 * contacts, k)
    for _ in range(NEWTON):
        u = start + _applied(cone, y)
        inverse = 1.0 / _square(u)
        rows = ((SIGNS * u)[:, :, None, :] @ cone)[:, :, 0]
        slope = -2.0 * (inverse[:, None, :] @ rows)[:, 0]
        slope[:, -1] -= weight
        scaled = (2.0 * inverse)[:, :, None] * rows
        turned = (inverse[:, :, None] * SIGNS).reshape(n, -1, 1) * flat
        bend = scaled.swapaxes(1, 2) @ scaled - 2.0 * flat.swapaxes(1, 2) @ turned
        bend += 1e-13 * np.einsum("nkk->n", bend)[:, None, None] * np.eye(k)
        step = -np.linalg.solve(bend, slope[..., None])[..., 0]
        decrease = np.sqrt(np.maximum(0.0, -(slope * step).sum(axis=1)))
        going = y[:, -1] < MOST
        far = decrease[going].max(initial=0.0)
        if far > 0.25:
            step *= _length(weight * step[:, -1], u, _applied(cone, step), decrease)
        part = (MOST - y[:, -1]) / np.fmax(step[:, -1], TINY)  # of the step, to the largest margin that is looked for
        y = y + (going * np.clip(part, 0.0, 1.0))[:, None] * step
        if far <= 1e-3:
            break
    return y


def _length(gain: Array, u: Array, way: Array, decrease: Array) -> Array:
    """The lengths (n, 1) of ways from u (n, contacts, 3) to the minimum along them, by damped steps of Newton's method.

    gain: of the weighted margin along each. The steps stay inside, since the logarithms are self-concordant (Boyd,
    Vandenberghe, section 9.6).
    """
    c, b, a = _square(u), (SIGNS * u * way).sum(axis=-1), _square(way)  # a length^2 + 2 b length + c
    length = 1.0 / (1.0 + decrease)
    for _ in range(ALONG):
        square = (a * length[:, None] + 2.0 * b) * length[:, None] + c
        rate = 2.0 * (a * length[:, None] + b) / square
        slope, bend = gain + rate.sum(axis=1), np.maximum(1e-300, (rate**2 - 2.0 * a / square).sum(axis=1))
        length = length + slope / (bend + np.abs(slope) * np.sqrt(bend))
    return length[:, None]
