"""The contact problem of a step: impulses P of all contacts that obey the laws of contact and friction at once.

    U = G P + b
    normal    0 <= P_n,   0 <= U_n + c,   P_n (U_n + c) = 0
    tangent   |P_t| <= mu P_n,   U_t = 0 or P_t = -mu P_n U_t / |U_t|

G = J M^-1 J^T; b: the velocities without impulses; c: what the gap still leaves open. P and U have the normal last.

The laws are the zeros of F(P) = P - proj(P - U / g), proj onto the cone of radius mu P_n, g the size of G at a contact.
Newton's method on F from the last step's impulses mostly ends in a few steps (Alart, Curnier, Comput. Methods Appl.
Mech. Engrg. 92 (1991) 353-375). Where it does not, it begins again from a few steps of P - F / 3, or is led over
contacts that give way, G + e D with e to 0. Where that fails too, Pinocchio's ADMM solver brings few contacts near
(Carpentier, Montaut, Le Lidec: From Compliant to Rigid Contact Simulation, RSS 2024), or sweeps over them (Jourdan,
Alart, Jean, Comput. Methods Appl. Mech. Engrg. 155 (1998) 31-47).
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
import scipy.sparse as sparse
from scipy.sparse.linalg import splu

from twolink.integrate.hybrid.contact_problem import friction_force
from twolink.integrate.state import Array

NEWTON = 40  # steps
SHORTEST = 0.02  # of a step
ROUNDS = 4  # of relaxing
REGULAR = 1e-11  # relative to G: what makes Newton's matrix regular where forces are not determined
ADMM = 2_000  # iterations
SOFT = (1e-1, 1e-2, 1e-3, 1e-4, 1e-6)  # of G: how much softened contacts give way
SWEEPS = 300
LARGE = 200  # contacts beyond which these two take longer than half the step
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
        """Whether the laws hold."""
        return self.residual <= EXACT


class Problem:
    """A contact problem. g_matrix: G (3n, 3n), full or sparse. b (n, 3): with c in the normal. mu (n,)."""

    def __init__(self, g_matrix: Any, b: Array, mu: Array) -> None:
        thin = sparse.issparse(g_matrix)
        self.matrix, self.b, self.mu = sparse.bsr_array(g_matrix, blocksize=(3, 3)) if thin else g_matrix, b, mu
        self.pattern = _Pattern(self.matrix) if thin else None
        diagonal = g_matrix.diagonal().reshape(-1, 3)
        self.size = np.maximum(diagonal.max(axis=1), 1e-300)
        self.scale = max(1.0, float(np.abs(b).max(initial=0.0)))

    def velocities(self, p: Array) -> Array:
        """U + c (n, 3)."""
        return np.asarray((self.matrix @ p.ravel()).reshape(-1, 3) + self.b)

    def miss(self, p: Array) -> tuple[Array, Array, Array]:
        """F (n, 3), z = P - U / g, and U + c."""
        u = self.velocities(p)
        z = p - u / self.size[:, None]
        out = z.copy()
        normal = np.maximum(z[:, 2], 0.0)
        limit, length = self.mu * normal, np.hypot(z[:, 0], z[:, 1])
        slips = length > limit
        out[:, :2] *= np.where(slips, limit / np.where(slips, length, 1.0), 1.0)[:, None]
        out[:, 2] = normal
        return p - out, z, u

    def residual(self, f: Array) -> float:
        """|g F| relative to velocities that matter."""
        return float((np.abs(f).max(axis=1, initial=0.0) * self.size).max(initial=0.0)) / self.scale

    def norm(self, f: Array) -> float:
        """|g F|, the sum over all contacts."""
        return float(np.linalg.norm(f * self.size[:, None]))

    def answer(self, p: Array, solver: str) -> Impulses:
        """What the impulses are worth."""
        f, _, u = self.miss(p)
        over = (np.hypot(p[:, 0], p[:, 1]) - self.mu * p[:, 2]) * self.size
        feasibility = max(float((-u[:, 2]).max(initial=0.0)), float(over.max(initial=0.0)))
        slip = self.mu * p[:, 2] * np.hypot(u[:, 0], u[:, 1]) + (p[:, :2] * u[:, :2]).sum(axis=1)
        missed = max(float(np.abs(p[:, 2] * u[:, 2]).max(initial=0.0)), float(np.abs(slip).max(initial=0.0)))
        return Impulses(p, u, feasibility, missed, self.residual(f), solver)


class _Pattern:
    """Where the 3 x 3 blocks of a sparse matrix are, and where their entries are in columns."""

    def __init__(self, matrix: Any) -> None:
        count = len(matrix.indptr) - 1
        self.rows = np.repeat(np.arange(count), np.diff(matrix.indptr))
        self.diagonal = np.flatnonzero(self.rows == matrix.indices)
        numbers = np.arange(matrix.data.size).reshape(matrix.data.shape)
        columns = sparse.bsr_array((numbers, matrix.indices, matrix.indptr), shape=matrix.shape).tocsc()
        self.order, self.parts = columns.data, (columns.indices, columns.indptr)

    def solved(self, matrix: Any, factors: Array, own: Array, right: Array) -> Array:
        """(own + factors G)^-1 times the right side (n, 3). factors, own: blocks (n, 3, 3) on the diagonal."""
        blocks = factors[self.rows] @ matrix.data
        blocks[self.diagonal] += own
        columns = sparse.csc_array((blocks.ravel()[self.order], *self.parts), shape=matrix.shape)
        return np.asarray(splu(columns).solve(right.ravel()).reshape(-1, 3))


def solve_normal(matrix: Any, b: Array) -> Array:
    """P (n,) with 0 <= P, 0 <= G P + b and P (G P + b) = 0; G (n, n), full or sparse. Without friction.

    Newton's method: the set that presses is solved for until it stays (Hintermueller, Ito, Kunisch, SIAM J. Optim. 13
    (2002) 865-888); where it does not, as contacts with friction 0. Raises ArithmeticError where that fails too.
    """
    size = np.maximum(matrix.diagonal(), 1e-300)
    pressing = b < 0.0
    for _ in range(NEWTON):
        p, chosen = np.zeros(len(b)), np.flatnonzero(pressing)
        part = matrix[chosen][:, chosen]
        if sparse.issparse(part):
            regular = (part + REGULAR * float(size.max()) * sparse.eye_array(len(chosen))).tocsc()
            p[chosen] = splu(regular, permc_spec="MMD_AT_PLUS_A").solve(-b[chosen])
        else:
            p[chosen] = np.linalg.solve(part + REGULAR * float(size.max()) * np.eye(len(chosen)), -b[chosen])
        now = p - (matrix @ p + b) / size > 0.0
        if (now == pressing).all():
            return p
        pressing = now
    thick = np.zeros((len(b), 3))
    thick[:, 2] = b
    found = solve_impulses(Problem(_with_tangents(matrix), thick, np.zeros(len(b))), np.zeros_like(thick))
    if not found.solved:
        raise ArithmeticError
    return found.p[:, 2]


def _with_tangents(matrix: Any) -> Any:
    """G (3n, 3n) of normals G (n, n) and tangents that are not coupled."""
    normal, tangents = np.diag([0.0, 0.0, 1.0]), np.diag([1.0, 1.0, 0.0])
    if sparse.issparse(matrix):
        return sparse.kron(matrix, normal) + sparse.kron(sparse.eye_array(matrix.shape[0]), tangents)
    return np.kron(matrix, normal) + np.kron(np.eye(len(matrix)), tangents)


def solve_impulses(problem: Problem, guess: Array) -> Impulses:
    """The impulses of a problem from a guess (n, 3); the best found where the laws are not reached."""
    best = near = problem.answer(newton(problem, guess), "newton")
    for solver in (relaxed, softened, relaxed, admm, sweeps):
        if best.solved or (len(guess) > LARGE and solver in (admm, sweeps)):
            break
        start = guess if solver is softened else near.p
        near = problem.answer(newton(problem, solver(problem, start)), solver.__name__)
        best = min((best, near), key=lambda one: one.residual)
    return best


def newton(problem: Problem, guess: Array, *, shorten: bool = True) -> Array:
    """The best iterate of Newton's method on F. shorten: each step only as long as F becomes smaller."""
    p, (f, z, _) = guess, problem.miss(guess)
    best = problem.residual(f), guess
    for _ in range(NEWTON):
        size = problem.norm(f)
        if best[0] <= 0.1 * EXACT or not np.isfinite(size):
            break
        step, share, nearest = _newton_step(problem, f, z), 1.0, (np.inf, p, f, z)
        while share >= (SHORTEST if shorten else 1.0) and not nearest[0] < (1.0 - 1e-4 * share) * size:
            trial = p - share * step
            missed, place, _ = problem.miss(trial)
            nearest = min(nearest, (problem.norm(missed), trial, missed, place), key=lambda one: one[0])
            share *= 0.5
        if not np.isfinite(nearest[0]):
            break
        _, p, f, z = nearest
        best = min(best, (problem.residual(f), p), key=lambda one: one[0])
    return best[1]


