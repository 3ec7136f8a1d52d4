"""Constraints: rows g(q) = 0 or b(q) v = 0 kept by forces, and by projection after every step.

    M a + h = tau + B lambda,   J a = -J' v       (J v = g', the derivative of the rows; B = J^T but for friction)

With A = J M^-1 B: A lambda = -J' v - J M^-1 (tau - h). After a step, q goes back to g = 0 and v to J v = 0 along
M^-1 J^T, the direction that changes the motion least in terms of its kinetic energy. J and J' v are not derived by
hand: g is evaluated on jets of q(t).

Where a mechanism passes a singular position, A is singular for an instant, while the motion goes on smoothly. Nothing
is divided near that instant: an evaluation there is NaN, which makes the step try another size, until none of its
stages falls there (test case: IFToMM benchmark A02). Projection: Eich 1993, SIAM J. Numer. Anal. 30, 1467-1482.

With M = L^T D L, Y = J L^-1 D^-1 and Z = L^-T B, the multipliers follow from A lambda = r - Y L^-T f, A = Y Z. Two
rows are coupled only where the force of one causes motion that the other sees. What is not coupled is the constant 0
in A, and the rows are eliminated in an order that keeps most of these zeros: a row of N four-bars takes about N
operations, and not N^3.
"""

import functools
import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from twolink.algorithms.dual_numbers import Jet, JetNamespace, coefficient
from twolink.algorithms.factors import elimination_order, factored, ldlt, ldlt_apply, ldlt_inward, ldlt_outward, solved
from twolink.algorithms.mechanism import Mechanism
from twolink.algorithms.motion import KinematicState
from twolink.algorithms.namespaces import Numbers
from twolink.algorithms.recursions import composite_bodies, newton_euler, poses
from twolink.algorithms.spatial import Matrix, Scalar, is_zero, minus, negative, plus, times
from twolink.algorithms.tape import Tape
from twolink.effects.inputs import with_pieces
from twolink.effects.loops import Loop
from twolink.integrate.motion.state import Array, StateSpace


class RowSolver:
    """Solves M a = f + B lambda, J a = r from the factors of M.

    J and B are scaled by rows, so that a pivot of A below `singular` means a singular position: NaN there.
    """

    def __init__(
        self,
        jacobian: Matrix,
        forces: Matrix,
        factors: tuple[Matrix, list[Scalar]],
        parents: list[int],
        scales: Sequence[float],
        xp: Any,
        singular: float,
    ) -> None:
        self._symmetric = symmetric = forces is jacobian
        self._lower, self._inverse = factors
        self._parents = parents
        moved = self._halves(jacobian, scales)  # Z^T for J in place of B
        pushed = moved if symmetric else self._halves(forces, scales)
        seen = [{k: times(self._inverse[k], entry) for k, entry in row.items()} for row in moved]
        matrix = [[_dot(row, column) for column in pushed] for row in seen]
        order = elimination_order(matrix) if symmetric else list(range(len(matrix)))
        self._order, self._scales = order, [scales[i] for i in order]
        self._seen, self._pushed = [seen[i] for i in order], [pushed[i] for i in order]
        self._chain = list(range(-1, len(matrix) - 1))  # every row may depend on those before
        matrix, pivots = [[matrix[i][j] for j in order] for i in order], _Pivots(xp, singular)
        self._factors = ldlt(matrix, self._chain, pivots) if symmetric else factored(matrix, pivots)

    def __call__(self, force: Sequence[Scalar], right: Sequence[Scalar]) -> tuple[list[Scalar], list[Scalar]]:
        """(a, lambda) for f and r."""
        half = ldlt_inward(self._lower, self._parents, force)
        wanted = [minus(times(s, right[i]), _dot(row, half))
                  for i, s, row in zip(self._order, self._scales, self._seen, strict=True)]  # fmt: skip
        scaled = (ldlt_apply(*self._factors, self._chain, wanted) if self._symmetric
                  else solved(*self._factors, wanted))  # fmt: skip
        multipliers: list[Scalar] = [0.0] * len(scaled)
        for i, s, size, column in zip(self._order, self._scales, scaled, self._pushed, strict=True):
            multipliers[i] = times(s, size)
            for k, entry in column.items():
                half[k] = plus(half[k], times(entry, size))
        return ldlt_outward(self._lower, self._inverse, self._parents, half), multipliers

    def _halves(self, rows: Matrix, scales: Sequence[float]) -> list[dict[int, Scalar]]:
        """L^-T of each scaled row, by the entries that are not the constant 0."""
        scaled = ([times(scale, entry) for entry in row] for scale, row in zip(scales, rows, strict=True))
        halves = (ldlt_inward(self._lower, self._parents, row) for row in scaled)
        return [{k: entry for k, entry in enumerate(half) if not is_zero(entry)} for half in halves]


