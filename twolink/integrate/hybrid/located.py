"""Located motion: solutions of a scene with modes side by side, each with its own events; and the runs for samples."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from twolink.effects.sensors import Forces
from twolink.integrate.core.motion import Motion, again, driven
from twolink.integrate.forces_seen import forces_seen
from twolink.integrate.hybrid.engine import Engine
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.state import Array
from twolink.integrate.solution import Event, Progress, Solution, events_of
from twolink.integrate.steps.methods import Method
from twolink.integrate.steps.perturbation import NO_PERTURBATION, Perturbation
from twolink.loop.sampled_loop import SampledLoop
from twolink.native.programs import SPENT


class LocatedMotion(Motion):
    """Solutions with modes. endless: what they pass is not kept."""

    def __init__(self, engines: Sequence[Engine], *, endless: bool = False) -> None:
        self.engines, self._endless, self.equations = engines, endless, engines[0].whole
        self._rows = self.equations.layout.rows_of_slots()
        self._x = np.repeat(self.equations.start[:, None], len(engines), axis=1)

    @property
    def t(self) -> float:
        """The time, s."""
        return self.engines[0].run.t

    @property
    def x(self) -> Array:
        """The states."""
        return np.stack([engine.run.x for engine in self.engines], axis=1)

    @property
    def steps(self) -> int:
        """Accepted steps of the run."""
        return self.engines[0].steps

    @property
    def events(self) -> Sequence[Event]:
        """Events of the run so far."""
        return self.engines[0].run.events

    @property
    def ended(self) -> bool:
        """True if an event has ended the run."""
        return self.engines[0].run.ended

    @property
    def over(self) -> bool:
        """True if events have ended all solutions."""
        return all(engine.run.ended for engine in self.engines)

    def advance(self, t: float) -> None:
        """Go to a time, s."""
        for engine in self.engines:
            engine.advance(t)
            if self._endless:
                engine.forget()

    def held(self) -> Array:
        """The states with the numbers of the slots."""
        self._x[: self.equations.moving] = self.x
        for name, row in self._rows.items():
            self._x[row] = [engine.run.system.held.get(name, 0.0) for engine in self.engines]
        return self._x

    def hold(self, x: Array) -> None:
        """Let the numbers of the slots hold from now on."""
        for engine, own in zip(self.engines, x.T, strict=True):
            run, held = engine.run, {name: float(own[row]) for name, row in self._rows.items()}
            if any(run.system.held.get(name, 0.0) != value for name, value in held.items()):
                noted = len(run.events)
                engine.hold(held)
                if run.t <= engine.times[0]:  # the mode at the start is no event
                    del run.events[noted:]

    def forces(self, *_: object) -> Forces:
        """The forces that sensors feel in each solution, which has its own mode."""
        each = [forces_seen(one.run.own.equations, one.run.t, one.run.full_state()[:, None]) for one in self.engines]
        return Forces(
            [robot for one in each for robot in one.robots],
            np.concatenate([one.a for one in each]),
            np.concatenate([one.tau for one in each]),
            [row for one in each for row in one.wrenches],
            lambda link: np.concatenate([one.on(link) for one in each]),
        )

    def save(self) -> list[Engine]:
        """A copy of each engine."""
        return [engine.copied() for engine in self.engines]

    def restore(self, saved: Any) -> None:
        """Go on from there."""
        self.engines = [engine.copied() for engine in saved]


@again
def solve_located(
    equations: Equations,
    method: Method,
    times: Array,
    setting: float,
    progress: Progress | None = None,
    perturbations: tuple[Perturbation, ...] = (NO_PERTURBATION,),
    checks: Array | None = None,
) -> list[Solution]:
    """Solve a scene with modes: the run for samples at times (n,), the others at the checks (k,), with controllers.

    Each has its own modes, events and controllers. Raises ControllerError, whose `run` is the run so far.
    """
    engines = [Engine(equations, method, times if checks is None or not i else checks, setting,
                      None if i else progress, one) for i, one in enumerate(perturbations)]  # fmt: skip
    motion, before = LocatedMotion(engines), SPENT.seconds
    run, *others = driven(motion, float(times[-1]), equations.sampling, functools.partial(_solutions, motion))
    return [replace(run, compile_seconds=SPENT.seconds - before), *others]


def _solutions(motion: LocatedMotion, loop: SampledLoop | None, interrupted: bool, _: float) -> list[Solution]:
    """All so far; the first with readings and ambiguous ticks."""
    run, *others = (replace(engine.solution(), interrupted=interrupted) for engine in motion.engines)
    if loop is None:
        return [run, *others]
    readings = {name: one.until(motion.t) for name, one in loop.readings.items()}
    events = (*run.events, *(event for event in events_of(loop) if event.t <= motion.t))
    segments = (replace(run.segments[0], readings=readings), *run.segments[1:])
    return [replace(run, segments=segments, events=tuple(sorted(events, key=lambda event: event.t))), *others]
