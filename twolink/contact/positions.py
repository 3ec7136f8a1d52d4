"""Positions at the end of a step: the motion dq = M^-1 J^T nu that removes what velocities leave of gaps and of drift.

    a contact that lasts   g + J_n dq = 0,   where it sticks  d + J_t dq = 0
    any other              0 <= g + J_n dq,  0 <= nu,  nu (g + J_n dq) = 0

g, d: the gap at the end of the step and the slip within it, m. A contact that sticks has U_t+ = 0 at the middle of each
step, but J changes: it begins the next one with U_t = h J' v, and slips by h^2 J' v / 2. What that slip takes from the
energy or gives to it, the motion gives back (Acary, Brogliato: Numerical Methods for Nonsmooth Dynamical Systems, 2008,
chapter 10, for projections of positions).
"""

from typing import Any

import numpy as np
import scipy.sparse as sparse

from twolink.contact.impulses import ContactProblem, factors, solve_impulses
from twolink.geometry.points import CLOSED
from twolink.integrate.motion.state import Array

SETS = 40  # that press, without friction
REGULAR = 1e-11  # of the largest of G: what makes equations regular that are not independent
SOFT = 1e-6  # of G at a contact: slip yields to overlap where not both can be removed


def correction(inverse: Any, rows: Any, off: Array, lasts: Array, rests: Array) -> Array | None:
    """dq (nv,); None where there is none.

    Parameters
    ----------
    inverse, rows : matrix
        M^-1 (nv, nv) and J (3n, nv), full or sparse.
    off : ndarray (n, 3)
        Slip and gap, m.
    lasts : ndarray (n, 3) of bool
        Directions in which contacts last.
    rests : ndarray (n,) of bool
        Contacts that must not overlap.
    """
    normal = np.zeros_like(lasts)
    normal[:, 2] = rests
    if np.abs(off[lasts]).max(initial=0.0) < CLOSED and off[normal & ~lasts].min(initial=0.0) > -CLOSED:
        return np.zeros(rows.shape[1])
    for equal in (lasts, np.zeros_like(lasts)):
        sought = equal | normal & (off < -CLOSED)
        try:
            for _ in range(SETS):
                near = np.flatnonzero(sought)
                own = rows[near]
                response = inverse @ own.T
                push = response @ solve_normal(own @ response, off.ravel()[near], equal.ravel()[near], near % 3 < 2)
                missed = normal & ~sought & (off + (rows @ push).reshape(off.shape) < -CLOSED)
                if not missed.any():
                    return np.asarray(push)
                sought |= missed
        except (ArithmeticError, np.linalg.LinAlgError):
            continue
    return None


def solve_normal(matrix: Any, b: Array, equal: Array | None = None, soft: Array | None = None) -> Array:
    """P (n,) with 0 <= P, 0 <= G P + b and P (G P + b) = 0; G (n, n), full or sparse. Without friction.

    equal, soft (n,): rows with G P + b = 0 and any P; rows that yield. Newton's method: the set that presses is solved
    for until it stays (Hintermueller, Ito, Kunisch, SIAM J. Optim. 13 (2002) 865-888); where it does not, as contacts
    with friction 0 if no rows are equal. Raises ArithmeticError where that fails too.
    """
    size = np.maximum(matrix.diagonal(), 1e-300)
    always = np.zeros(len(b), dtype=bool) if equal is None else equal
    regular = np.full(len(b), REGULAR * float(size.max()))
    if soft is not None:
        regular[soft] += SOFT * size[soft]
    pressing = always | (b < 0.0)
    for _ in range(SETS):
        p, chosen = np.zeros(len(b)), np.flatnonzero(pressing)
        part = matrix[chosen][:, chosen]
        if sparse.issparse(part):
            p[chosen] = factors((part + sparse.diags_array(regular[chosen])).tocsc()).solve(-b[chosen])
        else:
            p[chosen] = np.linalg.solve(part + np.diag(regular[chosen]), -b[chosen])
        now = always | (p - (matrix @ p + b) / size > 0.0)
        if (now == pressing).all():
            return p
        pressing = now
    if always.any():
        raise ArithmeticError
    thick = np.zeros((len(b), 3))
    thick[:, 2] = b
    found = solve_impulses(ContactProblem(_with_tangents(matrix), thick, np.zeros(len(b))), np.zeros_like(thick))
    if not found.solved:
        raise ArithmeticError
    return found.p[:, 2]


def _with_tangents(matrix: Any) -> Any:
    """G (3n, 3n) of normals G (n, n) and tangents that are not coupled."""
    normal, tangents = np.diag([0.0, 0.0, 1.0]), np.diag([1.0, 1.0, 0.0])
    if sparse.issparse(matrix):
        return sparse.kron(matrix, normal) + sparse.kron(sparse.eye_array(matrix.shape[0]), tangents)
    return np.kron(matrix, normal) + np.kron(np.eye(len(matrix)), tangents)