def _newton_step(problem: Problem, f: Array, z: Array) -> Array:
    """(I - C + C G / g)^-1 F with C = dproj / dz."""
    n = len(f)
    c = _derivative(problem.mu, z)
    scaled = c / problem.size[:, None, None]
    own = np.eye(3) - c + REGULAR * float(problem.size.max()) * scaled
    if problem.pattern is not None:
        return problem.pattern.solved(problem.matrix, scaled, own, f)
    jacobian = np.matmul(scaled, problem.matrix.reshape(n, 3, 3 * n)).reshape(3 * n, 3 * n)
    jacobian.reshape(n, 3, n, 3)[np.arange(n), :, np.arange(n), :] += own
    try:
        return np.asarray(np.linalg.solve(jacobian, f.ravel()).reshape(-1, 3))
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.lstsq(jacobian, f.ravel(), rcond=1e-12)[0].reshape(-1, 3))


def _derivative(mu: Array, z: Array) -> Array:
    """C (n, 3, 3): the derivative of proj at z."""
    c = np.zeros((len(z), 3, 3))
    length, limit = np.hypot(z[:, 0], z[:, 1]), mu * np.maximum(z[:, 2], 0.0)
    presses = z[:, 2] > 0.0
    c[presses, 2, 2] = 1.0
    sticks = presses & (length <= limit)
    c[sticks, 0, 0] = c[sticks, 1, 1] = 1.0
    slips = presses & ~sticks
    d = z[slips, :2] / length[slips, None]
    share = (limit[slips] / length[slips])[:, None, None]
    c[slips, :2, :2] = share * (np.eye(2) - d[:, :, None] * d[:, None, :])
    c[slips, :2, 2] = mu[slips, None] * d
    return c


