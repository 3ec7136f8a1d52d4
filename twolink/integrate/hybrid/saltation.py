"""Saltation: how derivatives of a motion go on through an event.

    dt = -(g_x S- + g_p) / (g_x f- + g_t)        how much later the event is; 0 at a given time
    S+ = R_x (S- + f- dt) + R_t dt + R_p - f+ dt

g: the guard that passes 0 at the event; R: the transition, x+ = R(t, x-, p); f-, f+: the rates before and after it. The
derivatives of g and R along these directions are differences of fourth order of the engine's own guards and
transitions. Where the modes after it differ for states beside it, or the guard only touches 0, there are none.

Reference: Leine, Nijmeijer: Dynamics and Bifurcations of Non-Smooth Mechanical Systems, 2004, chapter 7.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from twolink.algorithms.dual_numbers import derivative
from twolink.effects.switching import same_time
from twolink.errors import AccuracyError
from twolink.integrate.derivatives.parameter_variation import ParameterVariation
from twolink.integrate.hybrid.engine import Engine
from twolink.integrate.hybrid.locating import Guard, Hit
from twolink.integrate.hybrid.modes import System
from twolink.integrate.hybrid.state import RunState
from twolink.integrate.hybrid.transitions import fire, guard_of, timed_triggers
from twolink.integrate.motion.state import Array

STEP = 1e-3  # of differences by states and times, relative to the size of a direction; rounding is 1e-13 of the size
SHARES = (1.0, 0.1, 1e-3, 1e-5)  # of it, until the same happens beside an event: small bounces have small speeds
GRAZING = 1e-10  # relative to the speeds or the loads: a guard that passes 0 no faster only touches it
UNCHANGED = 1e-9  # relative: an event that changes the state by less leaves it as it is
JOINTS, CONTACTS = ("lock +1", "lock -1", "stick"), ("leave", "slide", "roll")  # guards: their event changes one only

Function = Callable[[RunState], Array]


class Jump(NamedTuple):
    """The event at the end of a segment.

    before, after: the run. guard: what passed 0, if anything. timed: triggers whose time it is, by number; None where
    the event is at no given time. begin: of the segment, s. rest: when the bounces end that are not followed, s.
    """

    before: RunState
    after: RunState
    guard: Guard | None
    timed: tuple[int, ...] | None
    begin: float
    rest: float


class RecordingEngine(Engine):
    """The hybrid engine, which keeps the jump at the end of each segment."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.jumps: list[Jump] = []
        self.begun = _copy(self.run)

    def _end_after_events(self) -> None:
        """Leave the last sample in the segment before: derivatives at the end are those before what happens there."""

    def _transit(self, hit: Hit | None, begin: float, stop: float) -> None:
        before = _copy(self.run)
        if not same_time(before.t, begin):
            before.opened.clear()
            before.fired.clear()
        timed = tuple(timed_triggers(before)) if before.t == stop else None
        known = len(self.run.events)
        super()._transit(hit, begin, stop)
        rest = max((event.t for event in self.run.events[known:]), default=before.t)
        self.jumps.append(Jump(before, _copy(self.run), None if hit is None else hit.guard, timed, begin, rest))


