"""Transposed steps: what the parameters' part of Runge-Kutta steps adds to a gradient, for many steps at once.

    k_i = f(t_i, x_i, p),   x_i = x + h sum_j a_ij k_j,   x_new = x + h sum_i b_i k_i

    w_i = h (b_i w + sum_j a_ji g_j),   g_i = w_i^T f_x(t_i, x_i),   w^T dx_new/dp = sum_i w_i^T f_p(t_i, x_i)

That is the reverse mode through the steps of `variational_steps`, whose parameters it follows: the same sum to
rounding, but of one covector w instead of p directions. Where w at the end of each step is known, no step depends on
another (Hager 2000, Numerische Mathematik 87, 247-282).
"""

import numpy as np

from twolink.algorithms.namespaces import Numbers
from twolink.dynamics.kernels import pays_threads
from twolink.integrate.adjoint_rate import PULLED_BACK, adjoint_rate
from twolink.integrate.equations import Equations
from twolink.integrate.state import Array
from twolink.integrate.variational_rate import constant_rows
from twolink.integrate.variational_steps import CHUNK, TABLEAU, tangent_basis

STAGES = len(TABLEAU.b)
WEIGHTS = np.zeros((STAGES, STAGES))
for _i, _row in enumerate(TABLEAU.a):
    WEIGHTS[_i, : len(_row)] = _row


class AdjointSteps:
    """Steps of DOP853 of equations with parameters, transposed. gains (r, p): as of `VariationalSteps`."""

    def __init__(self, equations: Equations, gains: Array) -> None:
        self.equations, self.gains = equations, gains
        self._rate = adjoint_rate(equations, len(gains) - len(equations.parameters))

    def by_parameters(self, t: Array, x: Array, end: Array, covectors: Array) -> Array:
        """The sum (p,) over n steps of w^T dx_new/dp.

        Parameters
        ----------
        t, end : ndarray (n,)
            When the steps begin and end, s.
        x : ndarray (nq + nv, n)
            The states at their begin.
        covectors : ndarray (2 nv, n)
            w at their ends, of q in the tangent space, and of v.
        """
        size = max(64, CHUNK // (STAGES * self.equations.moving * 2))
        total = np.zeros(len(self.gains))
        for first in range(0, len(t), size):
            part = slice(first, first + size)
            total += self._pulled(t[part], x[:, part], (end - t)[part], covectors[:, part])
        return np.asarray(self.gains.T @ total)

    def _pulled(self, t: Array, x: Array, h: Array, covectors: Array) -> Array:
        """The sum (r,) by what is driven."""
        equations, moving, n = self.equations, self.equations.moving, len(t)
        constant = constant_rows(equations)
        fixed = np.broadcast_to(constant, (len(constant), n))
        rows = np.concatenate([t[None], fixed, x, np.empty((moving, n))])
        before = len(rows) - 2 * moving
        parallel = pays_threads(n, int(equations.operations * (1.0 + PULLED_BACK)))
        states, rates = np.empty((STAGES, moving, n)), np.empty((STAGES, moving, n))
        for i in range(STAGES):
            states[i] = x + h * np.tensordot(WEIGHTS[i, :i], rates[:i], 1)
            rows[0], rows[before : before + moving] = t + TABLEAU.c[i] * h, states[i]
            self._rate.value(rows[: before + moving], rates[i], batch_parallel=parallel)
        end = x + h * np.tensordot(np.asarray(TABLEAU.b), rates, 1)
        w, total = self._ambient(end, covectors), np.zeros(len(self.gains))
        pulled = np.zeros((STAGES, moving, n))
        out = np.empty((moving + len(self.gains), n))
        for i in reversed(range(STAGES)):
            own = h * (TABLEAU.b[i] * w + np.tensordot(WEIGHTS[i + 1 :, i], pulled[i + 1 :], 1))
            rows[0], rows[before : before + moving], rows[before + moving :] = t + TABLEAU.c[i] * h, states[i], own
            self._rate.pulled(rows, out, batch_parallel=parallel)
            pulled[i] = out[:moving]
            total += out[moving:].sum(axis=1)
        return total

    def _ambient(self, x: Array, covectors: Array) -> Array:
        """Covectors (2 nv, n) of the tangent space at states x (nq + nv, n) as such of the entries of q and v."""
        space = self.equations.space
        if not space.curved:
            return covectors
        basis = tangent_basis(space, space.normalized(x, Numbers)[: space.nq])
        of_q = np.einsum("qkn,kn->qn", basis / (basis * basis).sum(axis=0), covectors[: space.nv])
        return np.concatenate([of_q, covectors[space.nv :]])
