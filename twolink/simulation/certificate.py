"""Certificate: the laws of stops, contacts, friction, loops and impacts, checked along a run that has been solved.

    stops, gaps     side (q - position) >= 0,  g >= 0
    constraints     g(q) = 0 and J v = 0 of loops and of contacts that are closed, v = 0 of joints that are held
    forces          stops and contacts press, |T| <= mu N, a hold gives no more than it can
    friction        tau v <= 0 and lambda B^T v <= 0: it takes power, and all that a joint that slips has
    mode starts     what touches does not begin to approach, and a joint slips against its friction
    impacts         they add no kinetic energy

Only what the scene declares and the states are used, none of the decisions of the engine that made the run. By the last
three laws nothing but actuators and gravity adds energy, for the equations of motion are smooth between events.
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np

from twolink.algorithms.namespaces import Numbers
from twolink.effects.switching import ContactPoint, Switching
from twolink.errors import AccuracyError
from twolink.integrate.hybrid.contact_problem import shared_limits
from twolink.integrate.hybrid.force_share import Support, margins
from twolink.integrate.hybrid.snapshot import Evaluator, Kinematics, Snapshot
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.formulas import motion_of
from twolink.integrate.motion.state import Array
from twolink.integrate.solution import Segment, Solution
from twolink.simulation.text import BaseResult

POSITION = 1e-9  # m or rad, and per second relative to the velocities: what counts as 0
RELATIVE = 1e-6  # of forces, powers, accelerations and energies to the largest at that time
TOUCHES = 1e-12  # m or rad: at the start of a mode
LEAST_LOAD = 1e-3  # N or N m by kg of the robot: less, where loads cancel, is no scale
CHUNK = 4096  # states that are looked at together
UNITS = {"stops": "rad or m", "gaps": "m", "constraints": "rad or m"}  # of the others: relative
Broken = Iterator[tuple[str, Array]]  # laws, and by how much states (n,) break them; below 0: they keep them


@dataclass(frozen=True)
class Law:
    """A law and the most that a state of the run breaks it, with the time [s] of that; 0: all keep it.

    worst, limit: in rad or m for "stops", "gaps" and "constraints", relative to the largest load for others.
    """

    law: str
    worst: float
    limit: float
    when: float

    def __str__(self) -> str:
        unit = UNITS.get(self.law, "relative")
        where = f", at {self.when:.6g} s" if self.worst else ""
        return f"{self.law:<12} broken by {self.worst:.1e} at most ({unit}; allowed {self.limit:.0e}){where}"


@dataclass(frozen=True, repr=False)
class Certificate(BaseResult):
    """The laws that a run was checked for, at so many states: samples, and the starts of modes."""

    laws: tuple[Law, ...]
    states: int

    def __repr__(self) -> str:
        return "\n".join([f"laws checked at {self.states} states", *(f"  {law}" for law in self.laws)])

    def require(self, run: Any = None) -> None:
        """Raise AccuracyError (code "laws-violated", with data law, t [s] and size) for a law that is broken."""
        broken = [law for law in self.laws if not law.worst <= law.limit]
        if broken:
            first = min(broken, key=lambda law: law.when)
            raise AccuracyError(f"the run breaks a law: {first}", where=f"t = {first.when:.9g} s",
                                remedy='report this scene; or contact="stepped", or smooth friction and springs',
                                code="laws-violated", law=first.law, t=first.when, size=first.worst,
                                run=run)  # fmt: skip


@dataclass(frozen=True)
class _States:
    """States x (size, n) at times t (n,) of segments with the same equations but for numbers.

    lasts: how long a mode lasts that starts there, s; 0 elsewhere.
    """

    switching: Switching
    equations: Equations
    t: Array
    x: Array
    lasts: Array

    def chosen(self, which: Array) -> "_States":
        """Some of them."""
        return _States(self.switching, self.equations, self.t[which], self.x[:, which], self.lasts[which])

    @property
    def v(self) -> Array:
        """The velocities (nv, n)."""
        return self.x[self.equations.space.v_rows]

    @property
    def speed(self) -> Array:
        """The scale of the velocities (n,)."""
        return 1.0 + np.asarray(np.abs(self.v).max(axis=0, initial=0.0))

    @property
    def locks(self) -> tuple[Array, Array]:
        """Of each lockable degree of freedom, whether it is locked and its friction torque, (lockable, n) each."""
        count = len(self.equations.layout.lockable)
        numbers = self.x[len(self.x) - 2 * count :]
        return numbers[:count] > 0.5, numbers[count:]


def certificate(switching: Switching, solution: Solution) -> Certificate:
    """The certificate of a solution with events, from its samples and the starts of its modes."""
    worst: dict[str, tuple[float, float]] = {}
    count = 0
    for states in _states(switching, solution):
        count += len(states.t)
        for law, broken, t in _laws(states):
            _take(worst, law, broken, t)
    for law, broken, t in _impacts(switching, solution.segments):
        _take(worst, law, broken, t)
    laws = [Law(law, size, POSITION if law in UNITS else RELATIVE, t) for law, (size, t) in worst.items()]
    return Certificate(tuple(laws), count)


def _take(worst: dict[str, tuple[float, float]], law: str, broken: Array, t: Array) -> None:
    """Note the largest of values; one that is no number is the largest of all."""
    sizes = np.maximum(np.asarray(broken, dtype=float), 0.0)
    sizes[np.isnan(sizes)] = math.inf
    if sizes.size and sizes.max() > worst.setdefault(law, (0.0, 0.0))[0]:
        i = int(np.argmax(sizes))
        worst[law] = float(sizes[i]), float(t[i])


def _states(switching: Switching, solution: Solution) -> Iterator[_States]:
    """The samples of each segment, where its steps end, and its start, those of equal equations together."""
    forms: dict[tuple[int, ...], list[_States]] = {}
    first = 0
    ends = [*(segment.begin for segment in solution.segments[1:]), float(solution.t[-1])]
    for segment, end in zip(solution.segments, ends, strict=True):
        own, moving = segment.equations, segment.equations.moving
        inside = slice(first, first + segment.samples)
        first += segment.samples
        t, at = solution.t[inside], solution.x[:moving, inside]
        if segment.taken is not None:
            within = (segment.taken[0] > segment.begin) & (segment.taken[0] < end)
            t, at = np.append(t, segment.taken[0][within]), np.concatenate([at, segment.taken[1][within].T], axis=1)
        first_state = np.asarray(own.start, dtype=float)[:, None]
        x = np.append(first_state, np.concatenate([at, segment.numbers(t)]), axis=1)
        lasts = np.zeros(1 + len(t))
        lasts[0] = end - segment.begin
        key = id(own.robot), id(own.effects), id(own.constraints)
        every = forms.setdefault(key, [])
        every.append(_States(switching, own, np.append(segment.begin, t), x, lasts))
    for every in forms.values():
        t, lasts = np.concatenate([s.t for s in every]), np.concatenate([s.lasts for s in every])
        x = np.concatenate([s.x for s in every], axis=1)
        for k in range(0, len(t), CHUNK):
            part = slice(k, k + CHUNK)
            yield _States(switching, every[0].equations, t[part], x[:, part], lasts[part])


@np.errstate(all="ignore")
def _laws(states: _States) -> Iterator[tuple[str, Array, Array]]:
    """All laws but that of impacts: by how much states break them, and their times."""
    contacts = [contact for _, contact in states.switching.contacts]
    *positions, powers = Kinematics(states.equations, contacts)(states.t, states.x)
    for law, broken in _positions(states, *positions):
        yield law, broken, states.t
    locked, friction = states.locks
    forced = locked.any(axis=0) | (friction != 0.0).any(axis=0) | (states.lasts > 0.0)
    states = states.chosen(forced | (states.equations.constraints is not None))  # with constraints all: powers fit
    if not len(states.t):
        return
    look = _snapshot(states, contacts)
    load = np.abs(np.concatenate([look.tau, look.bias, states.locks[1]])).max(axis=0)
    load = np.maximum(load, LEAST_LOAD * sum(inertia.mass for inertia in states.equations.robot.model.inertias))
    for law, broken in itertools.chain(
        _joint_forces(states, look, load), _constraint_forces(states, look, load, powers)
    ):
        yield law, broken, states.t
    begin = states.lasts > 0.0
    starts = states.chosen(begin)
    for law, broken in _starts(starts, look.a[:, begin], look.contacts[..., begin]):
        yield law, broken, starts.t


def _snapshot(states: _States, contacts: Sequence[ContactPoint]) -> Snapshot:
    """Forces and accelerations, by the program that looks for events in this mode where there is one."""
    constraints = states.equations.constraints
    closed = 0 if constraints is None or not _redundant(states.equations) else len(constraints.touching)
    conditions = states.switching.conditions
    return Evaluator(states.equations, contacts, conditions, traced=True, columns_of=closed)(states.t, states.x)


def _positions(states: _States, gaps: Array, residuals: Array, rates: Array) -> Broken:
    """Stops, gaps, loops and closed contacts, and joints that are held."""
    switching, equations, x = states.switching, states.equations, states.x
    for stop in switching.stops:
        yield "stops", -stop.side * (x[stop.entry] - stop.position)
    for gap in gaps:
        yield "gaps", -gap
    if switching.pairs:
        motion = motion_of(equations, equations.mechanism, states.t, x, Numbers)
        for _, pair in switching.pairs:
            yield "gaps", -pair.gaps(motion, ())
    for k, rests in zip(equations.layout.lockable, states.locks[0], strict=True):
        yield "constraints", np.where(rests, np.abs(states.v[k]) / states.speed, 0.0)
    for residual in residuals:
        yield "constraints", np.abs(residual)
    for rate in rates:
        yield "constraints", np.abs(rate) / states.speed


def _joint_forces(states: _States, look: Snapshot, load: Array) -> Broken:
    """Torques of locks within what they can give; all of the friction of what slips, against it."""
    for k, locked, friction, torque in zip(states.equations.layout.lockable, *states.locks, look.locks, strict=True):
        least, greatest = _limits(states, k)
        alone = locked & (not _redundant(states.equations))
        for i in np.flatnonzero(alone & ((torque > greatest) | (torque < least))):
            least[i], greatest[i] = _with_others(states, int(i))[k]
        yield "forces", np.where(alone, np.maximum(torque - greatest, least - torque) / load, 0.0)
        kinetic, v = sum(lock.kinetic for _, lock in states.switching.locks if lock.dof == k), states.v[k]
        slips = ~locked & (np.abs(v) > RELATIVE * states.speed)
        yield "friction", np.where(slips, np.abs(friction + kinetic * np.sign(v)) / load, 0.0)


def _constraint_forces(states: _States, look: Snapshot, load: Array, powers: Array) -> Broken:
    """Contacts that press, with friction within its cone; loops and contacts add no power."""
    equations, constraints = states.equations, states.equations.constraints
    if constraints is None:
        return
    yield "friction", (look.multipliers * powers).sum(axis=0) / (load * states.speed)
    closed = [_with_static(states.switching, loop) for loop in constraints.touching]
    if not closed:
        return
    every = constraints.all_multipliers(look.multipliers)
    scale = np.maximum(load, np.abs(every).max(axis=0))
    if _redundant(equations):
        yield "forces", -_margins(states, look, closed) / scale
        return
    ends = np.cumsum(constraints.counts)[-len(closed) :]
    for loop, end, count in zip(closed, ends, constraints.counts[-len(closed) :], strict=True):
        normal, *across = every[end - count : end]
        yield "forces", -normal / scale
        if loop.rolling:
            yield "forces", (np.hypot(*across) - loop.friction * normal) / scale


def _redundant(equations: Equations) -> bool:
    """True if contacts have more rows than determine their forces: then they share them with what locks joints."""
    constraints = equations.constraints
    return constraints is not None and len(constraints.kept) < len(constraints.all_rows) and bool(constraints.touching)


def _margins(states: _States, look: Snapshot, closed: Sequence[Any]) -> Array:
    """Margins of the best share of the forces of contacts, and of what locks joints, within the laws (n,)."""
    out, locked = np.empty(len(states.t)), states.locks[0]
    for pattern in np.unique(locked, axis=1).T:
        these = np.flatnonzero((locked == pattern[:, None]).all(axis=0))
        supports = [Support(i, k, *(float(limit[these[0]]) for limit in _limits(states, k)))
                for i, k in enumerate(states.equations.layout.lockable) if pattern[i]]  # fmt: skip
        out[these] = margins(states.equations, closed, look.chosen(these), supports)
    return out


def _limits(states: _States, k: int) -> tuple[Array, Array]:
    """The least and the greatest torque (n,) that can lock joint k where it is."""
    locks = [lock for _, lock in states.switching.locks if lock.dof == k]
    near = [np.abs(states.x[h.entry] - h.position) <= POSITION if h.entry is not None else True for h in locks]
    least, greatest = (sum((np.where(at, limit, 0.0) for at, limit in zip(near, limits, strict=True)),
                           np.zeros(len(states.t)))
                       for limits in ([h.least for h in locks], [h.greatest for h in locks]))  # fmt: skip
    return least, greatest


def _with_others(states: _States, i: int) -> dict[int, tuple[float, float]]:
    """The torques (least, greatest) that can lock each joint that is locked in state i, with those of joints beside it.

    Loops may let other joints at rest, whose locks are redundant then, hold what one holds.
    """
    (locked, friction), lockable = states.locks, np.array(states.equations.layout.lockable)
    resting = lockable[locked[:, i] | (friction[:, i] == 0.0)].tolist()
    limits = {k: (float(least[i]), float(greatest[i])) for k in resting for least, greatest in [_limits(states, k)]}
    constraints, q = states.equations.constraints, states.x[: states.equations.space.nq, i]
    loops = np.empty((0, len(states.v))) if constraints is None else constraints.jacobian_at(q, constraints.kept)
    return shared_limits(loops, limits, set(lockable[locked[:, i]].tolist()))[0]


def _with_static(switching: Switching, loop: Any) -> Any:
    """A closed contact's loop; one that rolls with the friction of rest."""
    every: list[tuple[str, float | None]] = [(contact.name, contact.static) for _, contact in switching.contacts]
    every += [(pair.name, getattr(switching.effects[place], "static", None)) for place, pair in switching.pairs]
    static = next((size for name, size in every if name == loop.pair and size is not None), loop.friction)
    return msgspec.structs.replace(loop, friction=float(static)) if loop.rolling else loop


