"""The contact problem of a step: impulses P of all contacts that obey the laws of contact and friction at once.

    U = G P + b
    normal    0 <= P_n,   0 <= U_n + c,   P_n (U_n + c) = 0
    tangent   |P_t| <= mu P_n,   U_t = 0 or P_t = -mu P_n U_t / |U_t|

G = J M^-1 J^T; b: the velocities without impulses; c: what the gap still leaves open. P and U have the normal last.

The laws are the zeros of F(P) = P - proj(P - U / g), proj that of `friction_cone`, g the size of G at a contact.
Newton's method on F (Alart, Curnier, Comput. Methods Appl. Mech. Engrg. 92 (1991) 353-375) takes steps with G + e g, e
in proportion to what F misses: a proximal term, which keeps the steps small where contacts leave their forces
undetermined, and which ends with F, so that the solution obeys the laws as exactly as without. Where Newton's method
goes in circles, as in piles that come to rest, the proximal point method leads on from the best it found: the laws with
U + e g (P - P_k) in place of U have one solution near P_k; what Newton's method finds that misses them by a third of
what P_k misses is the next P_k, and e falls as much (Rockafellar, SIAM J. Control Optim. 14 (1976) 877-898, also for
points that are not exact). Each island of bodies is solved alone. Each method begins after steps of P - F / 3 with
Nesterov's momentum (O'Donoghue, Candes, Found. Comput. Math. 15 (2015) 715-732, for the restarts; Mazhar, Heyn, Negrut,
Tasora, ACM Trans. Graph. 34 (2015) 32).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from twolink.algorithms.friction_cone import cone_derivative, onto_cone
from twolink.integrate.motion.state import Array

NEWTON = 80  # steps before another method leads on: where forces are not determined, it goes round before it finds them
PATIENCE = 20  # of them, without half of what was missed: it goes in circles
LEADING = 30  # accelerated steps before Newton's
POINTS = 400  # of the proximal point method
INNER = 10  # Newton's steps for each of them
TRIED, LOST = 4, 1e3  # after so many it is given up that misses so many times what it began with
NEARER = 0.3  # what they may miss, relative to what the last one missed of the laws themselves; and by how much e falls
FIRST, LAST, LARGEST = 1e-2, 1e-10, 1.0  # e of the proximal points: the first, the smallest, the largest
DAMPING = 0.3  # e, relative to the share of the velocities by which the laws are missed, and the largest
REGULAR = 1e-10  # the smallest e: what makes Newton's matrix regular where forces are not determined
FEW = 50  # contacts for which Newton's method begins at the guess itself
EXACT = 1e-11  # m/s, and relative to the velocities: what the laws may be missed by


@dataclass(frozen=True)
class Impulses:
    """Impulses P (n, 3), velocities U (n, 3), and how far they miss the laws.

    feasibility: the largest approach beyond the gap and the largest |P_t| - mu P_n as a velocity, m/s.
    complementarity: the largest P_n (U_n + c) and mu P_n |U_t| + P_t . U_t, J. residual: |g F|, m/s. solver: what
    found them.
    """

    p: Array
    u: Array
    feasibility: float
    complementarity: float
    residual: float
    solver: str

    @property
    def solved(self) -> bool:
        """True if the laws hold."""
        return self.residual <= EXACT


class ContactProblem:
    """A contact problem. g_matrix: G (3n, 3n), full or sparse. b (n, 3): with c in the normal. mu (n,)."""

    def __init__(self, g_matrix: Any, b: Array, mu: Array) -> None:
        self.matrix, self.b, self.mu = g_matrix, b, mu
        if sparse.issparse(g_matrix):
            self.matrix = sparse.bsr_array(g_matrix, blocksize=(3, 3))
            self.rows = np.repeat(np.arange(len(b)), np.diff(self.matrix.indptr))  # of its blocks
        diagonal = g_matrix.diagonal().reshape(-1, 3)
        self.size = np.maximum(diagonal.max(axis=1), 1e-300)
        self.fastest = float(np.abs(b).max(initial=1e-300))
        self.scale = max(1.0, self.fastest)

    def velocities(self, p: Array) -> Array:
        """U + c (n, 3)."""
        return np.asarray((self.matrix @ p.ravel()).reshape(-1, 3) + self.b)

    def miss(self, p: Array, damping: float = 0.0, anchor: Array | None = None) -> tuple[Array, Array, Array]:
        """F (n, 3), z = P - U / g, and U + c. damping, anchor: e and P_k of a proximal point."""
        u = self.velocities(p)
        if anchor is not None:
            u = u + damping * self.size[:, None] * (p - anchor)
        z = p - u / self.size[:, None]
        return p - onto_cone(z, self.mu), z, u

    def residual(self, f: Array) -> float:
        """|g F| relative to velocities that matter."""
        return float((np.abs(f).max(axis=1, initial=0.0) * self.size).max(initial=0.0)) / self.scale

    def islands(self) -> list[Array]:
        """The contacts (k,) of each set of bodies that no contact connects with the others."""
        n = len(self.b)
        places: Any
        if sparse.issparse(self.matrix):
            places = self.rows, self.matrix.indices
        else:
            places = np.nonzero(self.matrix.reshape(n, 3, n, 3).any(axis=(1, 3)))
        count, of = connected_components(sparse.coo_array((np.ones(len(places[0])), places), shape=(n, n)))
        return [np.flatnonzero(of == k) for k in range(count)]

    def part(self, island: Array) -> ContactProblem:
        """The problem of an island alone, which obeys the laws as exactly as all do."""
        if len(island) == len(self.b):
            return self
        rows = (3 * island[:, None] + np.arange(3)).ravel()
        matrix = self.matrix.tocsr() if sparse.issparse(self.matrix) else self.matrix
        part = ContactProblem(matrix[rows][:, rows], self.b[island], self.mu[island])
        part.scale = self.scale
        return part

    def answer(self, p: Array, solver: str) -> Impulses:
        """The impulses with the residuals of the contact laws."""
        f, _, u = self.miss(p)
        over = (np.hypot(p[:, 0], p[:, 1]) - self.mu * p[:, 2]) * self.size
        feasibility = max(float((-u[:, 2]).max(initial=0.0)), float(over.max(initial=0.0)))
        slip = self.mu * p[:, 2] * np.hypot(u[:, 0], u[:, 1]) + (p[:, :2] * u[:, :2]).sum(axis=1)
        missed = max(float(np.abs(p[:, 2] * u[:, 2]).max(initial=0.0)), float(np.abs(slip).max(initial=0.0)))
        return Impulses(p, u, feasibility, missed, self.residual(f), solver)


def solve_impulses(problem: ContactProblem, guess: Array) -> Impulses:
    """The impulses of a problem from a guess (n, 3), by islands; the best found where the laws are not reached."""
    p, solver = np.array(guess, dtype=float), "newton"
    for island in problem.islands():
        one = problem.part(island)
        found = one.answer(newton(one, accelerated(one, p[island], LEADING if len(island) > FEW else 0)), "newton")
        if not found.solved:
            found = one.answer(proximal(one, accelerated(one, found.p, LEADING)), "proximal")
        p[island], solver = found.p, max(solver, found.solver)  # the slower comes later in the alphabet
    return problem.answer(p, solver)


def newton(problem: ContactProblem, guess: Array) -> Array:
    """The best iterate of Newton's method on F."""
    p, best, mark, since = guess, (np.inf, guess), np.inf, 0
    for _ in range(NEWTON + 1):
        f, z, _ = problem.miss(p)
        residual = problem.residual(f)
        mark, since = (residual, 1) if residual < 0.5 * mark else (mark, since + 1)
        if not np.isfinite(residual) or since > PATIENCE + 1:
            break
        ends = residual <= 0.01 * EXACT or EXACT >= best[0] < 2.0 * residual
        best = min(best, (residual, p), key=lambda one: one[0])
        if ends:
            break
        share = residual * problem.scale / problem.fastest
        p = p - _newton_step(problem, f, z, min(max(REGULAR, DAMPING * share), DAMPING))
    return best[1]


