"""The certificate of programs of equations of motion: they agree with Pinocchio and NumPy."""

import itertools
import math
from typing import Any

import numpy as np

from twolink.algorithms.namespaces import Numbers
from twolink.errors import CertificationError
from twolink.integrate.motion.effect_numbers import nominal_vector
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.formulas import projected
from twolink.integrate.motion.pinocchio_rate import rate as rate_by_pinocchio
from twolink.integrate.motion.state import Array

AGREEMENT = 1e-8  # largest difference of the two steps, relative to the step
STATES = 8  # on which they are compared
BESIDE = 0.1  # rad, m, and per second: how far states are from the start
NEARER = (1.0, 0.1, 0.01, 0.0)  # of it: the first that is not much nearer to singular than the start
SINGULAR = 1e14  # condition numbers of mass matrices above it
LEAST = 0.1  # of the smallest pivot of the constraints at the start


def _lock_some(equations: Equations, x: Array) -> None:
    """Lock some joints in each state but the first, as far as the loops leave the others free to move."""
    lockable, constraints = equations.layout.lockable, equations.constraints
    first = equations.space.size - 2 * len(lockable)
    x[first : first + len(lockable)] = 0.0
    for column in range(1, x.shape[1]):
        locks = x[first : first + len(lockable), column]
        for i in range(column % 2, len(lockable), 2):
            if constraints is not None:
                jacobian = constraints.jacobian_at(x[: equations.space.nq, column], constraints.kept)
                jacobian[:, list(lockable)] *= 1.0 - np.where(np.arange(len(lockable)) == i, 1.0, locks)
                if np.linalg.matrix_rank(jacobian, tol=1e-3) < len(jacobian):
                    continue
            locks[i] = 1.0


def certify_rate(equations: Equations, compiled: Any) -> None:
    """Compare a rate with Pinocchio's at the start and at states around it, beside closed loops too.

    Solving for accelerations multiplies rounding by the condition number of the mass matrix, in both.
    """
    x = _states(equations)
    values = np.broadcast_to(_parameters(equations), (len(equations.parameters), STATES))
    ours = compiled(np.concatenate([np.zeros((1, STATES)), x, values]))
    theirs = rate_by_pinocchio(equations, 0.0, x)
    matrices = equations.robot.mass_matrix(equations.space.rows(x)[0])
    condition = np.linalg.cond(matrices) if matrices.size else np.ones(STATES)
    size = np.abs(theirs).max(axis=0) * (1.0 + np.finfo(float).eps * condition / AGREEMENT)
    size[condition > SINGULAR] = np.inf  # rounding decides there
    _require_agreement(equations, "rate", x, ours, theirs, 1.0 + size)


def certify_projection(equations: Equations, compiled: Any) -> None:
    """Compare a projection with NumPy's."""
    x = _states(equations)
    values = np.broadcast_to(_parameters(equations), (len(equations.parameters), STATES))
    with np.errstate(all="ignore"):
        theirs = projected(equations, x, Numbers)
    scale = 1.0 + np.nan_to_num(np.abs(theirs)).max(axis=0)
    _require_agreement(equations, "projection", x, compiled(np.concatenate([x, values])), theirs, scale)


def _states(equations: Equations) -> Array:
    """The start, and random states BESIDE it, (size, STATES).

    Where constraints are nearly singular, such as where bodies overlap or at Painleve's angle of a rod that slides,
    nothing can be compared; states there are taken nearer to the start.
    """
    x = np.repeat(equations.start[:, None], STATES, axis=1)
    shift = np.random.default_rng(1).uniform(-BESIDE, BESIDE, (equations.space.size, STATES))
    least = LEAST * _smallest_pivot(equations, equations.start)
    for column, nearer in itertools.product(range(1, STATES), NEARER):
        if nearer == NEARER[0] or not _smallest_pivot(equations, x[:, column]) >= least:
            x[:, column] = equations.space.normalized(equations.start + nearer * shift[:, column], Numbers)
    _lock_some(equations, x)
    return x


@np.errstate(all="ignore")
def _smallest_pivot(equations: Equations, x: Array) -> float:
    """The smallest pivot of the constraints' A = J M^-1 B of one state, scaled; NaN where it is not finite.

    Infinite without rows: what a stop holds already leaves those of a contact none.
    """
    constraints, space = equations.constraints, equations.space
    if constraints is None or not len(constraints.kept):
        return math.inf
    q, v = x[: space.nq], x[space.v_rows]
    jacobian = constraints.jacobian_at(q, constraints.kept)
    loops = equations.layout.with_numbers(constraints.loops, list(x[space.moving :]))
    forces = np.array(constraints.force_rows(constraints.mech, q, v, Numbers, jacobian.tolist(), loops), dtype=float)
    matrix = jacobian @ np.linalg.solve(equations.robot.mass_matrix(q), forces.T)
    if not np.isfinite(matrix).all():
        return math.nan
    matrix *= np.outer(constraints.scales, constraints.scales)
    minors = np.array([np.linalg.det(matrix[:k, :k]) for k in range(len(matrix) + 1)])
    return float((minors[1:] / minors[:-1]).min())


def _parameters(equations: Equations) -> Array:
    """The robot's own values of the run-time parameters, (p, 1)."""
    return np.array(nominal_vector(equations)).reshape(-1, 1)


def _require_agreement(equations: Equations, what: str, x: Array, ours: Array, theirs: Array, scale: Array) -> None:
    """Require that results (size, STATES) agree. Raises CertificationError with the worst state."""
    with np.errstate(all="ignore"):
        error = np.abs(ours - theirs).max(axis=0) / scale
    # Where the motion has no rate, or rounding decides about it, there is nothing to compare: the solver says so.
    error[~(np.isfinite(theirs).all(axis=0) & np.isfinite(scale))] = 0.0
    if equations.constraints is not None:  # beside a singular position there is no number: that is meant
        error[np.isnan(ours).any(axis=0) & (np.arange(STATES) > 0)] = 0.0
    if not error.max() <= AGREEMENT:
        worst = int(np.argmax(np.where(np.isnan(error), np.inf, error)))
        raise CertificationError(
            f"the {what} differs from Pinocchio's by {error[worst]:.1e}",
            where=f"x = {x[:, worst].tolist()}",
            remedy="report it with the URDF",
        )