class Saltation:
    """S after jumps, whose rows are those of the state, then of the parameters of the variation."""

    def __init__(self, variation: ParameterVariation) -> None:
        self.equations, self.variation = variation.equations, variation
        self._systems: dict[tuple[int, float, float], System] = {}

    def __call__(self, jump: Jump, s: Array, share: float = 1.0) -> Array:
        """S after a jump (tangent + p, k) from that before it. Raises AccuracyError, code "sensitivity-undefined".

        share: of the usual steps of differences.
        """
        before, after, guard = jump.before, jump.after, jump.guard
        nv, states = self.equations.space.nv, self.equations.space.tangent
        rates = [_rate(run) for run in (before, after)]
        moved = np.abs(after.x - before.x).max(initial=0.0) > UNCHANGED * (1.0 + np.abs(before.x).max(initial=0.0))
        if not moved and np.array_equal(rates[0], rates[1]):
            return s
        _require_alone(jump)
        late = self._delay_of_time(jump, s) if guard is None else self._delay(jump, guard, rates[0], s, share)
        out = s.copy()
        out[:states] += np.outer(rates[0], late)
        if moved:
            directions = out.copy()
            for k in before.mode.locked:  # what is locked stays exactly
                directions[nv + k] = 0.0
            out[:states] = np.array([self._derivative_after(jump, direction, delay, share)
                                     for direction, delay in zip(directions.T, late, strict=True)]).T  # fmt: skip
        out[:states] -= np.outer(rates[1], late)
        return out

    def start(self, run: RunState, s: Array) -> Array:
        """S at the start, where a run has found its mode. Raises AccuracyError where S would leave that mode."""
        nv, moving = self.equations.space.nv, np.flatnonzero(s[self.equations.space.tangent :].any(axis=1)).tolist()
        locked = [k for k in run.mode.locked if s[nv + k].any() or any(lock.entry is not None and s[k].any()
                for lock in run.system.locks(k, run.x))]  # fmt: skip
        locked += [k for k in run.mode.locked for i in moving if self._places(run, k, i) != self._places(run, k)]
        at_rest = [k for k in run.mode.slip if k not in run.mode.locked and run.x[self.equations.space.nq + k] == 0.0]
        locked += [k for k in at_rest if s[nv + k].any() and any(lock.kinetic for lock in run.system.locks(k, run.x))]
        names = [run.system.names[k] for k in locked]
        for i, kind in enumerate(run.mode.contacts):
            if kind == "free":
                continue

            def rows(other: RunState, i: int = i, count: int = 4 if kind == "rolling" else 2) -> Array:
                return np.asarray(other.evaluate().contacts[i, :count, 0])

            if any(np.abs(self._derivative(run, rows, column, 0.0, bound=False)).max() > UNCHANGED for column in s.T):
                names.append(run.system.contacts[i].name)
        if names:
            raise AccuracyError(f"there are no derivatives by a start that would move {', '.join(names)}, locked there "
                                "or at rest with friction, which acts against either direction",
                                where="wrt", remedy='ask for single joints, such as "q.elbow"',
                                code="sensitivity-undefined", t=run.t)  # fmt: skip
        return s

    def _places(self, run: RunState, k: int, parameter: int | None = None) -> list[float]:
        """Positions at which degree of freedom k is locked, with a parameter moved."""
        every = (run.system if parameter is None else self._system(run, parameter, 1)).every_lock(k)
        return [lock.position for lock, own in zip(every, run.system.every_lock(k), strict=True)
                if own.entry is not None and own.acts(run.x)]  # fmt: skip

    def _delay(self, jump: Jump, guard: Guard, rate: Array, s: Array, share: float) -> Array:
        """Delay of the event along each column."""
        before = jump.before

        def value(run: RunState) -> Array:
            own = guard if run.system is before.system else guard_of(run, guard.key) or guard
            return np.atleast_1d(np.asarray(own.value(run.evaluate()), dtype=float)).ravel()[:1]

        flow = np.concatenate([rate, np.zeros(len(self.variation.names))])
        along_motion = self._derivative(before, value, flow, 1.0, bound=False, share=share)[0]
        load = before.own.largest_load(before.evaluate()) if guard.of == "force" else np.abs(rate).max(initial=0.0)
        if not abs(along_motion) > GRAZING * (1.0 + load):
            raise _undefined(jump, "what causes it only touches its limit, so that another motion may miss it")
        across = [self._derivative(before, value, column, 0.0, bound=False, share=share)[0] for column in s.T]
        return np.asarray(-np.array(across) / along_motion)

    def _delay_of_time(self, jump: Jump, s: Array) -> Array:
        """Delay of an event at a given time, along each column. Raises AccuracyError."""
        late, before, names = np.zeros(s.shape[1]), jump.before, self.variation.names
        for n in jump.timed or ():
            name = f"effects.{before.system.triggers[n][0]}.at"
            if name not in names:
                continue
            late = s[self.equations.space.tangent + names.index(name)]
            if len(jump.timed or ()) > 1 or not np.array_equal(_rate(before), _rate(before, jump.begin)):
                raise _undefined(jump, "something else happens at the same given time")
        return late

    def _derivative_after(self, jump: Jump, direction: Array, delay: float, share: float) -> Array:
        """The derivative of the state after a jump. Raises AccuracyError where other things happen beside it."""
        for smaller in SHARES:
            try:
                return self._derivative(jump.before, lambda run: self._state_after(jump, run), direction, delay,
                                        share=share * smaller)  # fmt: skip
            except AccuracyError as error:
                if error.code == "no-impact":
                    raise _undefined(jump, "beside it an impact would create energy") from None
                if error.code != "sensitivity-undefined" or smaller == SHARES[-1]:
                    raise
        raise AssertionError

    def _state_after(self, jump: Jump, run: RunState) -> Array:
        """The state after the jump of another run beside it, as a tangent vector from that of the run."""
        if jump.guard is not None:
            run.fired.add(jump.guard.key)
            jump.guard.transition(run)
        if jump.timed is not None:
            mode = run.mode
            fire(run, jump.timed)
            run.resolve_mode(mode)
        if _kind(run) != _kind(jump.after):
            raise _undefined(jump, "other things happen beside it, such as another event in the same instant")
        nq, robot = run.system.nq, self.equations.robot
        return np.concatenate([robot.difference(jump.after.x[:nq], run.x[:nq]), run.x[nq:] - jump.after.x[nq:]])

    def _derivative(
        self,
        run: RunState,
        function: Function,
        direction: Array,
        delay: float,
        *,
        bound: bool = True,
        share: float = 1.0,
    ) -> Array:
        """The derivative of a function of runs along a direction of state and parameters, and of the time.

        bound: closed loops and contacts are closed again. share: of the usual step. All is moved together: where states
        that move alone would slide or leave, those that move with a parameter need not.
        """
        states = self.equations.space.tangent
        size = max(float(np.abs(direction[:states]).max(initial=0.0)), abs(delay))
        i, step = self._step(size, direction[states:])

        def at(k: float) -> Array:
            other = _copy(run)
            if i is not None:
                other.system = self._system(run, i, k * step / self.variation.step(i)).having(run.system.features)
            nq, nv = run.system.nq, self.equations.space.nv
            q = self.equations.robot.integrate(run.x[:nq], k * step * direction[:nv])
            other.x = np.concatenate([q, run.x[nq:] + k * step * direction[nv:states]])
            other.t = run.t + k * step * delay
            return function(_beside(other, run, bound=bound))

        return np.asarray(derivative(lambda k: at(share * k), share * step))

    def _step(self, size: float, parameters: Array) -> tuple[int | None, float]:
        """The parameter that a direction moves, and the step along it. size: of its changes of state and time."""
        moved = np.flatnonzero(parameters)
        if not moved.size:
            return None, STEP / size if size else STEP
        i, step = int(moved[0]), self.variation.step(int(moved[0]))
        while step * size > STEP:
            step /= 4.0  # not any size, so that systems are met again
        return i, step

    def _system(self, run: RunState, i: int, k: float) -> System:
        """The system of a run with parameter i moved by k steps."""
        key = i, k, run.system.slow
        if key not in self._systems:
            self._systems[key] = System(self.variation.equations_beside(i, k), run.system.slow, traced=False)
        return self._systems[key]