class _Pivots:
    """Reciprocals of pivots: NaN for one that is nearly 0."""

    def __init__(self, xp: Any, singular: float) -> None:
        self._xp, self._singular = xp, singular

    def reciprocal(self, pivot: Scalar) -> Scalar:
        """1 / pivot."""
        return self._xp.where(self._xp.less(self._singular, pivot), 1.0 / pivot, np.nan)


def _dot(row: Mapping[int, Scalar], column: Mapping[int, Scalar] | Sequence[Scalar]) -> Scalar:
    """Row times column, by the entries that are not the constant 0."""
    terms = row.items()
    if isinstance(column, Mapping):
        return plus(*(times(entry, column[k]) for k, entry in terms if k in column))
    return plus(*(times(entry, column[k]) for k, entry in terms))


SINGULAR = 1e-6  # a pivot of the scaled A: nearer to 0 its rounding, 1e-16 / 1e-6, would be seen
LANDING = 1e3  # times farther from it a step may end: the projection multiplies errors by 1 / sqrt(pivot)
CORRECTIONS = 3  # of q after a step, with the matrices of the first: each takes the error to about its square


@dataclass(frozen=True, eq=False)
class Constraints:
    """The rows of a scene's loops and contacts on a robot.

    counts: how many rows each loop has. kept: the rows that are not redundant. scales: a factor for each kept row that
    makes the diagonal of A about 1 away from singular positions. supports: of each row, redundant ones too, the degrees
    of freedom that it or its force depends on. shares: the part of each kept multiplier that each row takes,
    redundant ones too, where it is the same everywhere: the smallest multipliers with the same effect. None: the kept
    rows take all.
    """

    space: StateSpace
    mech: Mechanism
    loops: tuple[Loop, ...]
    counts: tuple[int, ...]
    kept: tuple[int, ...]
    scales: tuple[float, ...]
    supports: tuple[frozenset[int], ...]
    shares: tuple[tuple[float, ...], ...] | None = None

    @property
    def model(self) -> pin.Model:
        """The robot's model."""
        return self.space.robot.model

    @property
    def all_rows(self) -> range:
        """The numbers of all rows, redundant ones too."""
        return range(sum(self.counts))

    @property
    def touching(self) -> list[Loop]:
        """The constraints of closed contacts, which are the last ones."""
        return [loop for loop in self.loops if loop.touches]

    def residuals(self, mech: Mechanism, q: Sequence[Any], xp: Any) -> list[Scalar]:
        """g(q) of all rows; 0 for those of velocities."""
        motion = KinematicState(self.model, mech, q, [0.0] * self.space.nv, 0.0, xp)
        rows: list[Scalar] = []
        for loop, count in zip(self.loops, self.counts, strict=True):
            values = loop.rows(motion)
            rows += [*values, *[0.0] * (count - len(values))]
        return rows

    def jacobian(self, mech: Mechanism, q: Array, xp: Any, rows: Sequence[int] | None = None) -> Matrix:
        """J of the kept rows, or of others: its column k is J v with v the k-th unit vector.

        Degrees of freedom of which no row depends on two share one v, their sum: a chain of loops of any length takes
        as many as a short one (Curtis, Powell, Reid: J. Inst. Math. Appl. 13, 1974, 117-119).
        """
        chosen = self.kept if rows is None else rows
        matrix: Matrix = [[0.0] * self.space.nv for _ in chosen]
        units = self._units(q)
        for group in self._column_groups:
            along = [first for first, _ in self._along(mech, q, np.sum([units[k] for k in group], axis=0), xp, 1)]
            for row, i in zip(matrix, chosen, strict=True):
                for k in self.supports[i].intersection(group):
                    row[k] = along[i]
        return matrix

    def jacobian_at(self, q: np.ndarray, rows: Sequence[int]) -> np.ndarray:
        """J of these rows as numbers at one configuration, (len(rows), nv); not finite where they are singular."""
        return np.asarray(self.jacobians_at(q[None], rows)[0])

    @np.errstate(all="ignore")
    def jacobians_at(self, q: np.ndarray, rows: Sequence[int]) -> np.ndarray:
        """J of these rows at configurations (n, nq), (n, len(rows), nv): together they take hardly longer than one."""
        n, nv = len(q), self.space.nv
        along = self._along(self.mech, np.repeat(q.T, nv, axis=1), np.tile(np.eye(nv), n), Numbers, 1)
        every = [np.broadcast_to(np.asarray(along[i][0], dtype=float), (n * nv,)) for i in rows]
        return np.array(every).reshape(len(rows), n, nv).swapaxes(0, 1)

    def velocity_terms(self, mech: Mechanism, q: Array, v: Array, xp: Any) -> list[Scalar]:
        """J' v of the kept rows."""
        rows = self._along(mech, q, v, xp, 2)
        return [rows[i][1] for i in self.kept]

    def velocities(self, mech: Mechanism, q: Array, v: Array, xp: Any) -> list[Scalar]:
        """J v of the kept rows."""
        rows = self._along(mech, q, v, xp, 1)
        return [rows[i][0] for i in self.kept]

    def force_rows(
        self, mech: Mechanism, q: Array, v: Array, xp: Any, jacobian: Matrix, loops: Sequence[Loop]
    ) -> Matrix:
        """B^T: the generalized force of each kept row's multiplier of size 1; rows of J but for sliding friction.

        loops: the loops with the numbers of the piece in them.
        """
        if all(type(loop).forces is Loop.forces for loop in loops):
            return jacobian
        motion = KinematicState(self.model, mech, list(q), list(v), 0.0, xp)
        numbers: Sequence[int] = self.kept
        if self.shares is not None:
            numbers, jacobian = self.all_rows, self.jacobian(mech, q, xp, self.all_rows)
        units, every = self._units(q), [list(row) for row in jacobian]
        for group in self._column_groups:
            along = motion.with_velocity(list(np.sum([units[k] for k in group], axis=0)))
            powers = [power for loop, count in zip(loops, self.counts, strict=True)
                      for power in loop.forces(motion, along) or [None] * count]  # fmt: skip
            for row, i in zip(every, numbers, strict=True):
                for k in self.supports[i].intersection(group) if powers[i] is not None else ():
                    row[k] = powers[i]
        if self.shares is None:
            return every
        return [[plus(*(times(share[k], row[dof]) for share, row in zip(self.shares, every, strict=True)))
                 for dof in range(self.space.nv)] for k in range(len(self.kept))]  # fmt: skip

    def all_multipliers(self, kept: np.ndarray) -> np.ndarray:
        """The multipliers of all rows (rows, n) from those of the kept ones; 0 for redundant rows without shares."""
        every = np.zeros((len(self.all_rows), kept.shape[1]))
        every[list(self.kept)] = kept
        return every if self.shares is None else np.array(self.shares) @ kept

    def accelerations(
        self,
        mech: Mechanism,
        x: Array,
        tau: list[Scalar],
        wrenches: Any,
        xp: Any,
        free: Sequence[Scalar],
        loops: Sequence[Loop],
    ) -> tuple[list[Scalar], list[Scalar]]:
        """(a, lambda) of a state x = (q, v): NaN where the constraints are singular.

        free: 0 for degrees of freedom that are locked, 1 for the others. loops: with the numbers of the piece.
        """
        q, v = x[: self.space.nq], x[self.space.nq :]
        at = poses(mech, list(q), xp)
        h = newton_euler(mech, at, list(v), [0.0] * mech.nv, wrenches)
        factors = ldlt(locked_matrix(composite_bodies(mech, at), free), mech.dof_parents(), xp)
        right = [times(f, minus(t, bias)) for f, t, bias in zip(free, tau, h, strict=True)]
        jacobian = locked_columns(self.jacobian(mech, q, xp), free)
        forces = self.force_rows(mech, q, v, xp, jacobian, loops)
        if forces is not jacobian:
            forces = locked_columns(forces, free)
        solver = RowSolver(jacobian, forces, factors, mech.dof_parents(), self.scales, xp, SINGULAR)
        return solver(right, [negative(b) for b in self.velocity_terms(mech, q, v, xp)])

    def projected(self, mech: Mechanism, x: Array, xp: Any, free: Sequence[Scalar]) -> Array:
        """x = (q, v) with q moved back to g = 0 and v to J v = 0, but for what is locked."""
        nq = self.space.nq
        q, v = x[:nq], x[nq:]
        factors = ldlt(locked_matrix(composite_bodies(mech, poses(mech, list(q), xp)), free), mech.dof_parents(), xp)
        jacobian = locked_columns(self.jacobian(mech, q, xp), free)
        solver = RowSolver(jacobian, jacobian, factors, mech.dof_parents(), self.scales, xp, LANDING * SINGULAR)
        still = [0.0] * self.space.nv
        for _ in range(CORRECTIONS):
            residuals = self.residuals(mech, list(q), xp)
            change, _ = solver(still, [residuals[i] for i in self.kept])
            q = q - self.space.rate(q, _array(change, x))
            q = self.space.normalized(np.concatenate([q, v]), xp)[:nq]
        for _ in range(2):
            change, _ = solver(still, self.velocities(mech, q, v, xp))
            v = v - _array(change, x)
        return np.concatenate([q, v])

    @functools.cached_property
    def _column_groups(self) -> list[list[int]]:
        """Degrees of freedom that some row depends on, in groups of which no row depends on two."""
        groups: list[tuple[list[int], set[int]]] = []
        for k in range(self.space.nv):
            rows = {i for i, support in enumerate(self.supports) if k in support}
            if not rows:
                continue
            group = next((group for group in groups if not rows & group[1]), None)
            if group is None:
                groups.append(([k], rows))
            else:
                group[0].append(k)
                group[1].update(rows)
        return [group for group, _ in groups]

    def _units(self, q: Array) -> list[Array]:
        """The unit vectors of the velocities."""
        # Where the space is curved, q' is made of whole rows of a batch: units take its number of axes.
        shape = (-1, *(1 for _ in q.shape[1:])) if self.space.curved else (-1,)
        return [unit.astype(object).reshape(shape) for unit in np.eye(self.space.nv)]

    def _along(self, mech: Mechanism, q: Array, v: Array, xp: Any, order: int) -> list[tuple[Scalar, Scalar]]:
        """(J v, J' v) of all rows, from the jets of q(t) with v constant; of order 1, J v alone is right."""
        first = self.space.rate(q, v)
        jets = [Jet([q[i], first[i]]) for i in range(self.space.nq)]
        if order == 2:
            inner, rows = np.empty(self.space.nq, dtype=object), np.empty(self.space.nv, dtype=object)
            inner[:] = jets
            for k in range(self.space.nv):  # one entry a degree of freedom, rows of a batch too: jets are entries
                rows[k] = v[k]
            second = self.space.rate(inner, rows)
            jets = [Jet([*jet.c, times(0.5, coefficient(second[i], 1))]) for i, jet in enumerate(jets)]
        motion = KinematicState(self.model, mech, jets, list(v), 0.0, JetNamespace(xp))
        pairs: list[tuple[Scalar, Scalar]] = []
        for loop in self.loops:
            pairs += [(coefficient(row, 1), times(2.0, coefficient(row, 2)) if order == 2 else 0.0)
                      for row in loop.rows(motion)]  # fmt: skip
            pairs += [(coefficient(row, 0), coefficient(row, 1)) for row in loop.velocity_rows(motion)]
        return pairs