def relaxed(problem: Problem, guess: Array) -> Array:
    """Impulses by a few steps of P - F / 3, then whole Newton steps, which pass the corners of friction's cone."""
    best = problem.residual(problem.miss(guess)[0]), guess
    p = guess
    for _ in range(ROUNDS):
        for _ in range(5):
            p = p - problem.miss(p)[0] / 3.0
        end = newton(problem, p, shorten=False)
        residual = problem.residual(problem.miss(end)[0])
        if residual < best[0]:
            best, p = (residual, end), end
        if residual <= EXACT:
            break
    return best[1]


def softened(problem: Problem, guess: Array) -> Array:
    """Impulses of contacts that give way, less and less, each solved from those before."""
    p = guess
    for share in SOFT:
        give = np.repeat(share * problem.size, 3)
        matrix = problem.matrix + (sparse.diags_array(give) if sparse.issparse(problem.matrix) else np.diag(give))
        p = newton(Problem(matrix, problem.b, problem.mu), p)
    return p


def admm(problem: Problem, guess: Array) -> Array:
    """Impulses by Pinocchio's ADMM solver."""
    dense = not sparse.issparse(problem.matrix)
    if dense:
        delassus = pin.DelassusOperatorDense(problem.matrix)
    else:
        matrix = sparse.csc_matrix(problem.matrix)
        matrix.indices, matrix.indptr = matrix.indices.astype(np.int32), matrix.indptr.astype(np.int32)
        delassus = pin.DelassusOperatorSparse(matrix)
    models, datas = pin.StdVec_ConstraintModel(), pin.StdVec_ConstraintData()
    for mu in problem.mu.tolist():
        model, data = _cone(mu)
        models.append(model)
        datas.append(data)
    settings, result = pin.ADMMSolverSettings(), pin.ADMMSolverResult()
    settings.max_iterations = ADMM
    settings.absolute_feasibility_tol = settings.absolute_complementarity_tol = 1e-10
    settings.relative_feasibility_tol = settings.relative_complementarity_tol = 1e-12
    result.resize(guess.size)
    result.setConstraintImpulseGuess(guess.ravel())
    pin.ADMMConstraintSolver(guess.size).solve(delassus, problem.b.ravel(), models, datas, settings, result)
    p = np.array(result.retrieveConstraintImpulses()).reshape(-1, 3)
    return p if np.isfinite(p).all() else guess


@functools.lru_cache(maxsize=64)
def _cone(mu: float) -> tuple[Any, Any]:
    """A point contact with this friction, of which Pinocchio's solvers see the cone alone."""
    model = pin.buildSampleModelManipulator()
    contact = pin.PointContactConstraintModel(model, 1, pin.SE3.Identity())
    contact.setFriction(mu)
    return pin.ConstraintModel(contact), pin.ConstraintData(contact.createData())


def sweeps(problem: Problem, guess: Array) -> Array:
    """Impulses by sweeps over the contacts, each solved with those of the others as they are."""
    matrix = problem.matrix.toarray() if sparse.issparse(problem.matrix) else problem.matrix
    p = guess.copy()
    u = problem.velocities(p)
    for _ in range(SWEEPS):
        for i in range(len(p)):
            gain, before = matrix[3 * i : 3 * i + 3, 3 * i : 3 * i + 3], p[i].copy()
            if gain[2, 2] <= 0.0:
                continue
            p[i, 2] = max(0.0, before[2] - u[i, 2] / gain[2, 2])
            wanted = gain[:2, :2] @ before[:2] - u[i, :2] - gain[:2, 2] * (p[i, 2] - before[2])
            p[i, :2] = friction_force(gain[:2, :2], wanted, problem.mu[i] * p[i, 2])
            u += (matrix[:, 3 * i : 3 * i + 3] @ (p[i] - before)).reshape(-1, 3)
        if problem.residual(problem.miss(p)[0]) <= EXACT:
            break
    return p
