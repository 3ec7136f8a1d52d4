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

from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from twolink.dynamics.branch_sparse import ldlt, ldlt_apply
from twolink.dynamics.jets import Jet, JetNamespace, coefficient
from twolink.dynamics.mechanism import Mechanism
from twolink.dynamics.recursions import composite_bodies, newton_euler, poses
from twolink.dynamics.spatial import Matrix, Scalar, minus, negative, plus, times
from twolink.effects.loop import Loop
from twolink.effects.motion import Motion
from twolink.errors import SceneError
from twolink.integrate.namespaces import Numbers
from twolink.integrate.state import Array, StateSpace

SINGULAR = 1e-6  # a pivot of A over its diagonal: nearer to 0 its rounding, 1e-16 / 1e-6, would be seen
LANDING = 1e3  # times farther from it a step may end: the projection multiplies errors by 1 / sqrt(pivot)
CORRECTIONS = 3  # of q after a step, with the matrices of the first: each takes the error to about its square
RANK = 1e-9  # singular values below it, relative, are rows that say nothing new
ASSEMBLED = 1e-12
TRIALS = 50
SPREADS = (1e-3, 1e-2, 0.3, 0.3)
WALK, STRIDE = 8, 0.35  # positions on each side, rad or m apart


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
        """g(q) of all rows."""
        motion = Motion(self.model, mech, q, [0.0] * self.space.nv, 0.0, xp)
        return [row for loop in self.loops for row in loop.rows(motion)]

    def kept_rows(self, mech: Mechanism, q: Sequence[Any], xp: Any) -> list[Scalar]:
        """g(q) of the rows that are kept."""
        rows = self.rows(mech, q, xp)
        return [rows[i] for i in self.kept]

    def jacobian(self, mech: Mechanism, q: Array, xp: Any, kept: Sequence[int] | None = None) -> Matrix:
        """J: its column k is g' with v the k-th unit vector."""
        columns = []
        for k in range(self.space.nv):
            unit = np.array([1.0 if i == k else 0.0 for i in range(self.space.nv)], dtype=object)
            if self.space.curved:  # q' is made of whole rows there, of a batch too
                unit = unit.reshape(-1, *(1 for _ in q.shape[1:]))
            columns.append([coefficient(row, 1) for row in self._along(mech, q, unit, xp, 1)])
        chosen = self.kept if kept is None else kept
        return [[column[i] for column in columns] for i in chosen]

    def velocity_terms(self, mech: Mechanism, q: Array, v: Array, xp: Any) -> tuple[list[Scalar], list[Scalar]]:
        """(J v, J' v) of the rows that are kept."""
        rows = self._along(mech, q, v, xp, 2)
        return ([coefficient(rows[i], 1) for i in self.kept], [times(2.0, coefficient(rows[i], 2)) for i in self.kept])

    def _along(self, mech: Mechanism, q: Array, v: Array, xp: Any, order: int) -> list[Any]:
        """g of the jets of q(t) with v constant."""
        first = self.space.rate(q, v)
        jets = [Jet([q[i], first[i]]) for i in range(self.space.nq)]
        if order == 2:
            inner, rows = np.empty(self.space.nq, dtype=object), np.empty(self.space.nv, dtype=object)
            inner[:] = jets
            for k in range(self.space.nv):  # one entry a degree of freedom, rows of a batch too: jets are entries
                rows[k] = v[k]
            second = self.space.rate(inner, rows)
            jets = [Jet([*jet.c, times(0.5, coefficient(second[i], 1))]) for i, jet in enumerate(jets)]
        return self.rows(mech, jets, JetNamespace(xp))

    def accelerations(
        self, mech: Mechanism, q: Array, v: Array, tau: list[Scalar], wrenches: Any, xp: Any
    ) -> tuple[list[Scalar], list[Scalar]]:
        """(a, lambda): NaN where the constraints are singular."""
        at = poses(mech, list(q), xp)
        h = newton_euler(mech, at, list(v), [0.0] * mech.nv, wrenches)
        lower, inverse = ldlt(composite_bodies(mech, at), mech.dof_parents(), xp)
        free = ldlt_apply(lower, inverse, mech.dof_parents(), [minus(t, x) for t, x in zip(tau, h, strict=True)])
        back = _Back(self.jacobian(mech, q, xp), lower, inverse, mech.dof_parents(), self.scales, xp)
        second = self.velocity_terms(mech, q, v, xp)[1]
        change, multipliers = back([plus(x, y) for x, y in zip(back.times_jacobian(free), second, strict=True)])
        return [minus(x, y) for x, y in zip(free, change, strict=True)], [negative(m) for m in multipliers]

    def projected(self, mech: Mechanism, x: Array, xp: Any) -> Array:
        """x with q moved back to g = 0 and v to J v = 0."""
        nq = self.space.nq
        q, v = x[:nq], x[nq:]
        lower, inverse = ldlt(composite_bodies(mech, poses(mech, list(q), xp)), mech.dof_parents(), xp)
        scales = [LANDING * scale for scale in self.scales]
        back = _Back(self.jacobian(mech, q, xp), lower, inverse, mech.dof_parents(), scales, xp)
        for _ in range(CORRECTIONS):
            change, _ = back(self.kept_rows(mech, list(q), xp))
            q = q - self.space.rate(q, _array(change, x))
            q = self.space.normalized(np.concatenate([q, v]), xp)[:nq]
        for _ in range(2):
            change, _ = back(self.velocity_terms(mech, q, v, xp)[0])
            v = v - _array(change, x)
        return np.concatenate([q, v])

    def assembled(self, x: Array, *, keep: bool = True) -> Array:
        """The nearest state (size,) that fulfils the constraints. keep: choose the independent rows there.

        Raises SceneError with the residual where there is none near.
        """
        q, v = x[: self.space.nq].copy(), x[self.space.nq :].copy()
        every = range(len(self.rows(self.mech, list(q), Numbers)))
        residual = np.inf
        for _ in range(TRIALS):
            g = np.array([float(row) for row in self.rows(self.mech, list(q), Numbers)])
            residual = float(np.abs(g).max(initial=0.0))
            if residual <= ASSEMBLED:
                break
            jacobian = self._numbers(q, every)
            change = np.linalg.lstsq(jacobian, g, rcond=RANK)[0]
            change *= min(1.0, 0.5 / max(1e-300, float(np.abs(change).max())))
            q = pin.integrate(self.model, q, -change)
        if not residual <= 100 * ASSEMBLED:
            raise SceneError(f"the loops cannot be closed: {residual:.2e} m or rad is left", where="effects",
                             remedy="check their points and axes, or start nearer to a closed position")  # fmt: skip
        jacobian = self._numbers(q, every)
        v = v - np.linalg.lstsq(jacobian, jacobian @ v, rcond=RANK)[0]
        if keep:
            self.kept = self._independent(q, every)
        return np.concatenate([q, v])

    def _numbers(self, q: np.ndarray, rows: Sequence[int]) -> np.ndarray:
        found = self.jacobian(self.mech, q, Numbers, rows)
        return np.array([[float(entry) for entry in row] for row in found]).reshape(len(rows), self.space.nv)

    def _independent(self, q: np.ndarray, every: Sequence[int]) -> list[int]:
        """Rows that say all there is to say, here and along the motion: by pivoting, then by exchanging."""
        from scipy.linalg import qr

        random = np.random.default_rng(3)
        near = [q, *(pin.integrate(self.model, q, s * random.standard_normal(self.space.nv)) for s in SPREADS)]
        found = [self._numbers(self._closed(x, every), every) for x in near]
        places = [self._closed(x, every) for x in near]
        largest = np.max([np.abs(j).max(axis=1, initial=0.0) for j in found], axis=0)
        rank = max((_rank(j) for j in found), default=0)
        if rank < (largest > RANK).sum():  # a choice: it must do along the whole motion
            places += self._along_motion(q, every, random)
            found = [self._numbers(x, every) for x in places]
            rank = max(_rank(j) for j in found)
        if not rank:
            return []
        full = [j for j in found if _rank(j) == rank]
        chosen = sorted(int(i) for i in qr(full[0].T, pivoting=True, mode="economic")[2][:rank])

        def worst(rows: list[int]) -> float:
            return float(min(np.linalg.svd(j[rows], compute_uv=False)[-1] for j in full))

        others = [i for i in every if largest[i] > RANK]
        best, improved = worst(chosen), len(others) > rank
        while improved:
            trials = [sorted({*chosen} - {i} | {j}) for i in chosen for j in others if j not in chosen]
            tried = max(trials, key=worst)
            improved = worst(tried) > 1.01 * best
            chosen, best = (tried, worst(tried)) if improved else (chosen, best)
        scales = np.max([np.einsum("ij,ji->i", j, np.linalg.solve(self._mass(x), j.T))
                         for x, j in zip(places, found, strict=True)], axis=0)  # fmt: skip
        self.scales = scales[chosen].tolist()
        return chosen

    def _along_motion(self, q: np.ndarray, every: Sequence[int], random: np.random.Generator) -> list[np.ndarray]:
        """Closed positions on both sides of q, as the mechanism can move."""
        places = []
        start = random.standard_normal(self.space.nv)
        for sign in (1.0, -1.0):
            x, way = q, sign * start
            for _ in range(WALK):
                _, s, rows = np.linalg.svd(self._numbers(x, every))
                free = rows[int((s > RANK**0.5 * max(1e-300, s[0])).sum()) :] if s.size else rows
                if not len(free):
                    break
                way = free.T @ (free @ way)
                way *= STRIDE / max(1e-300, float(np.abs(way).max()))
                x = self._closed(pin.integrate(self.model, x, way), every)
                places.append(x)
        return places

    def _mass(self, q: np.ndarray) -> np.ndarray:
        """M(q) of one configuration, by Pinocchio."""
        mass = pin.crba(self.model, self.model.createData(), q)
        return np.asarray(np.triu(mass) + np.triu(mass, 1).T)

    def _closed(self, q: np.ndarray, every: Sequence[int]) -> np.ndarray:
        """The closed position near q."""
        for _ in range(TRIALS):
            g = np.array([float(row) for row in self.rows(self.mech, list(q), Numbers)])
            if np.abs(g).max(initial=0.0) < ASSEMBLED:
                break
            q = pin.integrate(self.model, q, -np.linalg.lstsq(self._numbers(q, every), g, rcond=RANK)[0])
        return q

    def reference_acceleration(self, q: np.ndarray, v: np.ndarray, tau: np.ndarray, bias: np.ndarray) -> np.ndarray:
        """a of one state by Pinocchio's mass matrix and least squares of the rows that are kept.

        Of those alone: beside g = 0, where a step's stages are, a redundant row contradicts the others.
        """
        jacobian = self._numbers(q, self.kept)
        second = np.array([float(row) for row in self.velocity_terms(self.mech, q, v, Numbers)[1]])
        mass = self._mass(q)
        root = np.linalg.cholesky(mass)
        free = np.linalg.solve(mass, tau - bias)
        scaled = np.linalg.solve(root, jacobian.T).T  # J L^-T
        correction = np.linalg.lstsq(scaled, -second - jacobian @ free, rcond=1e-10)[0]
        return np.asarray(free + np.linalg.solve(root.T, correction))


