"""Loops in a step: rows B of the velocities that contacts do not change.

    B (v + v+) = B_0 v,   q+ moves back by M^-1 B^T (B M^-1 B^T)^-1 g_0

B: the rows at the middle of the step. B_0, g_0: the rows and the gaps of the loops at its begin. Where B_0 v = 0 the
mean velocity keeps the loops, whose forces then do no work; what is left of B_0 v and of g_0 is taken away. Contacts
see the inverse mass matrix of what the loops leave free,

    W = M^-1 - M^-1 B^T (B M^-1 B^T)^-1 B M^-1.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from twolink.algorithms.mechanism import mechanism
from twolink.algorithms.namespaces import Expressions, Numbers
from twolink.contact.multibody import Multibody
from twolink.dynamics.kernels import heyoka
from twolink.integrate.compile_time import UNOPTIMIZED
from twolink.integrate.compiled_functions import compiled_function
from twolink.integrate.constraints import Constraints
from twolink.integrate.equations import Equations
from twolink.integrate.state import Array

SINGULAR = 1e-10  # relative: singular values of B M^-1 B^T below it belong to positions where the loops are singular


class Kept(NamedTuple):
    """What the loops leave of a step: v+ without contacts (nv,), W (nv, nv), and the change (nv,) that closes them."""

    free: Array
    inverse: Any
    closing: Array | float


class LoopRows:
    """The loops of a scene, from its equations with them."""

    def __init__(self, equations: Equations, constraints: Constraints) -> None:
        self.constraints = constraints
        self.function = None if heyoka() is None else _compiled(equations, constraints)

    def at(self, q: Array) -> tuple[Array, Array]:
        """g (m,) and B (m, nv) of the rows that are not redundant."""
        loops = self.constraints
        if self.function is None:
            rows = loops.residuals(loops.mech, list(q), Numbers)
            return np.array([float(rows[i]) for i in loops.kept]), loops.jacobian_at(q, loops.kept)
        out, count = self.function(q), len(loops.kept)
        return out[:count], out[count:].reshape(count, -1)

    def keep(self, bodies: Multibody, q: Array, middle: Array, w: Array, free: Array) -> Kept:
        """A step from (q, w) by way of its middle, at which the bodies are. free: w+ without loops and contacts."""
        g, start = self.at(q)
        rows = bodies.turned(self.at(middle)[1])
        response = bodies.inverse @ rows.T
        solved = response @ np.linalg.pinv(rows @ response, rcond=SINGULAR, hermitian=True)
        wanted = start @ bodies.own(q, w) - rows @ w
        return Kept(free + solved @ (wanted - rows @ free), bodies.inverse - solved @ response.T, -solved @ g)


def _compiled(equations: Equations, loops: Constraints) -> Any:
    """heyoka's function of q for g and B."""

    def build() -> Any:
        module = heyoka()
        xp, mech = Expressions(module), mechanism(equations.robot.model)
        q = np.array([module.expression(f"x{i}") for i in range(equations.space.nq)], dtype=object)
        gaps, rows = loops.residuals(mech, list(q), xp), loops.jacobian(mech, q, xp)
        values = [*(gaps[i] for i in loops.kept), *(entry for row in rows for entry in row)]
        return module.cfunc([xp.lift(value) for value in values], vars=list(q), **UNOPTIMIZED)

    return compiled_function(equations.key("loops"), build)[0]