def _starts(states: _States, a: Array, contacts: Array) -> Broken:
    """Touches that do not part do not begin to approach; a joint begins to slip against its friction.

    The acceleration counts where it would break the law of positions while the mode lasts.
    """
    small, largest = POSITION * states.speed, 1.0 + np.abs(a).max(axis=0, initial=0.0)

    def approach(gap: Array, rate: Array, acceleration: Array) -> Array:
        comes = (np.abs(rate) <= small) & (gap + 0.5 * acceleration * states.lasts**2 < -POSITION)
        return np.where((gap <= TOUCHES) & comes, -acceleration / largest, 0.0)

    for stop in states.switching.stops:
        room = stop.side * (states.x[stop.entry] - stop.position)
        yield "mode starts", approach(room, stop.side * states.v[stop.dof], stop.side * a[stop.dof])
    for gap, rate, *_, acceleration in contacts:
        yield "mode starts", approach(gap, rate, acceleration)
    for k, friction in zip(states.equations.layout.lockable, states.locks[1], strict=True):
        rests = np.abs(states.v[k]) <= small
        yield "mode starts", np.where(rests, np.sign(friction) * a[k] / largest, 0.0)


def _impacts(switching: Switching, segments: Sequence[Segment]) -> Iterator[tuple[str, Array, Array]]:
    """Kinetic energies after events, beside those before them. What a `then` changes may add any."""
    if any(trigger.state is not None for _, trigger in switching.triggers):
        return
    for robot in {id(segment.equations.robot): segment.equations.robot for segment in segments}.values():
        pairs = [(one.last, two) for one, two in itertools.pairwise(segments)
                 if one.equations.robot is robot and two.equations.robot is robot and one.last is not None]  # fmt: skip
        if pairs:
            x = np.array([np.stack([last, two.equations.start[: len(last)]]) for last, two in pairs])
            before, after = (
                robot.energy(x[:, i, : robot.nq], x[:, i, robot.nq : robot.nq + robot.nv])[0] for i in (0, 1)
            )
            least = 1e-300 + RELATIVE * float(before.max())
            yield "impacts", (after - before) / np.maximum(before, least), np.array([two.begin for _, two in pairs])
