"""Motions that go on from call to call: smooth, with located events, and with stepped contacts.

Each has the time t, the states x (moving, n) of its solutions, whether it has ended, and its events so far; it takes
numbers that hold, such as torques, advances to a time, and tells how far its solutions are apart. `StepwiseMotion`
advances from tick to tick, where the scene has sampled controllers or sensors.

All that a motion remembers belongs to one of its solutions, and is in what `save` returns: what saves and goes on has
the same bits as what does not save, and as what restores it.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from twolink.contact.solver import no_forces, stepper_of
from twolink.contact.steps import Memory, Record, StepPlan, twice_as_many
from twolink.effects.sensors import Forces
from twolink.integrate.event import Event
from twolink.integrate.forces_seen import forces_seen
from twolink.integrate.hybrid.ticks import SavedEngine, TickEngine, forces_in_modes
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.state import Array, StateSpace
from twolink.integrate.solvers.ticks import Lanes
from twolink.integrate.steps.methods import METHODS
from twolink.integrate.steps.perturbation import NO_PERTURBATION, disturbed_solutions, finer_solution
from twolink.integrate.steps.step_map import StepMap
from twolink.loop.clock import SAME_TIME
from twolink.loop.sampled_loop import SampledLoop, Sampling
from twolink.scenes import Scene
from twolink.simulation.error_bar import DISTURBED, distances, error_bar, rounding_after, truncation_factor, widened
from twolink.simulation.stepped_run import SAFETY

METHOD = METHODS["dop853"]
ROUNDED = 2  # solutions that are disturbed by rounding, with verify
NOTES = 64  # states at which solutions are compared at once
MANY = 1_000_000  # steps, after which the count of steps begins anew


def solutions_of(tolerance: float, *, verify: bool) -> tuple[Any, ...]:
    """The perturbations of a motion, and of those that show its error."""
    others = (finer_solution(METHOD, tolerance), *disturbed_solutions(ROUNDED)) if verify else ()
    return NO_PERTURBATION, *others


def errors_of(space: StateSpace, x: Array, steps: Array) -> Array:
    """Bounds (m,) on the errors of the first of solutions x (m, moving, n), rad or m, after so many steps (m,)."""
    off = distances(space, x[:, :, :1], x[:, :, 1:])
    bar = truncation_factor(METHOD, steps) * off[:, 0] + DISTURBED[ROUNDED] * off[:, 1:].max(axis=1)
    return np.asarray(widened(bar) + rounding_after(space, x[:, :, 0], steps))


class SavedMotion(NamedTuple):
    """All that a motion goes on from, in copies: that of its solutions, of its controllers, and its error so far."""

    solutions: Any
    loop: Any
    bar: float


class StepwiseMotion(ABC):
    """The interface of the three kinds of motion. loop: the controllers and sensors; None where the scene has none."""

    loop: SampledLoop | None = None
    _bar = 0.0

    @property
    @abstractmethod
    def equations(self) -> Equations:
        """The equations of motion, in the first mode where there are several."""

    @property
    @abstractmethod
    def t(self) -> float:
        """The time, s."""

    @property
    @abstractmethod
    def x(self) -> Array:
        """The states (moving, n)."""

    @property
    @abstractmethod
    def apart(self) -> float:
        """A bound on the error now, or an estimate of it, rad or m."""

    @property
    def error(self) -> float:
        """The largest `apart` so far, of the times at which it was asked for or noted, rad or m."""
        self._bar = max(self._bar, self.apart)
        return self._bar

    def note(self) -> None:
        """Let `error` have regard to the error now."""
        _ = self.error

    def save(self) -> SavedMotion:
        """All that it goes on from."""
        return SavedMotion(self.saved_solutions(), None if self.loop is None else self.loop.saved(), self._bar)

    def restore(self, saved: SavedMotion) -> None:
        """Go on from there, with the same bits."""
        self.restore_solutions(saved.solutions)
        if self.loop is not None:
            self.loop.restore(saved.loop)
        self._bar = saved.bar

    @property
    def events(self) -> Sequence[Event]:
        """Events so far."""
        return ()

    @property
    def ended(self) -> bool:
        """True if an event has ended the motion."""
        return False

    def listen(self, sampling: Sampling) -> None:
        """Call these controllers and sensors at their ticks, from now on."""
        layout = self.equations.layout
        self.loop = SampledLoop(sampling, layout.rows_of_slots(), layout.space.states, self.held(), self.look, self.t)

    def advance(self, t: float) -> None:
        """Go to a time, s."""
        while self.loop is not None and self.loop.time <= t * (1.0 + SAME_TIME) and not self.ended:
            if self.loop.time > self.t * (1.0 + SAME_TIME):
                self.go(self.loop.time)
            if self.ended:
                return
            self.loop.tick(x := self.held())
            self.hold(x)
            self.loop.forget()
            self.loop.look_back()
        # After a tick at the same time finer solutions would take half of what rounding leaves as a step.
        if t > self.t * (1.0 if self.loop is None else 1.0 + SAME_TIME):
            self.go(t)

    @abstractmethod
    def go(self, t: float) -> None:
        """Go to a time, s, with the numbers that hold."""

    @abstractmethod
    def held(self) -> Array:
        """The states with the numbers that hold (size, n), which may be written."""

    @abstractmethod
    def hold(self, x: Array) -> None:
        """Let the numbers in states (size, n) hold from now on."""

    @abstractmethod
    def look(self, t: float, x: Array) -> Forces:
        """The forces at states (size, n)."""

    @abstractmethod
    def saved_solutions(self) -> Any:
        """All that the solutions remember, in copies."""

    @abstractmethod
    def restore_solutions(self, saved: Any) -> None:
        """Let the solutions go on from there."""


class Smooth(StepwiseMotion):
    """Solutions as lanes of one batch. span: the time that sets their first steps, s."""

    def __init__(
        self, equations: Equations, by: StepMap, t: float, span: float, tolerance: float, solutions: tuple[Any, ...]
    ) -> None:
        self._map, self._span, self._tolerance, self._solutions, self._steps = by, span, tolerance, solutions, 0
        self._lanes = self._begun(equations, t)
        self._noted, self._places = 0, np.empty((NOTES, equations.moving, len(solutions)))
        self._counts = np.empty(NOTES)

    def _begun(self, equations: Equations, t: float) -> Lanes:
        self._map.equations = equations
        return Lanes(self._map, t, t + self._span, self._tolerance, self._solutions)

    @property
    def equations(self) -> Equations:
        """The equations of motion."""
        return self._lanes.by.equations

    @property
    def t(self) -> float:
        """The time, s."""
        return self._lanes.time

    @property
    def x(self) -> Array:
        """The states."""
        return self._lanes.x[: self.equations.moving]

    @property
    def apart(self) -> float:
        """A bound on the error now and at what was noted, rad or m."""
        self._note()
        noted, self._noted = slice(self._noted), 0
        return float(errors_of(self.equations.space, self._places[noted], self._counts[noted]).max())

    def note(self) -> None:
        """Let `error` have regard to the error now: some at once."""
        if self._noted == NOTES - 1:
            super().note()
        else:
            self._note()

    def _note(self) -> None:
        """Keep the states and how many steps led to them."""
        self._places[self._noted], self._counts[self._noted] = self.x, self._steps + self._lanes.counts[0]
        self._noted += 1

    def held(self) -> Array:
        """The states and numbers, as they are stepped."""
        return self._lanes.x

    def hold(self, x: Array) -> None:
        """They are written already."""

    def look(self, t: float, x: Array) -> Forces:
        """The forces at states (size, n)."""
        return forces_seen(self.equations, t, x)

    def go(self, t: float) -> None:
        """Go to a time, s."""
        lanes = self._lanes
        lanes.advance(t)
        if lanes.counts[0] > MANY:
            x, self._steps = lanes.x.copy(), self._steps + lanes.counts[0]
            self._lanes = self._begun(self.equations.starting_at(x[:, 0], t), t)
            self._lanes.x[:] = x

    def saved_solutions(self) -> tuple[Lanes, int, Array, Array]:
        """The lanes, the steps before them, and what was noted."""
        noted = slice(self._noted)
        return self._lanes.copied(), self._steps, self._places[noted].copy(), self._counts[noted].copy()

    def restore_solutions(self, saved: tuple[Lanes, int, Array, Array]) -> None:
        """Go on from there."""
        self._lanes, self._steps, self._noted = saved[0].copied(), saved[1], len(saved[2])
        self._places[: self._noted], self._counts[: self._noted] = saved[2:]


class Located(StepwiseMotion):
    """Solutions with modes, each with its own events."""

    def __init__(self, equations: Equations, t: float, tolerance: float, solutions: tuple[Any, ...]) -> None:
        self._equations, self._rows = equations, equations.layout.rows_of_slots()
        times = np.array([t, math.inf])
        self._engines = [TickEngine(equations, METHOD, times, tolerance, None, one) for one in solutions]

    @property
    def equations(self) -> Equations:
        """The equations of all modes."""
        return self._equations

    @property
    def t(self) -> float:
        """The time, s."""
        return self._engines[0].run.t

    @property
    def x(self) -> Array:
        """The states."""
        return np.stack([engine.run.x for engine in self._engines], axis=1)

    @property
    def events(self) -> Sequence[Event]:
        """Events so far."""
        return self._engines[0].run.events

    @property
    def ended(self) -> bool:
        """True if an event has ended the motion."""
        return self._engines[0].run.ended

    @property
    def apart(self) -> float:
        """A bound on the error, rad or m."""
        return float(errors_of(self.equations.space, self.x[None], np.array([self._engines[0].steps]))[0])

    def held(self) -> Array:
        """The states with the numbers of the slots."""
        x = np.repeat(self.equations.start[:, None], len(self._engines), axis=1)
        x[: self.equations.moving] = self.x
        for name, row in self._rows.items():
            x[row] = [engine.run.system.held.get(name, 0.0) for engine in self._engines]
        return x

    def hold(self, x: Array) -> None:
        """Let the numbers of the slots hold from now on."""
        for engine, own in zip(self._engines, x.T, strict=True):
            held, before = {name: float(own[row]) for name, row in self._rows.items()}, engine.run.system.held
            if any(before.get(name, 0.0) != value for name, value in held.items()):
                engine.hold(held)

    def look(self, *_: object) -> Forces:
        """The forces in each solution's mode."""
        return forces_in_modes(self._engines)

    def go(self, t: float) -> None:
        """Go to a time, s."""
        for engine in self._engines:
            engine.advance(t)
            engine.forget()

    def saved_solutions(self) -> list[SavedEngine]:
        """Of each engine."""
        return [engine.saved() for engine in self._engines]

    def restore_solutions(self, saved: list[SavedEngine]) -> None:
        """Go on from there."""
        for engine, one in zip(self._engines, saved, strict=True):
            engine.restore(one)


