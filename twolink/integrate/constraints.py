"""Loops in the equations of motion: g(q) = 0 kept by forces, and by projection after every step.

    M a + h = tau + J^T lambda,   J a = -J' v       (J v = g', the derivative of the constraints)

With M = L^T D L, X = M^-1 J^T and A = J X: A lambda = -J' v - J a_free, a = a_free + X lambda. After a step, q goes
back to g = 0 and v to J v = 0 along X, the way that changes the motion least in terms of its kinetic energy. J and
J' v are not derived by hand: g runs on jets of q(t).

Where a mechanism passes a singular position, A is singular for an instant, while the motion goes on smoothly. Nothing
is divided near that instant: an evaluation there is NaN, which makes the step try another size, until none of its
stages falls there (test case: IFToMM benchmark A02). Projection: Eich 1993, SIAM J. Numer. Anal. 30, 1467-1482.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Sequence
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

SINGULAR = 1e-6  # a pivot of A over its diagonal: nearer to 0 its rounding, 1e-16 / 1e-6, would be seen
LANDING = 1e3  # times farther from it a step may end: the projection multiplies errors by 1 / sqrt(pivot)
CORRECTIONS = 3  # of q after a step, with the matrices of the first: each takes the error to about its square


class Loops:
    """The constraints of a scene's loops on a robot, without their redundant rows.

    kept: the numbers of the rows that are left. scales: the size of A's diagonal, away from singular positions.
    """

    def __init__(self, space: StateSpace, loops: Sequence[Loop], mech: Mechanism) -> None:
        self.space, self.loops, self.mech = space, tuple(loops), mech
        self.model: pin.Model = space.robot.model
        self.kept: list[int] = []
        self.scales: list[float] = []

    def rows(self, mech: Mechanism, q: Sequence[Any], xp: Any) -> list[Scalar]:
        """g(q) of all rows; 0 for those of velocities."""
        motion = Motion(self.model, mech, q, [0.0] * self.space.nv, 0.0, xp)
        found: list[Scalar] = []
        for loop in self.loops:
            found += [*loop.rows(motion), *(0.0 for _ in loop.velocity_rows(motion))]
        return found

    def kept_rows(self, mech: Mechanism, q: Sequence[Any], xp: Any) -> list[Scalar]:
        """g(q) of the rows that are kept."""
        rows = self.rows(mech, q, xp)
        return [rows[i] for i in self.kept]

    def jacobian(self, mech: Mechanism, q: Array, xp: Any, kept: Sequence[int] | None = None) -> Matrix:
        """J: its column k is J v with v the k-th unit vector."""
        columns = []
        for unit in self._units(q):
            columns.append([first for first, _ in self._along(mech, q, unit, xp, 1)])
        chosen = self.kept if kept is None else kept
        return [[column[i] for column in columns] for i in chosen]

    def _units(self, q: Array) -> Iterator[Array]:
        """The unit vectors of the velocities."""
        for k in range(self.space.nv):
            unit = np.array([1.0 if i == k else 0.0 for i in range(self.space.nv)], dtype=object)
            # q' is made of whole rows where the space is curved, of a batch too
            yield unit.reshape(-1, *(1 for _ in q.shape[1:])) if self.space.curved else unit

    def velocity_terms(self, mech: Mechanism, q: Array, v: Array, xp: Any) -> tuple[list[Scalar], list[Scalar]]:
        """(J v, J' v) of the rows that are kept."""
        rows = self._along(mech, q, v, xp, 2)
        return [rows[i][0] for i in self.kept], [rows[i][1] for i in self.kept]

    def velocities(self, mech: Mechanism, q: Array, v: Array, xp: Any) -> list[Scalar]:
        """J v of the rows that are kept."""
        rows = self._along(mech, q, v, xp, 1)
        return [rows[i][0] for i in self.kept]

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
        found: list[tuple[Scalar, Scalar]] = []
        for loop in self.loops:
            found += [(coefficient(row, 1), times(2.0, coefficient(row, 2)) if order == 2 else 0.0)
                      for row in loop.rows(motion)]  # fmt: skip
            found += [(coefficient(row, 0), coefficient(row, 1)) for row in loop.velocity_rows(motion)]
        return found

    def pushes(self, mech: Mechanism, q: Array, v: Array, xp: Any, jacobian: Matrix, loops: Sequence[Loop]) -> Matrix:
        """B^T: what each kept row's force does to each degree of freedom; the Jacobian's own rows but for friction.

        loops: this one's, with the numbers of the moment in them.
        """
        motion = Motion(self.model, mech, list(q), list(v), 0.0, xp)
        columns: list[list[Scalar | None]] = []
        for unit in self._units(q) if any(type(loop).pushes is not Loop.pushes for loop in loops) else ():
            along = Motion(self.model, mech, list(q), list(unit), 0.0, xp)
            column: list[Scalar | None] = []
            for loop, count in zip(loops, self._counts, strict=True):
                column += loop.pushes(motion, along) or [None] * count
            columns.append(column)
        if not columns:
            return jacobian
        out = [list(row) for row in jacobian]
        for at, i in enumerate(self.kept):
            for k, column in enumerate(columns):
                if column[i] is not None:
                    out[at][k] = column[i]
        return out

    def by_loop(self, multipliers: Sequence[Any]) -> list[list[Any]]:
        """The multipliers of the kept rows, loop by loop; None for rows that were dropped."""
        values = dict(zip(self.kept, multipliers, strict=True))
        found, at = [], 0
        for count in self._counts:
            found.append([values.get(i) for i in range(at, at + count)])
            at += count
        return found

    def owners(self) -> list[Loop]:
        """The loop that each kept row belongs to."""
        every = [loop for loop, count in zip(self.loops, self._counts, strict=True) for _ in range(count)]
        return [every[i] for i in self.kept]

    @functools.cached_property
    def _counts(self) -> list[int]:
        """How many rows each loop has."""
        motion = Motion(self.model, self.mech, list(pin.neutral(self.model)), [0.0] * self.space.nv, 0.0, Numbers)
        return [len(loop.rows(motion)) + len(loop.velocity_rows(motion)) for loop in self.loops]

    def accelerations(
        self,
        mech: Mechanism,
        q: Array,
        v: Array,
        tau: list[Scalar],
        wrenches: Any,
        xp: Any,
        free: Sequence[Scalar],
        loops: Sequence[Loop],
    ) -> tuple[list[Scalar], list[Scalar]]:
        """(a, lambda): NaN where the constraints are singular.

        free: 0 for degrees of freedom that are locked, 1 for the others. loops: with the numbers of the moment.
        """
        at = poses(mech, list(q), xp)
        h = newton_euler(mech, at, list(v), [0.0] * mech.nv, wrenches)
        mass = locked_matrix(composite_bodies(mech, at), free)
        lower, inverse = ldlt(mass, mech.dof_parents(), xp)
        right = [times(f, minus(t, x)) for f, t, x in zip(free, tau, h, strict=True)]
        unbound = ldlt_apply(lower, inverse, mech.dof_parents(), right)
        jacobian = locked_columns(self.jacobian(mech, q, xp), free)
        pushes = self.pushes(mech, q, v, xp, jacobian, loops)
        if pushes is not jacobian:
            pushes = locked_columns(pushes, free)
        back = _Back(jacobian, pushes, lower, inverse, mech.dof_parents(), self.scales, xp)
        second = self.velocity_terms(mech, q, v, xp)[1]
        change, multipliers = back([plus(x, y) for x, y in zip(back.times_jacobian(unbound), second, strict=True)])
        return [minus(x, y) for x, y in zip(unbound, change, strict=True)], [negative(m) for m in multipliers]

    def projected(self, mech: Mechanism, x: Array, xp: Any, free: Sequence[Scalar]) -> Array:
        """x with q moved back to g = 0 and v to J v = 0, but for what is locked."""
        nq = self.space.nq
        q, v = x[:nq], x[nq:]
        mass = locked_matrix(composite_bodies(mech, poses(mech, list(q), xp)), free)
        lower, inverse = ldlt(mass, mech.dof_parents(), xp)
        scales = [LANDING * scale for scale in self.scales]
        jacobian = locked_columns(self.jacobian(mech, q, xp), free)
        back = _Back(jacobian, jacobian, lower, inverse, mech.dof_parents(), scales, xp)
        for _ in range(CORRECTIONS):
            change, _ = back(self.kept_rows(mech, list(q), xp))
            q = q - self.space.rate(q, _array(change, x))
            q = self.space.normalized(np.concatenate([q, v]), xp)[:nq]
        for _ in range(2):
            change, _ = back(self.velocities(mech, q, v, xp))
            v = v - _array(change, x)
        return np.concatenate([q, v])

    def numbers(self, q: np.ndarray, rows: Sequence[int]) -> np.ndarray:
        """J of these rows at one configuration, (len(rows), nv)."""
        found = self.jacobian(self.mech, q, Numbers, rows)
        return np.array([[float(entry) for entry in row] for row in found]).reshape(len(rows), self.space.nv)


def locked_matrix(mass: Matrix, free: Sequence[Scalar]) -> Matrix:
    """M without the rows and columns of what is locked, but for the diagonal: there a = 0 follows."""
    return [
        [entry if i == j else times(times(free[i], free[j]), entry) for j, entry in enumerate(row)]
        for i, row in enumerate(mass)
    ]


def locked_columns(rows: Matrix, free: Sequence[Scalar]) -> Matrix:
    """Rows over degrees of freedom without the columns of what is locked."""
    return [[times(f, entry) for f, entry in zip(free, row, strict=True)] for row in rows]


class _Back:
    """r -> (X A^-1 r, A^-1 r): the change of velocities, X = M^-1 B, that takes J v from r to 0."""

    def __init__(
        self,
        jacobian: Matrix,
        pushes: Matrix,
        lower: Matrix,
        inverse: list[Scalar],
        parents: list[int],
        scales: Sequence[float],
        xp: Any,
    ) -> None:
        self.jacobian = jacobian
        self.columns = [ldlt_apply(lower, inverse, parents, row) for row in pushes]  # of X
        matrix = [[_dot(row, column) for column in self.columns] for row in jacobian]
        self._parents = [k - 1 for k in range(len(matrix))]
        self._symmetric = pushes is jacobian
        if self._symmetric:  # from the last pivot to the first
            self._factors = ldlt(matrix, self._parents, _Guarded(xp, scales[::-1]))
        else:
            self._factors = factored(matrix, _Guarded(xp, scales))

    def times_jacobian(self, a: Sequence[Scalar]) -> list[Scalar]:
        """J a."""
        return [_dot(row, a) for row in self.jacobian]

    def __call__(self, right: Sequence[Scalar]) -> tuple[list[Scalar], list[Scalar]]:
        if self._symmetric:
            multipliers = ldlt_apply(*self._factors, self._parents, list(right))
        else:
            multipliers = solved(*self._factors, list(right))
        count = len(self.columns[0]) if self.columns else 0
        change = [plus(*(times(c[k], m) for c, m in zip(self.columns, multipliers, strict=True))) for k in range(count)]
        return change, multipliers


class _Guarded:
    """Reciprocals of pivots, in the order of their scales: NaN for one that is small beside its own."""

    def __init__(self, xp: Any, scales: Sequence[float]) -> None:
        self._xp, self._scales = xp, iter(scales)

    def reciprocal(self, pivot: Scalar) -> Scalar:
        """1 / pivot."""
        good = self._xp.less(SINGULAR * next(self._scales), pivot)
        return self._xp.where(good, 1.0 / pivot, np.nan)


def _dot(row: Sequence[Scalar], column: Sequence[Scalar]) -> Scalar:
    return plus(*(times(a, b) for a, b in zip(row, column, strict=True)))


def _array(values: list[Scalar], like: Array) -> Array:
    """Scalars as an array of the kind of another."""
    out = np.empty((len(values), *like.shape[1:]), dtype=like.dtype)
    for k, value in enumerate(values):
        out[k] = value
    return out
