"""Moment: what guards and laws see of a state, or of many at once: its motion, accelerations and forces."""

from __future__ import annotations

import functools

import numpy as np

from twolink.algorithms.namespaces import Numbers
from twolink.effects.motion import Motion
from twolink.integrate.constraints import Constraints
from twolink.integrate.equations import Equations
from twolink.integrate.hybrid.forces import Forces, forces
from twolink.integrate.state import Array


class Moment:
    """States x (size, n) at times t (n,) of equations in one mode."""

    def __init__(self, equations: Equations, t: Array, x: Array) -> None:
        self.equations, self.t, self.x = equations, t, x
        nq = equations.space.nq
        self.q, self.v = list(x[:nq]), list(x[nq : equations.moving])

    @functools.cached_property
    def motion(self) -> Motion:
        """The moving robot."""
        return Motion(self.equations.robot.model, self.equations.mechanism, self.q, self.v, self.t, Numbers)

    @functools.cached_property
    def forces(self) -> Forces:
        """Accelerations and forces."""
        return forces(self.equations, self.t, self.x)

    @property
    def largest_load(self) -> float:
        """The largest torque that effects, friction and inertia give a joint, N m or N, by which forces are judged."""
        friction = self.x[
            len(self.x) - len(self.equations.layout.lockable) :
        ]  # what balances it is in the loads, as a sum
        return float(max(np.abs(part).max(initial=0.0) for part in (self.forces.loads, friction)))

    @functools.cached_property
    def multipliers(self) -> dict[int, list[Array]]:
        """The multipliers of each loop's rows (n,), by the loop's id; 0 for rows that were dropped."""
        loops = self.equations.constraints
        if loops is None:
            return {}
        none = np.zeros(len(self.t))
        rows = by_loop(loops, list(self.forces.multipliers))
        return {id(loop): [none if row is None else row for row in own]
                for loop, own in zip(loops.loops, rows, strict=True)}  # fmt: skip

    def held(self, k: int) -> Array:
        """The torque of the lock on a degree of freedom (n,)."""
        return np.asarray(self.forces.held[self.equations.layout.lockable.index(k)])


def by_loop(constraints: Constraints, multipliers: list[Array]) -> list[list[Array | None]]:
    """The multipliers of the kept rows, loop by loop; None for rows that were dropped."""
    values = dict(zip(constraints.kept, multipliers, strict=True))
    ends = np.cumsum(constraints.counts)
    return [[values.get(i) for i in range(end - n, end)] for end, n in zip(ends, constraints.counts, strict=True)]
