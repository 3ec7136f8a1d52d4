"""Modes: what is locked, slipping, in contact and dropped, and the equations in force in each mode."""

from __future__ import annotations

import copy
import math
import weakref
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from twolink.algorithms.namespaces import Numbers
from twolink.effects.switching import JointLock, Switching, Trigger
from twolink.geometry.features import Feature
from twolink.integrate.hybrid.snapshot import Evaluator, Snapshot
from twolink.integrate.motion.assembly import independent_rows
from twolink.integrate.motion.constraints import Constraints
from twolink.integrate.motion.effect_numbers import contact_slots
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.formulas import projected
from twolink.integrate.motion.scene_equations import make_equations, with_rows
from twolink.integrate.motion.state import Array

SLOW_SLIP = 1e-9  # m/s: the slowest slip whose direction is followed, at least
ContactMode = Literal["free", "sliding", "rolling"]


@dataclass(frozen=True)
class Mode:
    """A mode of the switching effects. At first nothing is locked or in contact: forces decide what is at rest.

    contacts: the mode of each contact. directions: of each, the direction along its tangents in which it began to
    slide. locked: degrees of freedom at rest. slip: the direction of slip of those with friction. dropped and
    waiting: places of effects that act no more, and not yet.
    """

    contacts: tuple[ContactMode, ...] = ()
    directions: tuple[tuple[float, float], ...] = ()
    locked: frozenset[int] = frozenset()
    slip: Mapping[int, float] = field(default_factory=dict)
    dropped: frozenset[int] = frozenset()
    waiting: frozenset[int] = frozenset()

    @property
    def idle(self) -> frozenset[int]:
        """The places of effects that do not act."""
        return self.dropped | self.waiting

    def with_contacts(self, kept: Sequence[int], more: int = 0) -> Mode:
        """The mode with the contacts of these numbers alone, and some more free ones behind them."""
        free: list[ContactMode] = ["free"] * more
        return replace(self, contacts=(*(self.contacts[i] for i in kept), *free),
                       directions=(*(self.directions[i] for i in kept), *((0.0, 0.0),) * more))  # fmt: skip

    def with_contact(self, i: int, mode: ContactMode, direction: tuple[float, float] | None = None) -> Mode:
        """The mode with another one of contact i."""
        directions = self.directions
        if mode == self.contacts[i] and direction in (None, directions[i]):
            return self
        if direction is not None:
            directions = (*directions[:i], direction, *directions[i + 1 :])
        return replace(self, contacts=(*self.contacts[:i], mode, *self.contacts[i + 1 :]), directions=directions)

    def locking(self, k: int) -> Mode:
        """The mode with degree of freedom k locked at rest."""
        return replace(self, locked=self.locked | {k})

    def freeing(self, k: int, slip: float) -> Mode:
        """The mode with degree of freedom k free to slip in a direction; 0: none."""
        if k not in self.locked and self.slip.get(k) == slip:
            return self
        return replace(self, locked=self.locked - {k}, slip={**self.slip, k: slip})


@dataclass(frozen=True, eq=False)
class ModeEquations:
    """The equations in the modes that agree on contacts and on which effects act.

    rows: of each closed contact, where its rows are among the kept constraint rows; None for a redundant one.
    """

    equations: Equations
    evaluate: Evaluator
    rows: Mapping[int, tuple[int | None, ...]]

    @property
    def redundant(self) -> bool:
        """True if the closed contacts have more rows than determine their forces."""
        return any(None in rows for rows in self.rows.values())

    def contact_forces(self, snapshot: Snapshot, i: int) -> Array:
        """The multipliers of a closed contact: normal, and if it rolls along the tangents, (1 or 3, n)."""
        zero = np.zeros(len(snapshot.t))
        return np.array([zero if row is None else snapshot.multipliers[row] for row in self.rows[i]])

    def largest_load(self, snapshot: Snapshot) -> float:
        """The largest torque that effects, friction and inertia give a joint, by which forces are judged."""
        friction = snapshot.x[len(snapshot.x) - len(self.equations.layout.lockable) :]  # tau has it as a sum
        return float(np.abs(np.concatenate([snapshot.tau, snapshot.bias, friction])).max(initial=0.0))


_kept: weakref.WeakKeyDictionary[Switching, dict[object, ModeEquations]] = weakref.WeakKeyDictionary()


