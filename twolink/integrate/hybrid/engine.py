"""The hybrid engine: one solution of a scene with modes, from event to event.

mode -> equations -> steps to the first zero of a guard -> its transition -> consistent mode -> and so on

A mode goes on where controllers change held numbers, with the steps of its method, unless these break one of its
laws: then the next mode begins there.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from twolink.effects.switching import same_time
from twolink.errors import AccuracyError
from twolink.integrate.core.columns import Columns
from twolink.integrate.hybrid.consistency import SLOW
from twolink.integrate.hybrid.least_bounce import LeastBounce
from twolink.integrate.hybrid.locating import GuardWatcher, Hit, OpenSegment
from twolink.integrate.hybrid.modes import SLOW_SLIP
from twolink.integrate.hybrid.snapshot import Snapshot
from twolink.integrate.hybrid.state import RunState
from twolink.integrate.hybrid.transitions import fire_timed, guards_of
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.state import Array
from twolink.integrate.solution import Progress, Solution, joined
from twolink.integrate.steps.methods import Method
from twolink.integrate.steps.perturbation import Perturbation
from twolink.integrate.steps.step_map import step_map
from twolink.integrate.steps.stepping import BLOCK

AT_ONCE = 200  # events at one time
MAX_EVENTS = 100_000
FIRST_BLOCK = 8  # steps between two looks for events, before a segment has shown how many it takes
LAST = 1e-3  # of the time of a slip that has turned: its last part, which begins anew
SLOWLY = 100.0  # times SLOW: slower slips do not begin anew
MANY = 1e6  # times the length of a short piece, to which its steps are meant to go
STRAIGHT = 1e-6  # the sine of the angle between a slip and its first direction: it has not turned
SMALLEST_RATE = 1e-300  # so that a division has a result


@dataclass
class Engine:
    """One solution: segments between events and breaks, up to the last of `times`."""

    whole: Equations
    method: Method
    times: Array
    setting: float
    progress: Progress | None
    perturbation: Perturbation

    def __post_init__(self) -> None:
        adaptive, finer = self.method.adaptive, self.perturbation.finer
        tolerance = self.setting / finer if adaptive else 0.0
        least = LeastBounce.of_run(self.method, self.setting, finer)
        # A slip begins like t or t^2 and turns like t: what `slow` changes in it is of the order slow^1.5.
        slow = max(tolerance ** (2 / 3), SLOW_SLIP)
        self.run = RunState(self.whole, float(self.times[0]), least, slow)
        self.end, self.at_once = float(self.times[-1]), 0
        self._span, self._block = self.end - self.run.t, FIRST_BLOCK
        self._stops = self._begin()
        self._parts: list[Solution] = []
        self._open: OpenSegment | None = None
        self._done = 0

    def _begin(self) -> list[float]:
        """Find the mode at the start. Returns the times at which segments end."""
        run = self.run
        if self.end < math.inf:  # else who asks for a step says how far
            self.whole.require(run.t, self.end)
        run.require_room("the start")
        run.resolve_mode()
        run.events.clear()  # the mode at the start is no event
        if fire_timed(run):
            run.resolve_mode()
        return [*(t for t in self.whole.breaks(self.end) if t > run.t), self.end]

    @property
    def steps(self) -> int:
        """Accepted steps."""
        return self._done + (0 if self._open is None else self._open.columns.counts[0])

    def advance(self, end: float) -> None:
        """Go to a time, or to where the run ends. Raises AccuracyError and SceneError."""
        run = self.run
        try:
            while run.t < end and not run.ended:
                stop = next(t for t in self._stops if t > run.t)
                fresh, to = self._open is None, min(stop, end)
                segment = self._opened()
                hit = segment.advance(to, self._block if to == stop else 1)
                if hit is not None and fresh and not self.method.adaptive:
                    hit = self._resolved(hit, to)
                elif hit is not None and hit.guard.key[0] == "roll" and self._begins_anew(segment, hit):
                    continue
                if hit is not None or to == stop < self.end:
                    self._close(hit, to)
                else:
                    run.t, run.x = to, segment.x[: self.whole.moving].copy()
        except AccuracyError as error:
            error.data.setdefault("t", run.t)  # also of what fails in an event, such as an impact
            raise

    def hold(self, numbers: Mapping[str, float]) -> None:
        """Let numbers, by the names of their slots, hold from now on."""
        run = self.run
        if run.ended:
            return
        run.system = run.system.with_held(numbers)
        if self._open is None:
            run.resolve_mode()
        elif self._keeps_laws(self._open):
            self._open.hold(run.system.held)
        else:
            self._close(None, run.t)

    def _keeps_laws(self, segment: OpenSegment) -> bool:
        """True if the laws of the mode of a segment hold with the numbers that hold now."""
        forces = [guard for guard in segment.watcher.guards if guard.of == "force"]
        snapshot = self.run.evaluate() if forces else None
        with np.errstate(all="ignore"):
            return snapshot is None or all(np.asarray(one.value(snapshot)).item() > one.noise for one in forces)

    def solution(self) -> Solution:
        """The samples so far, with the events, and the state where one ended the run."""
        run = self.run
        if self._open is not None and run.t == self.end:
            self._close(None, self.end)
        elif self._open is not None or not self._parts:
            self._parts.append(self._opened().solution(run.t, run.x.copy()))
            self._open = None
        self._end_after_events()
        solution = joined(self._parts)
        if run.ended and not (len(solution.t) and solution.t[-1] == run.t):
            solution = _with_sample(solution, run.t, run.x)
        events = tuple(sorted(run.events, key=lambda event: event.t))
        return replace(solution, events=events, impulses=tuple(run.impulses))

    def _end_after_events(self) -> None:
        """Give a sample at the last events the state after them, in a segment of its own, as samples between have."""
        run, last = self.run, self._parts[-1]
        segment, is_sampled = last.segments[-1], len(last.t) > 0 and last.t[-1] == run.t
        if run.t < self.end and is_sampled:  # by a segment that was open
            return
        if run.t == self.end:
            if segment.begin == run.t or not any(event.t == run.t for event in run.events):
                return
            if is_sampled:  # before the events
                segment = replace(segment, samples=segment.samples - 1)
                self._parts[-1] = replace(last, t=last.t[:-1], x=last.x[:, :-1], segments=(segment,))
        if run.t in self.times:
            self._parts.append(self._opened().solution(run.t, run.x.copy()))
            self._open = None

    def forget(self) -> None:
        """Keep no more than the present, for a run whose solution is not asked for."""
        self._parts.clear()
        if self._open is not None:
            self._open.track.forget()

    def copied(self) -> Engine:
        """An engine that goes on from here with the same bits, whatever this one does; its samples are not copied."""
        other = copy.copy(self)
        other.run, other._open, other._parts = self.run.copied(), self._open and self._open.copied(), []
        return other

    def _opened(self) -> OpenSegment:
        """The segment that goes on from now."""
        if self._open is None:
            self._open = self._segment(self.setting)
        return self._open

    def _segment(self, setting: float, until: float = math.inf) -> OpenSegment:
        """A segment from now on in the mode of the run, of equations that hold up to a break.

        until: the time to which it is meant to go at most; its steps are limited by that.
        """
        self.run.drop_open_features()
        run = self.run
        stop = next((t for t in self._stops if t > run.t), self.end)
        equations = replace(run.own.equations, start=run.full_state(0.5 * (run.t + stop)))
        steps, snapshot, space = step_map(equations, self.method), run.evaluate(), equations.space
        watcher = GuardWatcher(run.own.evaluate, steps, guards_of(run, snapshot), self.perturbation.touch_margin)
        x = snapshot.x
        rate = np.concatenate([space.rate(x[: space.nq], x[space.v_rows]), snapshot.a, snapshot.rates])
        columns = Columns(steps, run.t, min(self.end, until), setting, (self.perturbation,), self.progress, rate=rate)
        if self.method.adaptive:
            columns.shorten(_turning_time(run, snapshot))
        first = np.searchsorted(self.times, run.t)
        return OpenSegment(columns, watcher, self.times[first:])

    def _resolved(self, hit: Hit, to: float) -> Hit | None:
        """The event at the end of a segment of a few steps of fixed size, with more: else half the step takes as many.

        Their number grows with the root of the run's; a finer solution beside a run takes as many more as elsewhere.
        """
        run, length, found = self.run, hit.t - self.run.t, hit
        step = self.setting / self.perturbation.finer
        count = self.perturbation.finer * max(4.0, math.sqrt(self._span / self.setting))
        while 0.0 < length < count * step:
            end = run.t + 2.0 * length
            self._open = self._segment(self.perturbation.finer * length / count, run.t + MANY * length)
            again = self._open.advance(min(end, to))
            if again is not None or end >= to:
                return again
            length *= 2.0  # the event is later than the few steps showed
        return found

    def _begins_anew(self, segment: OpenSegment, hit: Hit) -> bool:
        """True if a slip that has turned begins anew just before its end, in a segment with its present direction.

        Friction turns by (slow / slip)^2 to the direction in which the slip began, which no step to the end sees.
        """
        run, i = self.run, hit.guard.key[1]
        x, along, ahead = segment.columns.x, run.mode.directions[i], hit.t - segment.columns.time
        slip = segment.watcher.evaluate(np.array([segment.columns.time]), x).contacts[i, 2:4, 0]
        speed, turned = math.hypot(*slip), abs(slip[0] * along[1] - slip[1] * along[0])
        if segment.is_anew or ahead <= 0.0 or turned <= STRAIGHT * speed or speed <= SLOWLY * SLOW:
            return False
        # Of the segment, not of the step, so that a finer solution begins anew at the same time, but for its error.
        nearer = hit.t - min(0.5 * ahead, LAST * (hit.t - segment.begin))
        if segment.advance(nearer, 1) is not None:  # what is nearly at once is left as it is
            return False
        self._close(None, nearer)
        x, y = run.evaluate().contacts[i, 2:4, 0].tolist()
        if run.mode.contacts[i] == "sliding" and (size := math.hypot(x, y)):
            run.mode = run.mode.with_contact(i, "sliding", (x / size, y / size))
        self._opened().is_anew = True
        return True

    def _close(self, hit: Hit | None, stop: float) -> None:
        """End the segment at an event, or at a time, with what happens there."""
        segment, run = self._opened(), self.run
        last = np.array((segment.x if hit is None else hit.x)[: self.whole.moving])
        run.t, run.x = stop if hit is None or same_time(hit.t, stop) else hit.t, last.copy()
        # A sample at an event has the state after it, with which the next segment begins.
        self._parts.append(segment.solution(run.t, last, before=run.t < self.end))
        taken = 4 + 5 * sum(segment.columns.counts) // 4  # the next segment may be about as long
        self._block = min(max(taken, self._block // 2, FIRST_BLOCK), BLOCK)
        self._done, self._open = self.steps, None
        for guard in segment.watcher.guards:
            if guard.key[0] == "trigger" and guard.side is not None:
                run.sides[guard.key] = guard.side
        self._transit(hit, segment.begin, stop)

    def _transit(self, hit: Hit | None, begin: float, stop: float) -> None:
        """Cause what happens at the end of a segment. Raises AccuracyError where that has no end."""
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


def _turning_time(run: RunState, snapshot: Snapshot) -> float:
    """The time in which the slowest slip may take another direction, s: that in which it grows by its own size.

    Its friction turns as fast. A first step over that tells nothing of its error, at any tolerance.
    """
    both = zip(run.mode.contacts, run.system.contacts, strict=True)
    slides = [k for k, (kind, contact) in enumerate(both) if kind == "sliding" and contact.friction]
    slowest = np.linalg.norm(snapshot.contacts[slides, 2:4, 0], axis=1).min(initial=math.inf)
    return float((slowest + run.system.slow) / max(SMALLEST_RATE, np.abs(snapshot.a).max()))


def _with_sample(part: Solution, t: float, x: Array) -> Solution:
    """A solution with a sample more, of its last segment."""
    *before, last = part.segments
    return replace(part, t=np.append(part.t, t), x=np.concatenate([part.x, x[:, None]], axis=1),
                   segments=(*before, replace(last, samples=last.samples + 1)))  # fmt: skip
