"""The hybrid engine: a scene with modes, from event to event.

mode -> equations -> steps to the first zero of a guard -> its transition -> consistent mode -> and so on
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from twolink.errors import AccuracyError
from twolink.integrate.hybrid.locating import Guard, GuardWatcher, Hit
from twolink.integrate.hybrid.state import RunState
from twolink.integrate.hybrid.transitions import fire_timed, guards_of, same_time
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.state import Array
from twolink.integrate.solution import Piece, Progress, Solution, joined
from twolink.integrate.solvers.pieces import piece_times
from twolink.integrate.steps.methods import Method
from twolink.integrate.steps.perturbation import NO_PERTURBATION, Perturbation
from twolink.integrate.steps.step_map import StepMap, step_map
from twolink.integrate.steps.stepping import BLOCK, integrate

AT_ONCE = 200  # events at one time
MAX_EVENTS = 100_000
FIRST_BLOCK = 8  # steps between two looks for events, before a piece has shown how many it takes
SMALL_BOUNCE = 1e-2  # of the tolerance: lower bounces are not followed
SMALLEST_BOUNCE = 1e-13  # m or rad: what numbers resolve


def solve(
    equations: Equations,
    method: Method,
    times: Array,
    setting: float,
    progress: Progress | None = None,
    perturbation: Perturbation = NO_PERTURBATION,
) -> Solution:
    """Solve a scene with modes for the samples `times` (n,). Raises AccuracyError and SceneError."""
    return Engine(equations, method, times, setting, progress, perturbation).solution()


@dataclass
class Engine:
    """One solution: pieces between events and breaks, up to the last of `times`."""

    whole: Equations
    method: Method
    times: Array
    setting: float
    progress: Progress | None
    perturbation: Perturbation

    def __post_init__(self) -> None:
        small = SMALL_BOUNCE * self.setting / self.perturbation.finer if self.method.adaptive else 0.0
        self.run = RunState(self.whole, float(self.times[0]), max(small, SMALLEST_BOUNCE))
        self.end, self.at_once = float(self.times[-1]), 0
        self.span = self.end - self.run.t
        self.block = FIRST_BLOCK

    def solution(self) -> Solution:
        """The samples up to the end, or to where the run ends or is interrupted."""
        run, stops = self.run, self._begin()
        parts: list[Solution] = []
        try:
            while run.t < self.end and not run.ended:
                parts.append(self._next(next(t for t in stops if t > run.t), first=not parts))
                if parts[-1].interrupted:
                    break
        except AccuracyError as error:
            error.data.setdefault("t", run.t)  # also of what fails in an event, such as an impact
            raise
        except KeyboardInterrupt:
            if not parts:
                raise
            parts[-1] = replace(parts[-1], interrupted=True)
        return self._joined(parts)

    def _begin(self) -> list[float]:
        """Find the mode at the start. Returns the times at which pieces end."""
        run = self.run
        self.whole.require(run.t, self.end)
        run.require_room("the start")
        run.resolve_mode()
        run.events.clear()  # the mode at the start is no event
        if fire_timed(run):
            run.resolve_mode()
        return [*(t for t in self.whole.breaks(self.end) if t > run.t), self.end]

    def _joined(self, parts: list[Solution]) -> Solution:
        """The solution of its pieces, with the events, and the state where one ended the run."""
        run, solution = self.run, joined(parts)
        if run.ended and solution.t[-1] < run.t:
            solution = _with_sample(solution, run.t, run.x)
        events = tuple(sorted(run.events, key=lambda event: event.t))
        return replace(solution, events=events, impulses=tuple(run.impulses))

    def _next(self, stop: float, *, first: bool) -> Solution:
        """The next piece, and the transition at its end."""
        run, begin = self.run, self.run.t
        grid, extra = piece_times(self.times, begin, stop)
        equations, part, hit = self._piece(grid, stop)
        taken = slice(0 if first else 1, len(part.t) - int(extra and len(part.t) == len(grid)))
        moving = self.whole.moving
        last = np.array((part.x[:, -1] if hit is None else hit.x)[:moving])
        kept = replace(part, t=part.t[taken], x=part.x[:moving, taken],
                       pieces=(Piece(equations, begin, len(part.t[taken]), part.taken, last),))  # fmt: skip
        if part.interrupted:
            return kept
        if hit is not None and not extra and same_time(hit.t, stop) and kept.t[-1:] != stop:
            kept = _with_sample(kept, stop, hit.x[:moving])
        run.t = stop if hit is None or same_time(hit.t, stop) else hit.t
        run.x = last.copy()
        self._transit(hit, begin, stop)
        return kept

    def _transit(self, hit: Hit | None, begin: float, stop: float) -> None:
        """Cause what happens at the end of a piece. Raises AccuracyError where that has no end."""
        run = self.run
        if not same_time(run.t, begin):
            self.at_once = 0
            run.moved_on()
        self.at_once += 1
        if hit is not None:
            run.fired.add(hit.guard.key)
            hit.guard.transition(run)
        if run.t == stop:
            before = run.mode
            if fire_timed(run) or run.t < self.end:
                run.resolve_mode(before)
        if self.at_once > AT_ONCE or len(run.events) > MAX_EVENTS:
            raise AccuracyError("events follow each other without end", where=f"t = {run.t:.9g} s",
                                remedy="more restitution, smooth friction, or a shorter duration",
                                code="events-without-end", t=run.t)  # fmt: skip

    def _in_mode(self, stop: float) -> tuple[StepMap, GuardWatcher, Array]:
        """The steps of the mode, of equations that hold up to a break; its guards; and the rate at the start."""
        self.run.drop_open_features()
        run, state = self.run, self.run.mode_state
        equations = replace(state.own.equations, start=state.full_state(0.5 * (run.t + stop)))
        steps = step_map(equations, self.method)
        snapshot = state.evaluate()
        watcher = GuardWatcher(state.own.evaluate, steps, guards_of(run, snapshot), self.perturbation.touch_margin)
        space, x = equations.space, snapshot.x
        rate = np.concatenate([space.rate(x[: space.nq], x[space.v_rows]), snapshot.a, snapshot.rates])
        return steps, watcher, rate

    def _keep_sides(self, guards: Sequence[Guard]) -> None:
        """Keep on which side triggers are."""
        for guard in guards:
            if guard.key[0] == "trigger" and guard.side is not None:
                self.run.sides[guard.key] = guard.side

    def _piece(self, grid: Array, stop: float) -> tuple[Equations, Solution, Hit | None]:
        """Solve from now to the next event or stop."""
        steps, watcher, rate = self._in_mode(stop)
        part = integrate(steps, grid, self.setting, self.progress, perturbation=self.perturbation, watcher=watcher,
                         span=self.span, rate=rate, first_block=self.block)  # fmt: skip
        taken = 4 + 5 * (part.steps + part.rejected) // 4  # the next piece may be about as long
        self.block = min(max(taken, self.block // 2, FIRST_BLOCK), BLOCK)
        if part.hit is not None and not self.method.adaptive:
            part = self._resolved(part, steps, watcher, grid)
        self._keep_sides(watcher.guards)
        return steps.equations, part, part.hit

    def _resolved(self, part: Solution, steps: StepMap, watcher: GuardWatcher, grid: Array) -> Solution:
        """A piece of a few steps of fixed size again in more: else half the step would take the same ones.

        Their number grows with the root of the run's, so that a finer run is finer here too.
        """
        length = float(part.hit.t) - float(grid[0])
        step = self.setting / self.perturbation.finer
        count = max(4.0, math.sqrt(self.span / step))
        while part.hit is not None and 0.0 < length < count * step:
            end = float(grid[0]) + 2.0 * length
            shorter = np.append(grid[grid < end], end) if end < grid[-1] else grid
            again = integrate(steps, shorter, length / count, self.progress, watcher=watcher)
            if again.hit is not None or end >= grid[-1]:
                return again
            length *= 2.0  # the event is later than the few steps showed
        return part


def _with_sample(part: Solution, t: float, x: Array) -> Solution:
    """A solution with a sample more, of its last piece."""
    *before, last = part.pieces
    return replace(part, t=np.append(part.t, t), x=np.concatenate([part.x, x[:, None]], axis=1),
                   pieces=(*before, replace(last, samples=last.samples + 1)))  # fmt: skip
