"""Saltation: how derivatives of a motion go on through an event.

    dt = -(g_x S- + g_p) / (g_x f- + g_t)        how much later the event is; 0 at a given time
    S+ = R_x (S- + f- dt) + R_t dt + R_p - f+ dt

g: the guard that passes 0 at the event; R: the transition, x+ = R(t, x-, p); f-, f+: the rates before and after it. The
derivatives of g and R along these directions are differences of fourth order of the engine's own guards and
transitions. Where the modes after it differ for states beside it, or the guard only touches 0, there are none.

Reference: Leine, Nijmeijer: Dynamics and Bifurcations of Non-Smooth Mechanical Systems, 2004, chapter 7.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from twolink.algorithms.mechanism import mechanism, with_nominal
from twolink.algorithms.namespaces import Numbers
from twolink.errors import AccuracyError
from twolink.integrate.effect_numbers import PREFIX, nominal_value, with_effect_numbers
from twolink.integrate.equations import Equations
from twolink.integrate.formulas import projected
from twolink.integrate.hybrid.engine import Engine
from twolink.integrate.hybrid.guard import Guard
from twolink.integrate.hybrid.locating import Hit
from twolink.integrate.hybrid.modes import System
from twolink.integrate.hybrid.state import RunState
from twolink.integrate.hybrid.transitions import fire_timed, same_time
from twolink.integrate.solution import Solution
from twolink.integrate.state import Array

STEP = 1e-4  # of differences, relative to the size of a direction
GRAZING = 1e-10  # relative to the speeds or the loads: a guard that passes 0 no faster only touches it
UNCHANGED = 1e-9  # relative: an event that changes the state by less leaves it as it is
JOINTS, CONTACTS = ("lock +1", "lock -1", "stick"), ("leave", "slide", "roll")  # guards: their event changes one only


Function = Callable[[RunState], Array]


class Jump(NamedTuple):
    """What happens at the end of a piece.

    before, after: the run. guard: what passed 0, if anything. timed: whether it is also at a given time. begin: of the
    piece, s.
    """

    before: RunState
    after: RunState
    guard: Guard | None
    timed: bool
    begin: float


class RecordingEngine(Engine):
    """The hybrid engine, which keeps the jump at the end of each piece."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.jumps: list[Jump] = []
        self.begun = self.run

    def _next(self, stop: float, *, first: bool) -> Solution:
        if first:
            self.begun = _copy(self.run)
        return super()._next(stop, first=first)

    def _transit(self, hit: Hit | None, begin: float, stop: float) -> None:
        before = _copy(self.run)
        if not same_time(before.t, begin):
            before.opened.clear()
            before.fired.clear()
        timed = before.t == stop
        super()._transit(hit, begin, stop)
        self.jumps.append(Jump(before, _copy(self.run), None if hit is None else hit.guard, timed, begin))


