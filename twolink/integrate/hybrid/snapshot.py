"""Snapshots: accelerations, forces and what guards look at, of states in one mode; and kinematics that laws look at.

    M a + h = tau + B lambda + lock torques

The formulas are written once: the machine runs them as a program, which is compared with NumPy before its first use.
"""

from __future__ import annotations

import functools
import hashlib
import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from twolink.algorithms.dual_numbers import Jet, JetNamespace, coefficient
from twolink.algorithms.mechanism import Mechanism, mechanism
from twolink.algorithms.motion import KinematicState
from twolink.algorithms.namespaces import Numbers
from twolink.algorithms.spatial import plus, times
from twolink.effects.switching import ContactPoint
from twolink.errors import CertificationError
from twolink.integrate.motion.constraints import Constraints
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.formulas import constraint_forces, dynamics, lock_torques, motion_of, state_rates
from twolink.integrate.motion.state import Array
from twolink.native.instructions import Assembled
from twolink.native.machine import Program, trace
from twolink.native.programs import program_named

if TYPE_CHECKING:
    from twolink.effects.conditions import Condition

AGREEMENT = 1e-8  # relative
NEARBY = 1e-3  # rad or m
FIELDS = ("a", "multipliers", "locks", "limits", "tau", "bias", "contacts", "conditions", "columns", "rates")
ROWS = 5  # of a contact: gap, its rate, slip along two tangents, the gap's acceleration


class Snapshot:
    """States x (size, n) at times t (n,), and of each: a (nv, n), the multipliers of the kept constraint rows, the
    torques of the locks on the lockable degrees of freedom, distances to limits of effort, tau and bias h (nv, n), the
    rows of each contact (contacts, 5, n), the conditions' distances, and the generalized forces of size 1 of
    the rows of loops and of closed contacts (rows nv, n), and z' of effects.

    All but t and x is evaluated when it is first looked at: many guards need no more than x.
    """

    def __init__(self, t: Array, x: Array, rows: Callable[[Array, Array], Array], parts: Mapping[str, slice]) -> None:
        self.t, self.x, self._evaluate, self._parts = t, x, rows, parts
        self._rows: Array | None = None

    @property
    def rows(self) -> Array:
        """Every row that is evaluated, (m, n)."""
        if self._rows is None:
            self._rows = self._evaluate(self.t, self.x)
        return self._rows

    def chosen(self, which: Array) -> Snapshot:
        """The snapshot of some of the states."""
        return Snapshot(self.t[which], self.x[:, which], lambda *_: self.rows[:, which], self._parts)

    def __getattr__(self, name: str) -> Array:
        if name not in FIELDS:
            raise AttributeError(name)
        rows = self.rows[self._parts[name]]
        return rows.reshape(-1, ROWS, self.x.shape[1]) if name == "contacts" else rows


class StateFormulas:
    """Formulas of states x (size, n) of one mode at times t (n,). The start of its equations plays no part.

    content: what the formulas hold beside the equations. traced: they run as a program, for modes that are looked at
    more than a few times; else by NumPy.
    """

    kind = "formulas"

    def __init__(self, equations: Equations, content: str, *, traced: bool) -> None:
        self.equations, self._traced = equations, traced
        self._content = hashlib.sha256(content.encode()).hexdigest()[:16]

    def formulas(self, mech: Mechanism, t: Any, x: Any, xp: Any) -> list[Any]:
        """Every row."""
        raise NotImplementedError

    def rows(self, t: Array, x: Array) -> Array:
        """Every row at the states (m, n)."""
        return (self._by_program if self._traced else self._by_numpy)(t, x)

    @functools.cached_property
    def _program(self) -> Program:
        return program_named(self.equations.key(self.kind, self._content), self._trace, self._compare)

    def _trace(self) -> Assembled:
        """The formulas as a program of (t, x)."""
        mech = mechanism(self.equations.robot.model)
        return trace(lambda z, xp: self.formulas(mech, z[0], z[1:], xp), 1 + self.equations.space.size)

    def _by_program(self, t: Array, x: Array) -> Array:
        rows = np.empty((1 + len(x), x.shape[1]))
        rows[0], rows[1:] = t, x
        return self._program(rows[:, 0])[:, None] if len(t) == 1 else self._program(rows)  # one takes less time so

    def _by_numpy(self, t: Array, x: Array) -> Array:
        with np.errstate(all="ignore"):
            values = self.formulas(self.equations.mechanism, t, x, Numbers)
        shape = x.shape[1:]
        return np.array([np.broadcast_to(np.asarray(value, dtype=float), shape) for value in values]).reshape(
            -1, *shape
        )

    def _compare(self, program: Program) -> None:
        """Compare a program with NumPy at a state. Raises CertificationError."""
        equations = self.equations
        state, nq = np.array(equations.start[:, None]), equations.space.nq
        # Not quite there and not at rest: the lowest point of a disc that lies flat and the direction of sliding at
        # rest are rounding, which differs.
        apart = np.random.default_rng(1).uniform(0.5, 1.5, (2, equations.space.nv))
        state[:nq, 0] = pin.integrate(equations.robot.model, state[:nq, 0], NEARBY * apart[0])
        state[equations.space.v_rows, 0] += apart[1]
        theirs, ours = self._by_numpy(np.zeros(1), state), program(np.concatenate([np.zeros((1, 1)), state]))
        finite = np.isfinite(theirs)
        off = np.abs(ours - theirs)[finite].max(initial=0.0) / (1.0 + np.abs(theirs[finite]).max(initial=0.0))
        if not (off <= AGREEMENT and np.array_equal(finite, np.isfinite(ours))):
            raise CertificationError(f"the program of the {self.kind} differs from NumPy's by {off:.1e}",
                                     where="events", remedy="report it with the URDF")  # fmt: skip


