"""Bodies at rest: one step's impulses are those of the next ones while nothing that acts on the bodies changes.

    v = 0,   J v = 0 has no other solution,   tau - h the same as before

J: the rows of all contacts that stick. These then hold every body where it is: no motion is possible without a slip,
and the impulses, which balance the same forces, obey the same laws. So a state at rest is solved for once, and a step
costs one look at the forces, or nothing where none depends on time. Any change of them, to the last bit, ends the rest.
The rest is part of the memory of its solution, with the state at which it is one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sparse

from twolink.contact.bodies import Multibody
from twolink.contact.impulses import EXACT, factors
from twolink.contact.steps import AtRest, Memory, Step, TakenSteps
from twolink.geometry.points import CLOSED
from twolink.integrate.motion.state import Array
from twolink.native.contact import StepPlan

DETERMINED = 1e-9  # of the largest: smaller pivots of J^T J are those of motions that the rows leave free


@dataclass(frozen=True)
class RestingSteps(TakenSteps):
    """Steps of lengths h (n,), each as one that began and ended at rest."""

    rest: AtRest
    h: Array

    def __len__(self) -> int:
        return len(self.h)

    def __getitem__(self, j: int) -> Step:
        """The step j."""
        one = self.rest.step
        share = float(self.h[j]) / one.h
        return replace(one, h=float(self.h[j]), on_first=share * one.on_first,
                       joints=None if one.joints is None else share * one.joints,
                       memory=one.memory._replace(rest=self.rest))  # fmt: skip


def steps_at_rest(bodies: Multibody, plan: StepPlan, steps: range, memory: Memory) -> RestingSteps | None:
    """The steps at rest up to the first in which other forces act; None where bodies move, or for none."""
    rest = memory.rest
    if rest is None:
        return None
    count = len(steps)
    if bodies.equations.effects:
        q = rest.step.q
        changed = (k for k in steps if not np.array_equal(_forces(bodies, plan, k, q), rest.forces))
        count = next(changed, steps.stop) - steps.start
    return RestingSteps(rest, plan.h[steps.start : steps.start + count]) if count else None


def at_rest(bodies: Multibody, plan: StepPlan, number: int, q: Array, v: Array, step: Step, memory: Memory) -> Step:
    """The step, or one at rest in place of one that moves less than the laws may be missed by.

    number: of the step in the plan, from (q, v) and the memory on.
    """
    speed = max(np.abs(v).max(), np.abs(step.v).max())
    stays = step.impulses is not None and step.memory.stuck.all() and np.array_equal(step.memory.keys, memory.keys)
    if not stays or speed > EXACT or np.abs(step.q - q).max() > CLOSED or not _determined(step.rows):
        return step  # gaps that close move what has no velocity
    zero = np.zeros_like(v)
    m = step.memory
    passed = Memory.of(m.keys, m.forces, m.stuck, m.still, np.zeros_like(m.change), m.overlap, m.unfollowed)
    return resting(bodies, plan, number, replace(step, q=q, v=zero, mean=zero, memory=passed, rows=None))


def resting(bodies: Multibody, plan: StepPlan, number: int, step: Step) -> Step:
    """A step at rest that remembers so, and the forces that act then. number: of the step in the plan."""
    rest = AtRest(step, _forces(bodies, plan, number, step.q))
    return replace(step, memory=step.memory._replace(rest=rest))


def _forces(bodies: Multibody, plan: StepPlan, number: int, q: Array) -> Array:
    """tau - h in the middle of a step."""
    t, zero = float(plan.t[number] + 0.5 * plan.h[number]), np.zeros(bodies.model.nv)
    return bodies.forces(t, q, zero, plan.numbers[plan.piece[number]])


def _determined(rows: Any) -> bool:
    """True if J v = 0 has no solution but 0."""
    if not sparse.issparse(rows):
        return bool(np.linalg.matrix_rank(rows) == rows.shape[1])
    if not np.diff(rows.tocsc().indptr).all():  # a body that nothing touches
        return False
    try:
        pivots = np.abs(factors((rows.T @ rows).tocsc()).U.diagonal())
    except RuntimeError:  # exactly singular
        return False
    return bool(pivots.min() > DETERMINED * pivots.max())