class SteppedState(NamedTuple):
    """One solution with stepped contacts: q, w (see `Multibody`), and what its last step passed on."""

    q: Array
    w: Array
    memory: Memory


class Stepped(StepwiseMotion):
    """A motion with stepped contacts, and with verify one of twice as many steps. step: the longest, s."""

    def __init__(self, scene: Scene, t: float, step: float, *, verify: bool) -> None:
        self._stepper, self._step, self._t = stepper_of(scene), step, t
        equations = self._stepper.equations
        self._stepper.record, nq = Record(), equations.space.nq
        numbers = equations.layout.numbers_at(t)
        self._numbers = np.repeat(numbers[:, None], 2 if verify else 1, axis=1)
        q, v = np.array(equations.start[:nq]), np.array(equations.start[nq : equations.moving])
        w = self._stepper.bodies.to_local_velocity(q, v, -1)
        self._states = [SteppedState(q, w, self._stepper.start(t, q, w, numbers))] * (2 if verify else 1)

    @property
    def equations(self) -> Equations:
        """The equations without contacts."""
        return self._stepper.equations

    @property
    def t(self) -> float:
        """The time, s."""
        return self._t

    @property
    def x(self) -> Array:
        """The states."""
        local = self._stepper.bodies.to_local_velocity
        return np.stack([np.concatenate([q, local(q, w)]) for q, w, _ in self._states], axis=1)

    @property
    def apart(self) -> float:
        """An estimate of the error, rad or m: of first order, half the step has half of it."""
        (q, *_), (other, _, memory) = self._states
        off = 2.0 * (self.equations.space.distance(q[None], other[None]) + memory.unfollowed)
        return float(error_bar(off, np.zeros(1), SAFETY)[0])

    def held(self) -> Array:
        """The states with the numbers."""
        return np.concatenate([self.x, self._numbers])

    def hold(self, x: Array) -> None:
        """Let the numbers hold from now on."""
        self._numbers = x[self.equations.moving :].copy()

    def look(self, *_: object) -> Forces:
        """Raises SceneError: steps have no forces at an instant."""
        return no_forces()

    def go(self, t: float) -> None:
        """Go to a time, s."""
        if t <= self.t:
            return
        count = max(1, math.ceil((t - self.t) / self._step - 1e-9))
        counts = (count, twice_as_many(count))[: len(self._states)]
        self._states = [self._solved(k, t, n) for k, n in enumerate(counts)]
        self._t = t

    def _solved(self, number: int, end: float, count: int) -> SteppedState:
        h, first, (q, w, memory) = (end - self.t) / count, 0, self._states[number]
        steps = np.arange(count)
        plan = StepPlan(self.t + h * steps, np.full(count, h), 0 * steps, steps < 0, self._numbers[None, :, number])
        while first < count:
            found = self._stepper.run(plan, first, count, q, w, memory)
            last, first = found[len(found) - 1], first + len(found)
            q, w, memory = last.q, last.v, last.memory
        return SteppedState(q, w, memory)

    def saved_solutions(self) -> tuple[float, Array, list[SteppedState]]:
        """The time, the numbers that hold, and the solutions, none of which is written to."""
        return self.t, self._numbers, self._states

    def restore_solutions(self, saved: tuple[float, Array, list[SteppedState]]) -> None:
        """Go on from there."""
        self._t, self._numbers, self._states = saved
