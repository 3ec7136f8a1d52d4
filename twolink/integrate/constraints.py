"""Constraints: rows g(q) = 0 or b(q) v = 0 kept by forces, and by projection after every step.

    M a + h = tau + B lambda,   J a = -J' v       (J v = g', the derivative of the rows; B = J^T but for friction)

With M = L^T D L, X = M^-1 B and A = J X: A lambda = -J' v - J a_free, a = a_free + X lambda. After a step, q goes
back to g = 0 and v to J v = 0 along X, the direction that changes the motion least in terms of its kinetic energy. J
and J' v are not derived by hand: g is evaluated on jets of q(t).

Where a mechanism passes a singular position, A is singular for an instant, while the motion goes on smoothly. Nothing
is divided near that instant: an evaluation there is NaN, which makes the step try another size, until none of its
stages falls there (test case: IFToMM benchmark A02). Projection: Eich 1993, SIAM J. Numer. Anal. 30, 1467-1482.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from twolink.algorithms.dense_factors import factored, solved
from twolink.algorithms.jets import Jet, JetNamespace, coefficient
from twolink.algorithms.mechanism import Mechanism
from twolink.algorithms.namespaces import Numbers
from twolink.algorithms.recursions import composite_bodies, newton_euler, poses
from twolink.algorithms.sparse_factors import ldlt, ldlt_apply
from twolink.algorithms.spatial import Matrix, Scalar, minus, negative, plus, times
from twolink.effects.loop import Loop
from twolink.effects.motion import Motion
from twolink.integrate.state import Array, StateSpace

SINGULAR = 1e-6  # a pivot of the scaled A: nearer to 0 its rounding, 1e-16 / 1e-6, would be seen
LANDING = 1e3  # times farther from it a step may end: the projection multiplies errors by 1 / sqrt(pivot)
CORRECTIONS = 3  # of q after a step, with the matrices of the first: each takes the error to about its square


@dataclass(frozen=True, eq=False)
class Constraints:
    """The rows of a scene's loops and contacts on a robot.

    counts: how many rows each loop has. kept: the rows that are not redundant. scales: a factor for each kept row that
    makes the diagonal of A about 1 away from singular positions.
    """

    space: StateSpace
    mech: Mechanism
    loops: tuple[Loop, ...]
    counts: tuple[int, ...]
    kept: tuple[int, ...]
    scales: tuple[float, ...]

    @property
    def model(self) -> pin.Model:
        """The robot's model."""
        return self.space.robot.model

    @property
    def all_rows(self) -> range:
        """The numbers of all rows, redundant ones too."""
        return range(sum(self.counts))

    def residuals(self, mech: Mechanism, q: Sequence[Any], xp: Any) -> list[Scalar]:
        """g(q) of all rows; 0 for those of velocities."""
        motion = Motion(self.model, mech, q, [0.0] * self.space.nv, 0.0, xp)
        rows: list[Scalar] = []
        for loop, count in zip(self.loops, self.counts, strict=True):
            values = loop.rows(motion)
            rows += [*values, *[0.0] * (count - len(values))]
        return rows

    def jacobian(self, mech: Mechanism, q: Array, xp: Any, rows: Sequence[int] | None = None) -> Matrix:
        """J of the kept rows, or of others: its column k is J v with v the k-th unit vector."""
        columns = [[first for first, _ in self._along(mech, q, unit, xp, 1)] for unit in self._units(q)]
        return [[column[i] for column in columns] for i in (self.kept if rows is None else rows)]

    def jacobian_at(self, q: np.ndarray, rows: Sequence[int]) -> np.ndarray:
        """J of these rows as numbers at one configuration, (len(rows), nv)."""
        entries = self.jacobian(self.mech, q, Numbers, rows)
        return np.array([[float(entry) for entry in row] for row in entries]).reshape(len(rows), self.space.nv)

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
        motion = Motion(self.model, mech, list(q), list(v), 0.0, xp)
        columns: list[list[Scalar | None]] = []
        for unit in self._units(q):
            along = Motion(self.model, mech, list(q), list(unit), 0.0, xp)
            columns.append([power for loop, count in zip(loops, self.counts, strict=True)
                            for power in loop.forces(motion, along) or [None] * count])  # fmt: skip
        return [[own if column[i] is None else column[i] for own, column in zip(row, columns, strict=True)]
                for i, row in zip(self.kept, jacobian, strict=True)]  # fmt: skip

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
        a_free = ldlt_apply(*factors, mech.dof_parents(), right)
        jacobian = locked_columns(self.jacobian(mech, q, xp), free)
        forces = self.force_rows(mech, q, v, xp, jacobian, loops)
        if forces is not jacobian:
            forces = locked_columns(forces, free)
        solver = _RowSolver(jacobian, forces, factors, mech.dof_parents(), self.scales, xp, SINGULAR)
        second = self.velocity_terms(mech, q, v, xp)
        change, multipliers = solver([plus(_dot(row, a_free), b) for row, b in zip(jacobian, second, strict=True)])
        return [minus(a, c) for a, c in zip(a_free, change, strict=True)], [negative(m) for m in multipliers]

    def projected(self, mech: Mechanism, x: Array, xp: Any, free: Sequence[Scalar]) -> Array:
        """x = (q, v) with q moved back to g = 0 and v to J v = 0, but for what is locked."""
        nq = self.space.nq
        q, v = x[:nq], x[nq:]
        factors = ldlt(locked_matrix(composite_bodies(mech, poses(mech, list(q), xp)), free), mech.dof_parents(), xp)
        jacobian = locked_columns(self.jacobian(mech, q, xp), free)
        solver = _RowSolver(jacobian, jacobian, factors, mech.dof_parents(), self.scales, xp, LANDING * SINGULAR)
        for _ in range(CORRECTIONS):
            residuals = self.residuals(mech, list(q), xp)
            change, _ = solver([residuals[i] for i in self.kept])
            q = q - self.space.rate(q, _array(change, x))
            q = self.space.normalized(np.concatenate([q, v]), xp)[:nq]
        for _ in range(2):
            change, _ = solver(self.velocities(mech, q, v, xp))
            v = v - _array(change, x)
        return np.concatenate([q, v])

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
        motion = Motion(self.model, mech, jets, list(v), 0.0, JetNamespace(xp))
        pairs: list[tuple[Scalar, Scalar]] = []
        for loop in self.loops:
            pairs += [(coefficient(row, 1), times(2.0, coefficient(row, 2)) if order == 2 else 0.0)
                      for row in loop.rows(motion)]  # fmt: skip
            pairs += [(coefficient(row, 0), coefficient(row, 1)) for row in loop.velocity_rows(motion)]
        return pairs


