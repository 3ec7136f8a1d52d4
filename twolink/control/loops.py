"""Independent coordinates of robots with closed loops: the tangent space of what the loops allow.

    J dq = 0,   J dv + (d(J v)/dq) dq = 0        (rows of the loops, differentiated along allowed motions)

Some degrees of freedom are independent; those of the loops' other joints follow.
"""

from typing import Any, NamedTuple

import numpy as np

from twolink.algorithms.mechanism import Mechanism
from twolink.control.derivatives import derivatives_of
from twolink.errors import SceneError
from twolink.integrate.assembly import RANK
from twolink.integrate.constraints import Constraints
from twolink.integrate.equations import Equations
from twolink.integrate.state import Array


class Freedom(NamedTuple):
    """independent (d): degrees of freedom. lift (n, 2 nv, 2 d): the changes (dq, dv) of all by those of these."""

    independent: tuple[int, ...]
    lift: Array


def freedom(equations: Equations, t: Array, x: Array) -> Freedom:
    """The independent coordinates at states x (size, n), the same ones at all.

    Raises SceneError where the loops are in a singular position, code "singular-position".
    """
    nv, constraints = equations.space.nv, equations.constraints
    if constraints is None:
        return Freedom(tuple(range(nv)), np.broadcast_to(np.eye(2 * nv), (len(t), 2 * nv, 2 * nv)))
    rows = np.array([_jacobian(constraints, q) for q in x[: equations.space.nq].T])
    dependent = _dependent(rows)
    independent = tuple(k for k in range(nv) if k not in dependent)
    d, own = len(independent), list(independent)
    turning = derivatives_of(_velocities, equations, t, x)[1][:, :, :nv]
    inverse = np.linalg.inv(rows[:, :, dependent])
    lift = np.zeros((len(t), 2 * nv, 2 * d))
    lift[:, own, range(d)] = lift[:, [nv + k for k in own], range(d, 2 * d)] = 1.0
    along = -inverse @ rows[:, :, own]
    lift[:, dependent, :d] = lift[:, [nv + k for k in dependent], d:] = along
    lift[:, [nv + k for k in dependent], :d] = -inverse @ turning @ lift[:, :nv, :d]
    return Freedom(independent, lift)


def allowed(constraints: Constraints, q: Array) -> Array:
    """The projection (nv, nv) onto the velocities that the loops allow at q."""
    rows = _jacobian(constraints, q)
    return np.asarray(np.eye(rows.shape[1]) - np.linalg.pinv(rows, rcond=RANK) @ rows)


def _jacobian(constraints: Constraints, q: Array) -> Array:
    return constraints.jacobian_at(q, constraints.kept)


def _velocities(equations: Equations, mech: Mechanism, _t: Any, x: Any, xp: Any) -> list[Any]:
    """J v of the kept rows."""
    nq, constraints = equations.space.nq, equations.constraints
    return [] if constraints is None else constraints.velocities(mech, x[:nq], x[nq : equations.moving], xp)


def _dependent(rows: Array) -> list[int]:
    """The degrees of freedom by which J (n, r, nv) is inverted best, at the worst of the states."""
    from scipy.linalg import qr

    r = rows.shape[1]
    choices = {tuple(sorted(qr(j, mode="r", pivoting=True)[1][:r].tolist())) for j in rows}
    sizes = {c: float(np.linalg.svd(rows[:, :, list(c)], compute_uv=False)[:, -1].min()) for c in choices}
    best = max(sizes, key=lambda choice: sizes[choice])
    if not sizes[best] > RANK**0.5 * float(np.linalg.norm(rows, axis=(1, 2)).max()):
        raise SceneError("the loops are in a singular position, where no joints are independent of the others",
                         where="q", remedy="ask for a state beside it", code="singular-position")  # fmt: skip
    return list(best)