class System:
    """Declarations of a scene for its modes, and the equations of each mode, made when it is met.

    slow: the direction of slower slips is not followed, m/s.
    """

    def __init__(self, equations: Equations, slow: float = SLOW_SLIP, *, traced: bool = True) -> None:
        self.whole, self.slow, self.traced = equations, slow, traced
        self.switching = equations.switching or Switching(equations.robot, equations.robot)
        self.nq = equations.space.nq
        self.robot = self.switching.robot
        self.lockable = equations.layout.lockable
        self.stops = self.switching.stops
        self.pairs = tuple(pair for _, pair in self.switching.pairs)
        self._have(())
        limits = [(-1, Trigger("limit", name)) for _, name in equations.effort_limits]
        self.triggers = (*self.switching.triggers, *limits)
        self.names = {joint.v.start: joint.name for joint in self.robot.joints}
        self._locks: dict[int, list[JointLock]] = {k: [] for k in self.lockable}
        for _, lock in self.switching.locks:
            self._locks[lock.dof].append(lock)
        self.kinetic = {k: sum(lock.kinetic for lock in locks) for k, locks in self._locks.items()}
        self.has_friction = {k for k, locks in self._locks.items() if any(lock.entry is None for lock in locks)}
        self.held: Mapping[str, float] = {}  # numbers by name, which controllers change at ticks
        self._seen: tuple[object, Snapshot] | None = None
        self._modes: dict[object, ModeEquations] = (
            {} if equations.switching is None else _kept.setdefault(equations.switching, {})
        )

    def having(self, features: Sequence[tuple[int, Feature]]) -> System:
        """The system with these features as contacts behind those that it always has, each with its pair's number."""
        other = copy.copy(self)
        other._have(features)
        other._seen = None
        return other

    def _have(self, features: Sequence[tuple[int, Feature]]) -> None:
        """Take what are contacts, and the places of their effects."""
        own = [(self.switching.pairs[pair][0], self.pairs[pair].point(one.gap)) for pair, one in features]
        every = (*self.switching.contacts, *own)
        self.features, self.places = tuple(features), tuple(place for place, _ in every)
        self.contacts = tuple(contact for _, contact in every)

    def with_held(self, held: Mapping[str, float]) -> System:
        """The system with other held numbers, from now on."""
        other = copy.copy(self)
        other.held, other._seen = held, None
        return other

    def every_lock(self, k: int) -> list[JointLock]:
        """Locks of a degree of freedom, at any position."""
        return self._locks[k]

    def static(self, k: int) -> float:
        """The static friction of a degree of freedom, N m or N."""
        return sum(lock.greatest for lock in self._locks[k] if lock.entry is None)

    def locks(self, k: int, x: Array) -> list[JointLock]:
        """Locks of a degree of freedom that can act at its position."""
        return [lock for lock in self._locks[k] if lock.acts(x)]

    def torque_range(self, k: int, x: Array) -> tuple[float, float]:
        """The torques (least, greatest) that can lock a degree of freedom where it is."""
        locks = self.locks(k, x)
        return sum(lock.least for lock in locks), sum(lock.greatest for lock in locks)

    def in_mode(self, mode: Mode, x: Array) -> ModeEquations:
        """The equations of a mode; independent constraint rows are chosen at the state x that meets them first."""
        name = mode.contacts, mode.idle, tuple((pair, one.gap) for pair, one in self.features)
        if name not in self._modes:
            self._modes[name] = self._made(mode, x)
        own = self._modes[name]
        if not (own.rows and mode.locked):
            return own
        if (*name, mode.locked) not in self._modes:
            self._modes[*name, mode.locked] = self._under_locks(own, mode, x)
        return self._modes[*name, mode.locked]

    def evaluate(self, state: ModeState) -> Snapshot:
        """The snapshot of a state; kept until the next one, for the same state is looked at more than once."""
        key = state.mode, state.t, state.x.tobytes()
        if self._seen is None or self._seen[0] != key:
            self._seen = key, state.own.evaluate(np.array([state.t]), state.full_state()[:, None])
        return self._seen[1]

    def _under_locks(self, own: ModeEquations, mode: Mode, x: Array) -> ModeEquations:
        """The equations without the rows of contacts that joints which are held make redundant."""
        equations, constraints = own.equations, own.equations.constraints
        if constraints is None:
            return own
        free = np.array([k not in mode.locked for k in range(self.robot.nv)], dtype=float)
        kept = independent_rows(constraints, x[: self.nq], free)
        if len(kept) == len(constraints.kept):
            return own
        return self._with_evaluator(with_rows(equations, constraints, kept), mode)

    def _made(self, mode: Mode, x: Array) -> ModeEquations:
        closed = {i: self.contacts[i].constraint(kind == "rolling", contact_slots(i))
                  for i, kind in enumerate(mode.contacts) if kind != "free"}  # fmt: skip
        equations = replace(self.whole, switching=None)  # what is kept must not keep the scene's declarations alive
        if closed or mode.idle:
            placed = [(self.places[i], loop) for i, loop in closed.items()]
            acting = self.switching.acting(mode.idle, placed)
            q = self.robot.normalize(x[None, : self.nq])[0]
            robot = self.switching.robot_with([effect for _, effect in acting])
            space = self.whole.space
            states = dict(zip(space.states, x[space.z_rows].tolist(), strict=True))
            equations = make_equations(robot, q, x[space.v_rows], acting, self.lockable, states=states)
        return self._with_evaluator(equations, mode)

    def _with_evaluator(self, equations: Equations, mode: Mode) -> ModeEquations:
        closed = [i for i, kind in enumerate(mode.contacts) if kind != "free"]
        rows = {} if equations.constraints is None else contact_places(equations.constraints, closed)
        redundant = any(None in own for own in rows.values())
        evaluator = Evaluator(equations, self.contacts, self.switching.conditions, traced=self.traced,
                              columns_of=len(closed) if redundant else 0)  # fmt: skip
        return ModeEquations(equations, evaluator, rows)