def all_constraints(space: StateSpace, loops: Sequence[Loop], mech: Mechanism) -> Constraints:
    """All rows of the loops, redundant ones too."""
    model = space.robot.model
    motion = Motion(model, mech, list(pin.neutral(model)), [0.0] * space.nv, 0.0, Numbers)
    counts = tuple(len(loop.rows(motion)) + len(loop.velocity_rows(motion)) for loop in loops)
    return Constraints(space, mech, tuple(loops), counts, tuple(range(sum(counts))), (1.0,) * sum(counts))


def locked_matrix(mass: Matrix, free: Sequence[Scalar]) -> Matrix:
    """M without the rows and columns of locked degrees of freedom, but for the diagonal: there a = 0 follows."""
    return [
        [entry if i == j else times(times(free[i], free[j]), entry) for j, entry in enumerate(row)]
        for i, row in enumerate(mass)
    ]


def locked_columns(rows: Matrix, free: Sequence[Scalar]) -> Matrix:
    """Rows over degrees of freedom without the columns of locked ones."""
    return [[times(f, entry) for f, entry in zip(free, row, strict=True)] for row in rows]


class _RowSolver:
    """r -> (X A^-1 r, A^-1 r): the change of velocities along X = M^-1 B that takes J v from r to 0.

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
        rows = _scaled(jacobian, scales)
        symmetric = forces is jacobian
        self.scales = scales
        self.columns = [ldlt_apply(*factors, parents, row) for row in (rows if symmetric else _scaled(forces, scales))]
        matrix = [[_dot(row, column) for column in self.columns] for row in rows]
        self._chain = list(range(-1, len(matrix) - 1))  # every row depends on those before: a dense A = L^T D L
        pivots = _Pivots(xp, singular)
        self._symmetric = symmetric
        self._factors = ldlt(matrix, self._chain, pivots) if symmetric else factored(matrix, pivots)

    def __call__(self, right: Sequence[Scalar]) -> tuple[list[Scalar], list[Scalar]]:
        scaled = [times(s, r) for s, r in zip(self.scales, right, strict=True)]
        multipliers = (ldlt_apply(*self._factors, self._chain, scaled) if self._symmetric
                       else solved(*self._factors, scaled))  # fmt: skip
        count = len(self.columns[0]) if self.columns else 0
        change = [plus(*(times(c[k], m) for c, m in zip(self.columns, multipliers, strict=True))) for k in range(count)]
        return change, [times(s, m) for s, m in zip(self.scales, multipliers, strict=True)]


class _Pivots:
    """Reciprocals of pivots: NaN for one that is nearly 0."""

    def __init__(self, xp: Any, singular: float) -> None:
        self._xp, self._singular = xp, singular

    def reciprocal(self, pivot: Scalar) -> Scalar:
        """1 / pivot."""
        return self._xp.where(self._xp.less(self._singular, pivot), 1.0 / pivot, np.nan)


def _scaled(rows: Matrix, scales: Sequence[float]) -> Matrix:
    return [[times(scale, entry) for entry in row] for scale, row in zip(scales, rows, strict=True)]


def _dot(row: Sequence[Scalar], column: Sequence[Scalar]) -> Scalar:
    return plus(*(times(a, b) for a, b in zip(row, column, strict=True)))


def _array(values: list[Scalar], like: Array) -> Array:
    """Scalars as an array of the kind of another."""
    out = np.empty((len(values), *like.shape[1:]), dtype=like.dtype)
    for k, value in enumerate(values):
        out[k] = value
    return out
