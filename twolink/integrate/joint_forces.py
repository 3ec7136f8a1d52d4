"""Accelerations along a solution, and the torques that effects, friction and holds apply in the joints."""

import numpy as np

from twolink.integrate.equations import Equations
from twolink.integrate.hybrid.snapshot import Evaluator
from twolink.integrate.state import Array


def accelerations_and_joint_torques(equations: Equations, t: Array, x: Array) -> tuple[Array, Array]:
    """Accelerations and applied joint torques at states of one smooth piece.

        M(q) a + h(q, v) = tau + J^T f_ext + J_c^T lambda

    Without external wrenches f_ext and constraint forces lambda, tau is RNEA(q, v, a).

    Parameters
    ----------
    equations : Equations
        Equations of the piece; their start holds the numbers of the piece behind (q, v).
    t : ndarray (n,)
        Times, s.
    x : ndarray (nq + nv, n) or (size, n)
        States (q, v), with or without the numbers of the piece behind them.

    Returns
    -------
    a : ndarray (nv, n)
        Accelerations, in the tangent space, per s^2.
    tau : ndarray (nv, n)
        Joint torques and forces of effects, dry friction and holds, N m or N.
    """
    rows = equations.start[len(x) :]
    states = np.concatenate([x, np.repeat(rows[:, None], x.shape[1], axis=1)])
    snapshot = Evaluator(equations).by_numpy(t, states)
    tau = snapshot.tau.copy()
    tau[list(equations.layout.lockable)] += snapshot.locks
    return snapshot.a, tau