def proximal(problem: ContactProblem, guess: Array) -> Array:
    """The best of proximal points, whose e falls while Newton's method finds them."""
    p, best, damping = guess, (np.inf, guess), FIRST
    for _ in range(POINTS):
        residual = problem.residual(problem.miss(p)[0])
        best = min(best, (residual, p), key=lambda one: one[0])
        if not residual > EXACT:
            break
        found = _proximal_point(problem, p, damping, max(0.01 * EXACT, NEARER * residual))
        if found is None:
            damping = min(5.0 * damping, LARGEST)
        else:
            p, damping = found, max(NEARER * damping, LAST)
    return best[1]


def _proximal_point(problem: ContactProblem, anchor: Array, damping: float, small: float) -> Array | None:
    """The solution of the laws with U + e g (P - anchor) in place of U; None where Newton's method does not find it.

    small: what it may miss. What obeys the laws as they are is taken at once.
    """
    p, lost = anchor, np.inf
    for k in range(INNER + 1):
        f, z, _ = problem.miss(p, damping, anchor)
        residual = problem.residual(f)
        lost = LOST * residual if k == 0 else lost
        if residual <= small or problem.residual(problem.miss(p)[0]) <= EXACT:
            return p
        if not np.isfinite(residual) or (k >= TRIED and residual > lost):
            break
        p = p - _newton_step(problem, f, z, damping)
    return None