class Saltation:
    """S after jumps. names: of the parameters, whose rows follow those of the state."""

    def __init__(self, equations: Equations, names: tuple[str, ...]) -> None:
        self.equations, self.names = equations, names
        self._systems: dict[tuple[str, float], System] = {}

    def __call__(self, jump: Jump, s: Array) -> Array:
        """S after a jump (2 nv + p, k) from that before it. Raises AccuracyError, code "sensitivity-undefined"."""
        before, after, guard = jump.before, jump.after, jump.guard
        states = 2 * self.equations.space.nv
        rates = [np.concatenate([run.x[run.system.nq :], run.here.look().a[:, 0]]) for run in (before, after)]
        moved = np.abs(after.x - before.x).max(initial=0.0) > UNCHANGED * (1.0 + np.abs(before.x).max(initial=0.0))
        if not moved and np.array_equal(rates[0], rates[1]):
            return s
        _require_alone(jump)
        late = np.zeros(s.shape[1])
        if guard is not None:
            late = self._delay(jump, guard, rates[0], s)
        out = s.copy()
        out[:states] += np.outer(rates[0], late)
        if moved:
            directions = out.copy()
            for k in before.mode.locked:  # what is held is held exactly
                directions[[k, k + states // 2]] = 0.0
            out[:states] = np.array([
                self._derivative(before, lambda run: self._state_after(jump, run), direction, delay)
                for direction, delay in zip(directions.T, late, strict=True)
            ]).T  # fmt: skip
        out[:states] -= np.outer(rates[1], late)
        return out

    def start(self, run: RunState, s: Array) -> Array:
        """S at the start, where a run has found its mode. Raises AccuracyError where S would leave that mode."""
        nv = self.equations.space.nv
        held = [k for k in run.mode.locked if s[nv + k].any() or any(hold.entry is not None and s[k].any()
                for hold in run.system.holds(k, run.x))]  # fmt: skip
        names = [run.system.names[k] for k in held]
        for i, kind in enumerate(run.mode.contacts):
            if kind == "free":
                continue

            def rows(other: RunState, i: int = i, count: int = 4 if kind == "rolling" else 2) -> Array:
                return np.asarray(other.here.look().contacts[i, :count, 0])

            if any(np.abs(self._derivative(run, rows, column, 0.0, bound=False)).max() > UNCHANGED for column in s.T):
                names.append(run.system.contacts[i].name)
        if names:
            raise AccuracyError(f"there are no derivatives by a start that would move {', '.join(names)}, held there",
                                where="wrt", remedy='ask for single joints, such as "q.elbow"',
                                code="sensitivity-undefined", t=run.t)  # fmt: skip
        return s

    def _delay(self, jump: Jump, guard: Guard, rate: Array, s: Array) -> Array:
        """How much later the event is, along each column."""
        before = jump.before

        def value(run: RunState) -> Array:
            return np.atleast_1d(np.asarray(guard.value(run.here.look()), dtype=float)).ravel()[:1]

        flow = np.concatenate([rate, np.zeros(len(self.names))])
        along_motion = self._derivative(before, value, flow, 1.0, bound=False)[0]
        load = before.here.own.largest_load(before.here.look()) if guard.is_force else np.abs(rate).max(initial=0.0)
        if not abs(along_motion) > GRAZING * (1.0 + load):
            raise _undefined(jump, "what causes it only touches its limit, so that another motion may miss it")
        across = [self._derivative(before, value, column, 0.0, bound=False)[0] for column in s.T]
        return np.asarray(-np.array(across) / along_motion)

    def _state_after(self, jump: Jump, run: RunState) -> Array:
        """The state after the jump of another run beside it, as a tangent vector from that of the run."""
        if jump.guard is not None:
            run.fired.add(jump.guard.key)
            jump.guard.transition(run)
        if jump.timed:
            mode = run.mode
            fire_timed(run)
            run.settle(mode)
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
    ) -> Array:
        """The derivative of a function of runs along a direction of state and parameters, and of the time."""
        size = max(float(np.abs(direction).max(initial=0.0)), abs(delay))
        if size == 0.0:
            return 0.0 * function(self._beside(run, direction, 0.0, 0.0, bound=bound))
        step = STEP / size

        def at(k: int) -> Array:
            return function(self._beside(run, direction, delay, k * step, bound=bound))

        near, far = (at(k) - at(-k) for k in (1, 2))
        return np.asarray((8.0 * near - far) / (12.0 * step))

    def _beside(self, run: RunState, direction: Array, delay: float, step: float, *, bound: bool) -> RunState:
        """A run whose state, parameters and time are moved. bound: closed loops and contacts are closed again."""
        other, nv = _copy(run), self.equations.space.nv
        nq, robot = run.system.nq, self.equations.robot
        other.system = self._system(run.system, direction[2 * nv :] * step)
        if step:
            q = robot.integrate(run.x[:nq], step * direction[:nv])
            other.x = np.concatenate([q, run.x[nq:] + step * direction[nv : 2 * nv]])
            other.t = run.t + step * delay
        equations = other.here.own.equations
        if bound and step and equations.constraints is not None:
            other.x = projected(equations, other.here.full_state(), Numbers)[: equations.moving]
        return other

    def _system(self, system: System, shifts: Array) -> System:
        """The system with other values of the parameters."""
        changed = [(name, float(shift)) for name, shift in zip(self.names, shifts, strict=True) if shift]
        if not changed:
            return system
        (key,) = changed  # a column is of one parameter
        if key not in self._systems:
            value = nominal_value(self.equations, key[0]) + key[1]
            self._systems[key] = System(shifted(system.whole, {key[0]: value}), compiled=False)
        return self._systems[key]


def shifted(equations: Equations, values: Mapping[str, float]) -> Equations:
    """The equations with other values of parameters."""
    physical = {name: value for name, value in values.items() if not name.startswith(PREFIX)}
    equations, switching = with_effect_numbers(equations, values), equations.switching
    if not physical:
        return replace(equations, switching=None if switching is None else replace(switching))

    def change(model: object) -> None:
        for name, value in physical.items():
            with_nominal(model, name, value)

    robot = equations.robot.changed(change)
    mech = mechanism(robot.model)
    constraints = equations.constraints and replace(equations.constraints, mech=mech)
    if switching is not None:
        switching = replace(switching, robot=robot)
    return replace(equations, robot=robot, mechanism=mech, constraints=constraints, switching=switching)


def _copy(run: RunState) -> RunState:
    """A run that may be changed."""
    other = copy.copy(run)
    other.x, other.events, other.sides = run.x.copy(), [], dict(run.sides)
    other.fired, other.opened, other._rest_noted = set(run.fired), set(run.opened), set(run._rest_noted)
    return other


def _kind(run: RunState) -> object:
    """What of a mode cannot change a little."""
    mode = run.mode
    return mode.contacts, mode.locked, {k: slip for k, slip in mode.slip.items() if slip}, mode.dropped


def _require_alone(jump: Jump) -> None:
    """Require that nothing else happens in the same instant. Raises AccuracyError."""
    guard, before, after = jump.guard, jump.before.mode, jump.after.mode
    if guard is None:
        return
    if jump.timed or jump.before.t - jump.begin <= 1e-12 * max(1.0, jump.begin):
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