def _beside(other: RunState, run: RunState, *, bound: bool) -> RunState:
    """A run beside another, with the same joints locked in place, and loops closed."""
    for k in run.mode.locked:
        for lock, own in zip(other.system.every_lock(k), run.system.every_lock(k), strict=True):
            if own.entry is not None and own.acts(run.x):
                other.x[own.entry] = lock.position
    if bound and other.own.equations.constraints is not None:
        other.x = other.closed()
    return other


def _rate(run: RunState, begin: float | None = None) -> Array:
    """(v, a, z') of a run; begin: of its segment, whose numbers then count, instead of those of the next segment."""
    if begin is None:
        snapshot = run.evaluate()
    else:
        snapshot = run.own.evaluate(np.array([run.t]), run.full_state(0.5 * (begin + run.t))[:, None])
    return np.concatenate([run.v, snapshot.a[:, 0], snapshot.rates[:, 0]])


def _copy(run: RunState) -> RunState:
    """A run that may be changed."""
    other = run.copied()
    other.events = []
    return other


def _kind(run: RunState) -> object:
    """The part of a mode that cannot change a little."""
    mode = run.mode
    return mode.contacts, mode.locked, {k: slip for k, slip in mode.slip.items() if slip}, mode.idle


def _require_alone(jump: Jump) -> None:
    """Require that nothing else happens in the same instant. Raises AccuracyError."""
    guard, before, after = jump.guard, jump.before.mode, jump.after.mode
    if guard is None:
        return
    if jump.timed is not None or jump.before.t - jump.begin <= 1e-12 * max(1.0, jump.begin):
        raise _undefined(jump, "it is in the same instant as another event")
    if guard.key[0] not in JOINTS + CONTACTS:
        return
    joints = {k for k in (*before.locked, *after.locked, *after.slip)
              if (k in before.locked, before.slip.get(k)) != (k in after.locked, after.slip.get(k))}  # fmt: skip
    contacts = {i for i, now in enumerate(after.contacts) if before.contacts[i] != now}
    (joints if guard.key[0] in JOINTS else contacts).discard(guard.key[1])
    if joints or contacts:
        raise _undefined(jump, "another joint or contact changes in the same instant")


def _undefined(jump: Jump, why: str) -> AccuracyError:
    """The error for an event through which there are no derivatives."""
    t, what = jump.before.t, jump.guard.key[0].split()[0] if jump.guard is not None else "event"
    return AccuracyError(f"the motion has no derivatives from the {what} on: {why}", where=f"t = {t:.9g} s",
                         remedy=f"ask for a duration below {t:.6g} s, or change the scene a little",
                         code="sensitivity-undefined", t=t)  # fmt: skip
