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


def at_rest(q: Array, v: Array, step: Step, memory: Memory, rows: Any) -> Step | None:
    """A step at rest in place of one that moves less than the laws may be missed by; None where bodies move.

    rows (m, nv): J of the points that press.
    """
    still = max(np.abs(v).max(), np.abs(step.v).max()) <= EXACT and bool(step.memory.stuck.all())
    if not (still and np.array_equal(step.memory.keys, memory.keys) and _determined(rows)):
        return None
    zero = np.zeros_like(v)
    passed = replace(step.memory, change=np.zeros_like(memory.change))
    return replace(step, q=q, v=zero, mean=zero, memory=passed)


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


def unchanged(bodies: Multibody, plan: Plan, steps: range, q: Array, forces: Array) -> int:
    """How many of the steps pass while the forces on bodies at rest stay what they are."""
    zero = np.zeros(bodies.model.nv)
    if not bodies.equations.effects:
        return len(steps)
    for k in steps:
        now = bodies.forces(float(plan.t[k] + 0.5 * plan.h[k]), q, zero, plan.numbers[plan.piece[k]])
        if not np.array_equal(now, forces):
            return k - steps.start
    return len(steps)