def accelerated(problem: ContactProblem, guess: Array, count: int) -> Array:
    """Impulses by a number of steps of P - F / 3 with momentum, which is lost where it leads back."""
    p = ahead = guess
    inertia = 1.0
    for _ in range(count):
        f = problem.miss(ahead)[0]
        after, change = ahead - f / 3.0, ahead - f / 3.0 - p
        inertia = 1.0 if (f * change).sum() > 0.0 else inertia
        more = 0.5 * (1.0 + np.sqrt(1.0 + 4.0 * inertia**2))
        ahead, p, inertia = after + (inertia - 1.0) / more * change, after, more
    return p


def _newton_step(problem: ContactProblem, f: Array, z: Array, damping: float) -> Array:
    """(I - C + C (G / g + e))^-1 F with C = dproj / dz. Where nothing presses, z_n <= 0, it is F."""
    pressing = z[:, 2] > 0.0
    chosen, step = np.flatnonzero(pressing), np.where(pressing[:, None], 0.0, f)
    c = cone_derivative(z[chosen], problem.mu[chosen])
    scaled, others = c / problem.size[chosen, None, None], (problem.matrix @ step.ravel()).reshape(-1, 3)[chosen]
    right = (f[chosen] - np.einsum("nij,nj->ni", scaled, others)).ravel()
    own = np.eye(3) + (damping - 1.0) * c
    solve = _solve_sparse if sparse.issparse(problem.matrix) else _solve_full
    step[chosen] = solve(problem, pressing, own, scaled, right).reshape(-1, 3)
    return step


def _solve_sparse(problem: ContactProblem, pressing: Array, own: Array, scaled: Array, right: Array) -> Array:
    """(own + scaled G)^-1 times the right side; of what presses, with blocks (n, 3, 3) on the diagonal."""
    number = np.cumsum(pressing) - 1
    kept = np.flatnonzero(pressing[problem.rows] & pressing[problem.matrix.indices])
    rows, columns = number[problem.rows[kept]], number[problem.matrix.indices[kept]]
    blocks = scaled[rows] @ problem.matrix.data[kept]
    blocks[rows == columns] += own
    ends = np.searchsorted(rows, np.arange(len(own) + 1))
    by_rows = sparse.bsr_array((blocks, columns, ends), shape=(len(right),) * 2).tocsr()
    transposed = sparse.csc_array((by_rows.data, by_rows.indices, by_rows.indptr), shape=by_rows.shape)
    return np.asarray(factors(transposed).solve(right, trans="T"))


def factors(matrix: Any) -> Any:
    """Of a sparse matrix by columns, whose entries lie symmetrically."""
    return splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.1, options={"SymmetricMode": True})


def _solve_full(problem: ContactProblem, pressing: Array, own: Array, scaled: Array, right: Array) -> Array:
    """(own + scaled G)^-1 times the right side, for a full matrix; of what presses."""
    rows, n = np.flatnonzero(np.repeat(pressing, 3)), len(own)
    jacobian = np.matmul(scaled, problem.matrix[np.ix_(rows, rows)].reshape(n, 3, 3 * n)).reshape(3 * n, 3 * n)
    jacobian.reshape(n, 3, n, 3)[np.arange(n), :, np.arange(n), :] += own
    try:
        return np.asarray(np.linalg.solve(jacobian, right))
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.lstsq(jacobian, right, rcond=1e-12)[0])