def all_constraints(space: StateSpace, loops: Sequence[Loop], mech: Mechanism) -> Constraints:
    """All rows of the loops, redundant ones too."""
    tape = Tape()
    variables = [tape.variable() for _ in range(space.nq + space.nv)]
    motion = KinematicState(space.robot.model, mech, variables[: space.nq], variables[space.nq :], 0.0, tape)
    rows = [[*loop.rows(motion), *loop.velocity_rows(motion)] for loop in loops]
    owners = [range(j.v.start, j.v.stop) for j in space.robot.joints for _ in range(j.q.start, j.q.stop)]
    dofs = dict(enumerate([*owners, *([k] for k in range(space.nv))]))  # of each entry of (q, v)
    forces = [with_pieces(loop, lambda _: 0.0).forces(motion, motion) or [0.0] * len(own)
              for loop, own in zip(loops, rows, strict=True)]  # fmt: skip
    each = zip(itertools.chain(*rows), itertools.chain(*forces), strict=True)
    supports = tuple(frozenset(k for x in pair for i in tape.inputs(x) for k in dofs.get(i, ())) for pair in each)
    return Constraints(space, mech, tuple(loops), tuple(map(len, rows)), tuple(range(len(supports))),
                       (1.0,) * len(supports), supports)  # fmt: skip


def locked_matrix(mass: Matrix, free: Sequence[Scalar]) -> Matrix:
    """M without the rows and columns of locked degrees of freedom, but for the diagonal: there a = 0 follows."""
    return [
        [entry if i == j else times(times(free[i], free[j]), entry) for j, entry in enumerate(row)]
        for i, row in enumerate(mass)
    ]


def locked_columns(rows: Matrix, free: Sequence[Scalar]) -> Matrix:
    """Rows over degrees of freedom without the columns of locked ones."""
    return [[times(f, entry) for f, entry in zip(free, row, strict=True)] for row in rows]


def _array(values: list[Scalar], like: Array) -> Array:
    """Scalars as an array of the kind of another."""
    out = np.empty((len(values), *like.shape[1:]), dtype=like.dtype)
    for k, value in enumerate(values):
        out[k] = value
    return out
