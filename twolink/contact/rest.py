"""Bodies at rest: one step's impulses are those of the next ones while nothing that acts on the bodies changes.

    v = 0,   J v = 0 has no other solution,   tau - h the same as before

J: the rows of all contacts that stick. These then hold every body where it is: no motion is possible without a slip,
and the impulses, which balance the same forces, obey the same laws. So a state at rest is solved for once, and a step
costs one look at the forces, or nothing where none depends on time. Any change of them, to the last bit, ends the rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, overload

import numpy as np
import scipy.sparse as sparse

from twolink.contact.bodies import Multibody
from twolink.contact.impulses import EXACT, factors
from twolink.contact.steps import Memory, Plan, Step
from twolink.integrate.motion.state import Array

DETERMINED = 1e-9  # of the largest: smaller pivots of J^T J are those of motions that the rows leave free


@dataclass(frozen=True)
class Rest(Sequence[Step]):
    """Steps of lengths h (n,), each as one that began and ended at rest."""

    one: Step
    h: Array

    def __len__(self) -> int:
        return len(self.h)

    @overload
    def __getitem__(self, j: int) -> Step: ...
    @overload
    def __getitem__(self, j: slice) -> Sequence[Step]: ...
    def __getitem__(self, j: Any) -> Any:
        """The step j."""
        share = float(self.h[j]) / self.one.h
        joints = None if self.one.joints is None else share * self.one.joints
        return replace(self.one, h=float(self.h[j]), on_first=share * self.one.on_first, joints=joints)


class Resting:
    """Whether bodies are at rest. one: the step at rest; forces (nv,): those that act then; None while bodies move."""

    def __init__(self, bodies: Multibody) -> None:
        self.bodies, self.forces = bodies, np.empty(0)
        self.one: Step | None = None

    def steps(self, plan: Plan, steps: range, q: Array) -> Rest | None:
        """Those of the steps up to the first in which other forces act; None for none."""
        if self.one is None:
            return None
        count = self._unchanged(plan, steps, q)
        if not count:
            self.one = None
            return None
        return Rest(self.one, plan.h[steps.start : steps.start + count])

    def found(self, plan: Plan, number: int, q: Array, v: Array, step: Step, memory: Memory, rows: Any) -> Step:
        """The step, or one at rest in place of one that moves less than the laws may be missed by.

        number: of the step in the plan. rows (m, nv): J of the points that press.
        """
        speed = max(np.abs(v).max(), np.abs(step.v).max())
        stays = step.impulses is not None and step.memory.stuck.all() and np.array_equal(step.memory.keys, memory.keys)
        if not stays or speed > EXACT or not _determined(rows):
            return step
        zero = np.zeros_like(v)
        passed = replace(step.memory, change=np.zeros_like(memory.change))
        self.one, self.forces = replace(step, q=q, v=zero, mean=zero, memory=passed), self._forces(plan, number, q)
        return self.one

    def _forces(self, plan: Plan, number: int, q: Array) -> Array:
        """tau - h in the middle of a step."""
        t, zero = float(plan.t[number] + 0.5 * plan.h[number]), np.zeros(self.bodies.model.nv)
        return self.bodies.forces(t, q, zero, plan.numbers[plan.piece[number]])

    def _unchanged(self, plan: Plan, steps: range, q: Array) -> int:
        """How many of the steps pass while the forces stay what they are."""
        if not self.bodies.equations.effects:
            return len(steps)
        changed = (k for k in steps if not np.array_equal(self._forces(plan, k, q), self.forces))
        return next(changed, steps.stop) - steps.start


def _determined(rows: Any) -> bool:
    """Whether J v = 0 has no solution but 0."""
    if not sparse.issparse(rows):
        return bool(np.linalg.matrix_rank(rows) == rows.shape[1])
    if not np.diff(rows.tocsc().indptr).all():  # a body that nothing touches
        return False
    try:
        pivots = np.abs(factors((rows.T @ rows).tocsc()).U.diagonal())
    except RuntimeError:  # exactly singular
        return False
    return bool(pivots.min() > DETERMINED * pivots.max())