def contact_places(constraints: Constraints, contacts: Sequence[int]) -> dict[int, tuple[int | None, ...]]:
    """Of contacts, whose loops are the last ones, the places of their rows among the kept ones; None: redundant."""
    ends = np.cumsum(constraints.counts)
    rows: dict[int, tuple[int | None, ...]] = {}
    for place, i in zip(range(len(ends) - len(contacts), len(ends)), contacts, strict=True):
        own = range(ends[place] - constraints.counts[place], ends[place])
        rows[i] = tuple(constraints.kept.index(r) if r in constraints.kept else None for r in own)
    return rows


class ModeState:
    """A state x = (q, v, z) of a system in a mode at time t."""

    def __init__(self, system: System, mode: Mode, x: Array, t: float) -> None:
        self.system, self.mode, self.x, self.t = system, mode, x, t

    @property
    def own(self) -> ModeEquations:
        """The equations of the mode."""
        return self.system.in_mode(self.mode, self.x)

    @property
    def v(self) -> Array:
        """The velocities."""
        return self.x[self.system.whole.space.v_rows]

    def full_state(self, t: float | None = None) -> Array:
        """x with the numbers of the segment behind it, (size,). t: a time within it, by default the present."""
        system, mode, layout = self.system, self.mode, self.own.equations.layout
        locks = [1.0 if k in mode.locked else 0.0 for k in system.lockable]
        friction = [0.0 if k in mode.locked else -mode.slip.get(k, 0.0) * system.kinetic[k] for k in system.lockable]
        closed = {slot.name: system.slow * value for i, kind in enumerate(mode.contacts) if kind != "free"
                  for slot, value in zip(contact_slots(i), mode.directions[i], strict=True)}  # fmt: skip
        slots, rest = {**system.held, **closed}, np.array(locks + friction)
        numbers = layout.numbers_at(self.t if t is None else t, slots, rest)
        return np.concatenate([self.x, numbers])

    def closed(self) -> Array:
        """x back on its manifold, with loops and contacts closed, and without slips of what sticks."""
        return np.asarray(projected(self.own.equations, self.full_state(), Numbers)[: len(self.x)])

    def evaluate(self) -> Snapshot:
        """Its snapshot."""
        return self.system.evaluate(self)

    def in_mode(self, mode: Mode, x: Array | None = None) -> ModeState:
        """The state in another mode, or another state x of it, of the same system at the same time."""
        return ModeState(self.system, mode, self.x if x is None else x, self.t)


def freed(state: ModeState, k: int, torque: float) -> Mode:
    """The mode with a joint freed that this torque would lock: it slips where the load drives it."""
    if k not in state.system.has_friction:
        return state.mode.freeing(k, 0.0)
    return state.mode.freeing(k, 1.0 if torque < state.system.torque_range(k, state.x)[0] or torque < 0.0 else -1.0)


def sliding(mode: Mode, i: int, forces: Array) -> Mode:
    """The mode with contact i sliding against the force (normal, two tangential) that would stop it."""
    size = math.hypot(forces[1], forces[2])
    return mode.with_contact(i, "sliding", (float(-forces[1] / size), float(-forces[2] / size)))