class Evaluator(StateFormulas):
    """Evaluates snapshots of one mode.

    columns_of: so many closed contacts, whose constraints are the last ones, of which the columns are evaluated.
    """

    kind = "snapshot"

    def __init__(
        self,
        equations: Equations,
        contacts: Sequence[ContactPoint] = (),
        conditions: Sequence[Condition] = (),
        *,
        traced: bool = False,
        columns_of: int = 0,
    ) -> None:
        self.contacts, self.conditions = tuple(contacts), tuple(conditions)
        constraints, nv = equations.constraints, equations.space.nv
        kept = 0 if constraints is None else len(constraints.kept)
        self._columns = () if constraints is None or not columns_of else _force_rows(constraints, columns_of)
        sizes = [nv, kept, len(equations.layout.lockable), len(equations.effort_limits), nv, nv,
                 ROWS * len(contacts), len(conditions), len(self._columns) * nv,
                 len(equations.space.states)]  # fmt: skip
        ends = np.cumsum([0, *sizes]).tolist()
        self._parts = dict(zip(FIELDS, itertools.starmap(slice, itertools.pairwise(ends)), strict=True))
        content = repr([contact.content for contact in self.contacts]) + repr((self.conditions, self._columns))
        super().__init__(equations, content, traced=traced)

    def __call__(self, t: Array, x: Array) -> Snapshot:
        return Snapshot(t, x, self.rows, self._parts)

    def by_numpy(self, t: Array, x: Array) -> Snapshot:
        """The snapshot of the formulas evaluated by NumPy."""
        return Snapshot(t, x, self._by_numpy, self._parts)

    def formulas(self, mech: Mechanism, t: Any, x: Any, xp: Any) -> list[Any]:
        """Every row of a snapshot."""
        solution = dynamics(self.equations, mech, t, x, xp)
        locks, bias = lock_torques(self.equations, mech, t, x, xp, solution)
        motion = motion_of(self.equations, mech, t, x, xp)
        contacts = [row for contact in self.contacts for row in self._contact_rows(contact, motion, x, solution.a)]
        conditions = [condition.distance(motion) for condition in self.conditions]
        limits = [distance for _, distance in solution.loads.limits]
        return [*solution.a, *solution.multipliers, *locks, *limits, *solution.loads.tau, *bias, *contacts, *conditions,
                *self._contact_columns(mech, x, xp), *state_rates(self.equations, solution.loads)]  # fmt: skip

    def _contact_columns(self, mech: Mechanism, x: Any, xp: Any) -> list[Any]:
        """The generalized forces of the rows of loops and closed contacts, one row after the other."""
        equations, constraints = self.equations, self.equations.constraints
        if constraints is None or not self._columns:
            return []
        every = replace(constraints, kept=self._columns, shares=None)
        rows = constraint_forces(replace(equations, constraints=every), mech, x, xp)
        return list(itertools.chain.from_iterable(rows))

    def _contact_rows(self, contact: ContactPoint, motion: KinematicState, x: Any, a: Sequence[Any]) -> list[Any]:
        """The gap, its rate and slip, and its acceleration: the rate's derivative along the motion."""
        space = self.equations.space
        changes = zip((*motion.q, *motion.v), (*space.rate(x[: space.nq], x[space.v_rows]), *a), strict=True)
        jets = [Jet(pair) for pair in changes]
        moving = KinematicState(
            motion.model, motion.mech, jets[: space.nq], jets[space.nq :], motion.t, JetNamespace(motion.xp)
        )
        acceleration = coefficient(contact.velocity(moving)[0], 1)
        return [contact.gap(motion), *contact.velocity(motion), acceleration]


class Kinematics(StateFormulas):
    """Evaluates gaps of contacts (n), residuals of all rows of constraints, and rates and powers of the kept ones.

    A power is that of a multiplier of size 1.
    """

    kind = "kinematics"

    def __init__(self, equations: Equations, contacts: Sequence[ContactPoint]) -> None:
        self._contacts = tuple(contacts)
        super().__init__(equations, repr([contact.content for contact in contacts]), traced=True)

    def __call__(self, t: Array, x: Array) -> list[Array]:
        constraints = self.equations.constraints
        rows, kept = (0, 0) if constraints is None else (len(constraints.all_rows), len(constraints.kept))
        return np.split(self.rows(t, x), np.cumsum([len(self._contacts), rows, kept]))

    def formulas(self, mech: Mechanism, t: Any, x: Any, xp: Any) -> list[Any]:
        """Every row."""
        equations, constraints = self.equations, self.equations.constraints
        motion = motion_of(equations, mech, t, x, xp)
        gaps = [contact.gap(motion) for contact in self._contacts]
        if constraints is None:
            return gaps
        q, v = x[: equations.space.nq], x[equations.space.v_rows]
        forces = constraint_forces(equations, mech, x, xp)
        powers = [plus(*(times(force, rate) for force, rate in zip(row, v, strict=True))) for row in forces]
        return [*gaps, *constraints.residuals(mech, list(q), xp), *constraints.velocities(mech, q, v, xp), *powers]


def _force_rows(constraints: Constraints, contacts: int) -> tuple[int, ...]:
    """The kept rows of loops, and all rows of the closed contacts, which are the last."""
    rows = constraints.all_rows
    first = len(rows) - sum(constraints.counts[-contacts:])
    return (*(i for i in constraints.kept if i < first), *rows[first:])
