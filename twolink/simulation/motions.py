"""Motions that go on from call to call: smooth, with located events, and with stepped contacts.

Each has the time t, the states x (moving, n) of its solutions, whether it has ended, and its events so far; it takes
numbers that hold, such as torques, advances to a time, and tells how far its solutions are apart. `StepwiseMotion`
advances from tick to tick, where the scene has sampled controllers or sensors.
"""

from __future__ import annotations

import copy
import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

import numpy as np

from twolink.contact.solver import no_forces, stepper_of
from twolink.contact.steps import Plan, Record
from twolink.effects.sensors import Forces
from twolink.integrate.event import Event
from twolink.integrate.forces_seen import forces_seen
from twolink.integrate.hybrid.ticks import TickEngine, forces_in_modes
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.state import Array
from twolink.integrate.solvers.ticks import Lanes
from twolink.integrate.steps.methods import METHODS
from twolink.integrate.steps.perturbation import NO_PERTURBATION, disturbed_solutions, finer_solution
from twolink.integrate.steps.step_map import StepMap
from twolink.loop.clock import SAME_TIME
from twolink.loop.sampled_loop import SampledLoop, Sampling
from twolink.scenes import Scene
from twolink.simulation.error_bar import DISTURBED, common_rounding, distances, error_bar, truncation_factor
from twolink.simulation.stepped_run import SAFETY

METHOD = METHODS["dop853"]
ROUNDED = 2  # solutions that are disturbed by rounding, with verify
MANY = 1_000_000  # steps, after which the count of steps begins anew


def solutions_of(tolerance: float, *, verify: bool) -> tuple[Any, ...]:
    """The perturbations of a motion, and of those that show its error."""
    others = (finer_solution(METHOD, tolerance), *disturbed_solutions(ROUNDED)) if verify else ()
    return NO_PERTURBATION, *others


def distance_of(equations: Equations, x: Array, steps: int) -> float:
    """A bound on the error of the first of the solutions x (moving, n), rad or m, after so many steps."""
    space = equations.space
    off = distances(space, x[None, :, :1], x[None, :, 1:])[0]
    bar = truncation_factor(METHOD, steps) * off[0] + DISTURBED[ROUNDED] * off[1:].max()
    same = common_rounding(space, np.array([0.0, 1.0]), np.stack([x[:, 0]] * 2), steps)[1]
    return float(error_bar(np.array([bar]), np.zeros(1))[0] + same)


class StepwiseMotion(ABC):
    """What the three kinds have in common. loop: the controllers and sensors; None where the scene has none."""

    loop: SampledLoop | None = None
    equations: Equations

    @property
    @abstractmethod
    def t(self) -> float:
        """The time, s."""

    @property
    def events(self) -> Sequence[Event]:
        """What has happened."""
        return ()

    @property
    def ended(self) -> bool:
        """Whether an event has ended it."""
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


class Smooth(StepwiseMotion):
    """Solutions as lanes of one batch. span: the time that sets their first steps, s."""

    def __init__(
        self, equations: Equations, by: StepMap, t: float, span: float, tolerance: float, solutions: tuple[Any, ...]
    ) -> None:
        self.equations, self._steps = equations, 0
        self._map, self._span, self._tolerance, self._solutions = by, span, tolerance, solutions
        self._lanes = self._begun(equations, t)

    def _begun(self, equations: Equations, t: float) -> Lanes:
        self._map.equations = equations
        return Lanes(self._map, t, t + self._span, self._tolerance, self._solutions)

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
        """A bound on the error, rad or m."""
        return distance_of(self.equations, self.x, self._steps + self._lanes.counts[0])

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

    def save(self) -> tuple[Lanes, Array, int]:
        """All that it goes on from."""
        return copy.copy(self._lanes), self._lanes.state.copy(), self._steps

    def restore(self, saved: tuple[Lanes, Array, int]) -> None:
        """Go on from there."""
        lanes, state, self._steps = saved
        self._lanes = copy.copy(lanes)
        self._lanes.state = state.copy()


class Located(StepwiseMotion):
    """Solutions with modes, each with its own events."""

    def __init__(self, equations: Equations, t: float, tolerance: float, solutions: tuple[Any, ...]) -> None:
        self.equations = equations
        self._rows = equations.layout.rows_of_slots()
        times = np.array([t, math.inf])
        self._engines = [TickEngine(equations, METHOD, times, tolerance, None, one) for one in solutions]

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
        """What has happened."""
        return self._engines[0].run.events

    @property
    def ended(self) -> bool:
        """Whether an event has ended it."""
        return self._engines[0].run.ended

    @property
    def apart(self) -> float:
        """A bound on the error, rad or m."""
        return distance_of(self.equations, self.x, self._engines[0].steps)

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

    def save(self) -> list[Any]:
        """All that it goes on from."""
        return [engine.saved() for engine in self._engines]

    def restore(self, saved: list[Any]) -> None:
        """Go on from there."""
        for engine, one in zip(self._engines, saved, strict=True):
            engine.restore(one)


class Stepped(StepwiseMotion):
    """A motion with stepped contacts, and with verify one of three times as many steps. step: the longest, s."""

    t = 0.0

    def __init__(self, scene: Scene, t: float, step: float, *, verify: bool) -> None:
        self._stepper, self._step, self.t = stepper_of(scene), step, t
        self.equations = equations = self._stepper.equations
        self._stepper.record, nq = Record(), equations.space.nq
        numbers = equations.layout.numbers_at(t)
        self._numbers = np.repeat(numbers[:, None], 2 if verify else 1, axis=1)
        q, v = np.array(equations.start[:nq]), np.array(equations.start[nq : equations.moving])
        w = self._stepper.bodies.to_local_velocity(q, v, -1)
        self._states = [(q, w, self._stepper.start(t, q, w, numbers))] * (2 if verify else 1)

    @property
    def x(self) -> Array:
        """The states."""
        local = self._stepper.bodies.to_local_velocity
        return np.stack([np.concatenate([q, local(q, w)]) for q, w, _ in self._states], axis=1)

    @property
    def apart(self) -> float:
        """An estimate of the error, rad or m: of first order, a third of the step has a third of it."""
        (q, *_), (other, *_) = self._states
        off = 1.5 * self.equations.space.distance(q[None], other[None])
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
        self._states = [self._solved(k, t, count * 3**k) for k in range(len(self._states))]
        self.t = t

    def _solved(self, number: int, end: float, count: int) -> tuple[Any, ...]:
        h, first, (q, w, memory) = (end - self.t) / count, 0, self._states[number]
        steps = np.arange(count)
        plan = Plan(self.t + h * steps, np.full(count, h), 0 * steps, steps < 0, self._numbers[None, :, number])
        while first < count:
            found = self._stepper.run(plan, first, count, q, w, memory)
            last, first = found[len(found) - 1], first + len(found)
            q, w, memory = last.q, last.v, last.memory
        return q, w, memory

    def save(self) -> tuple[Any, ...]:
        """All that it goes on from."""
        return self.t, self._numbers, list(self._states), self._stepper.ahead

    def restore(self, saved: tuple[Any, ...]) -> None:
        """Go on from there."""
        self.t, self._numbers, states, self._stepper.ahead = saved
        self._states = list(states)