class _Back:
    """r -> (X A^-1 r, A^-1 r): the change of velocities that takes J v from r to 0."""

    def __init__(
        self,
        jacobian: Matrix,
        lower: Matrix,
        inverse: list[Scalar],
        parents: list[int],
        scales: Sequence[float],
        xp: Any,
    ) -> None:
        self.jacobian = jacobian
        self.columns = [ldlt_apply(lower, inverse, parents, row) for row in jacobian]  # of X
        matrix = [[_dot(row, column) for column in self.columns] for row in jacobian]
        self._parents = [k - 1 for k in range(len(matrix))]
        self._lower, self._inverse = ldlt(matrix, self._parents, _Guarded(xp, scales))

    def times_jacobian(self, a: Sequence[Scalar]) -> list[Scalar]:
        """J a."""
        return [_dot(row, a) for row in self.jacobian]

    def __call__(self, right: Sequence[Scalar]) -> tuple[list[Scalar], list[Scalar]]:
        multipliers = ldlt_apply(self._lower, self._inverse, self._parents, list(right))
        count = len(self.columns[0]) if self.columns else 0
        change = [plus(*(times(c[k], m) for c, m in zip(self.columns, multipliers, strict=True))) for k in range(count)]
        return change, multipliers


class _Guarded:
    """Reciprocals of pivots, the last one first: NaN for one that is small beside its scale."""

    def __init__(self, xp: Any, scales: Sequence[float]) -> None:
        self._xp, self._scales = xp, list(scales)

    def reciprocal(self, pivot: Scalar) -> Scalar:
        """1 / pivot."""
        good = self._xp.less(SINGULAR * self._scales.pop(), pivot)
        return self._xp.where(good, 1.0 / pivot, np.nan)


def _dot(row: Sequence[Scalar], column: Sequence[Scalar]) -> Scalar:
    return plus(*(times(a, b) for a, b in zip(row, column, strict=True)))


def _array(values: list[Scalar], like: Array) -> Array:
    """Scalars as an array of the kind of another."""
    out = np.empty((len(values), *like.shape[1:]), dtype=like.dtype)
    for k, value in enumerate(values):
        out[k] = value
    return out


def _rank(jacobian: np.ndarray) -> int:
    sizes = np.linalg.svd(jacobian, compute_uv=False)
    return int((sizes > RANK**0.5 * max(1e-300, sizes[0])).sum()) if sizes.size else 0
