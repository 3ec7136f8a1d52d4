"""Ticks of a scene with modes: solutions from tick to tick, each with its own modes and controllers.

A mode goes on across ticks, with the steps of its method, unless the new numbers break one of its laws: then the next
mode begins at the tick.
"""

import copy
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from twolink.effects.sensors import Forces
from twolink.errors import ControllerError
from twolink.integrate.event import Event, events_of
from twolink.integrate.forces_seen import forces_seen
from twolink.integrate.hybrid.engine import FIRST_BLOCK, Engine
from twolink.integrate.hybrid.locating import GuardWatcher, Hit
from twolink.integrate.hybrid.state import RunState
from twolink.integrate.hybrid.transitions import same_time
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.state import Array
from twolink.integrate.solution import Piece, Progress, Solution
from twolink.integrate.solvers.ticks import Lanes, Passed
from twolink.integrate.steps.methods import Method
from twolink.integrate.steps.perturbation import NO_PERTURBATION, Perturbation
from twolink.integrate.steps.step_map import StepMap
from twolink.loop.clock import SAME_TIME
from twolink.loop.readings import Readings
from twolink.loop.sampled_loop import SampledLoop, Sampling

SHORT = 1e-3  # of the time to a tick: what is left is part of the step before it


class OpenPiece:
    """A piece in one mode that goes on. t, x: where its steps ended, and the states (size,) with the held numbers.

    parts: steps from tick to tick, at least.
    """

    def __init__(self, steps: StepMap, watcher: GuardWatcher, lanes: Lanes, parts: int) -> None:
        self.steps, self.watcher, self._lanes, equations = steps, watcher, lanes, steps.equations
        self._parts = parts
        self.begin, self.t, self.x = lanes.time, [lanes.time], [lanes.x[:, 0].copy()]
        self._rows = equations.layout.rows_of_slots()

    def copied(self) -> "OpenPiece":
        """A piece that goes on from here with the same bits, whatever this one does."""
        other = copy.copy(self)
        other.watcher, other._lanes = self.watcher.copied(), self._lanes.copied()
        other.t, other.x = list(self.t), list(self.x)
        return other

    def advance(self, end: float) -> Hit | None:
        """Advance to a time, or to the first event."""
        lanes, length = self._lanes, end - self._lanes.time
        while lanes.time < end:
            far = lanes.time + min(FIRST_BLOCK * lanes.step, length / self._parts)
            on_the_way: Passed = []
            lanes.advance(far if far < end - SHORT * length else end, passed=on_the_way)
            t = [self.t[-1], *(at for at, _ in on_the_way), lanes.time]
            x = [self.x[-1], *(state for _, state in on_the_way), lanes.x[:, 0].copy()]
            hit = self.watcher.first(np.array(t), np.array(x))
            before = len(t) if hit is None else int(np.searchsorted(t, hit.t))
            self.t += t[1:before]
            self.x += x[1:before]
            if hit is not None:
                return hit
        return None

    @property
    def steps_taken(self) -> int:
        """Accepted steps."""
        return self._lanes.counts[0]

    def forget(self) -> None:
        """Keep no more than the present."""
        del self.t[:-1], self.x[:-1]

    def hold(self, engine: "TickEngine") -> bool:
        """Let the numbers of an engine hold from now on; whether the laws of the mode do then too."""
        forces = [guard for guard in self.watcher.guards if guard.is_force]
        if forces:
            snapshot = engine.run.mode_state.evaluate()
            with np.errstate(all="ignore"):
                if not all(np.asarray(one.value(snapshot)).item() > one.noise for one in forces):
                    return False
        for name, value in engine.run.system.held.items():
            if name in self._rows:
                self._lanes.x[self._rows[name]] = value
        self.x[-1] = self._lanes.x[:, 0].copy()
        return True

    def solution(self, times: Array, end: float, last: Array, *, first: bool) -> Solution:
        """The piece up to its end, with the samples at those of times (n,) within it."""
        steps, t, x = self.steps, np.array(self.t), np.array(self.x)
        equations, moving, method = steps.equations, steps.equations.moving, steps.method
        begin, after = np.searchsorted(times, [t[0], end], side="right")
        inside = times[begin - int(first) : after]
        step = np.searchsorted(t, inside, side="right") - 1
        samples, between = x[step].T, t[step] < inside
        if between.any():
            samples[:, between] = steps.partial(samples[:, between], t[step[between]], inside[between])
        accepted, rejected = self._lanes.counts
        evaluations = (accepted + rejected + len(inside)) * method.evaluations
        piece = Piece(equations, float(t[0]), len(inside), (t, x[:, :moving]), last, x[:, moving:])
        return Solution(inside, samples[:moving], accepted, evaluations, rejected, steps.compile_seconds,
                        steps.compiled, pieces=(piece,))  # fmt: skip


class SavedEngine(NamedTuple):
    """State of a `TickEngine`: its run, the piece that goes on, accepted steps before it, and events at this instant.

    stops: at which pieces end, s.
    """

    run: RunState
    piece: OpenPiece | None
    done: int
    at_once: int
    stops: list[float]


class TickEngine(Engine):
    """A solution that goes from tick to tick, with numbers that hold in between."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._stops, self._parts = self._begin(), list[Solution]()
        self._open: OpenPiece | None = None
        self._done = 0

    @property
    def steps(self) -> int:
        """Accepted steps."""
        return self._done + (0 if self._open is None else self._open.steps_taken)

    def advance(self, end: float) -> None:
        """Go to a time, or to where the run ends."""
        run = self.run
        while run.t < end and not run.ended:
            stop = next(t for t in self._stops if t > run.t)
            piece, to = self._opened(), min(stop, end)
            hit = piece.advance(to)
            if hit is not None or to == stop < self.end:
                self._close(hit, to)
            else:
                run.t, run.x = to, piece.x[-1][: self.whole.moving].copy()

    def hold(self, numbers: Mapping[str, float]) -> None:
        """Let numbers, by the names of their slots, hold from now on."""
        run = self.run
        if run.ended:
            return
        run.system = run.system.holding(numbers)
        if self._open is None:
            run.resolve_mode()
        elif not self._open.hold(self):
            self._close(None, run.t)

    def solution(self) -> Solution:
        """The samples so far."""
        if self._open is not None and self.run.t == self.end:
            self._close(None, self.end)
        elif self._open is not None or not self._parts:
            self._parts.append(
                self._opened().solution(self.times, self.run.t, self.run.x.copy(), first=not self._parts)
            )
            self._open = None
        return self._joined(self._parts)

    def forget(self) -> None:
        """Keep no more than the present, for a run whose solution is not asked for."""
        self._parts.clear()
        if self._open is not None:
            self._open.forget()

    def saved(self) -> SavedEngine:
        """All that it goes on from, in copies; its samples are not."""
        piece = None if self._open is None else self._open.copied()
        return SavedEngine(self.run.copied(), piece, self._done, self.at_once, self._stops)

    def restore(self, saved: SavedEngine) -> None:
        """Go on from where it was saved, with the same bits."""
        self.run, self._open = saved.run.copied(), None if saved.piece is None else saved.piece.copied()
        self._done, self.at_once, self._stops = saved.done, saved.at_once, saved.stops

    def _opened(self) -> OpenPiece:
        """The piece that goes on from now."""
        if self._open is None:
            run = self.run
            steps, watcher, rate = self._in_mode(next((t for t in self._stops if t > run.t), self.end))
            lanes = Lanes(steps, run.t, self.end, self.setting, (self.perturbation,), rate=rate)
            # Where a tick is shorter than a step, a finer solution would take the same ones.
            self._open = OpenPiece(steps, watcher, lanes, 2 if self.perturbation.finer > 1.0 else 1)
        return self._open

    def _close(self, hit: Hit | None, stop: float) -> None:
        """End the piece at an event, or at a time, with what happens there."""
        piece, run = self._opened(), self.run
        last = np.array((piece.x[-1] if hit is None else hit.x)[: self.whole.moving])
        run.t, run.x = stop if hit is None or same_time(hit.t, stop) else hit.t, last.copy()
        self._parts.append(piece.solution(self.times, run.t, last, first=not self._parts))
        self._done, self._open = self.steps, None
        self._keep_sides(piece.watcher.guards)
        self._transit(hit, piece.begin, stop)


def solve_ticks_in_modes(
    equations: Equations,
    sampling: Sampling,
    method: Method,
    times: Array,
    setting: float,
    progress: Progress | None = None,
    others: tuple[Perturbation, ...] = (),
    checks: Array | None = None,
) -> list[Solution]:
    """Solve a scene with modes and sampled controllers: the run for samples at times (n,), others at the checks (k,).

    Each has its own modes, events and controllers. Raises ControllerError, whose `run` is the run so far.
    """
    engines = [TickEngine(equations, method, times, setting, None, NO_PERTURBATION)]
    engines += [TickEngine(equations, method, times if checks is None else checks, setting, None, one)
                for one in others]  # fmt: skip
    ticks = _EngineTicks(engines, sampling)
    try:
        while ticks.loop.time <= engines[0].end * (1.0 + SAME_TIME) and not all(one.run.ended for one in engines):
            if progress is not None:
                progress(engines[0].run.t)
            ticks.go()
        for engine in engines:
            engine.advance(engine.end)
        ticks.loop.require_repeatable()
    except KeyboardInterrupt:
        return [replace(one, interrupted=True) for one in ticks.solutions()]
    except ControllerError as error:
        error.run = replace(ticks.solutions()[0], interrupted=True)
        raise
    return ticks.solutions()


class _EngineTicks:
    """Engines, the run's first, with the controllers and sensors that they have together."""

    def __init__(self, engines: list[TickEngine], sampling: Sampling) -> None:
        self._engines, whole = engines, engines[0].whole
        self._rows = whole.layout.rows_of_slots()
        self._x = np.repeat(whole.start[:, None], len(engines), axis=1)
        self._told: tuple[dict[str, Readings], list[Event]] | None = None
        self.loop = SampledLoop(sampling, self._rows, whole.space.states, self._states(),
                                lambda *_: forces_in_modes(engines))  # fmt: skip

    def go(self) -> None:
        """Go to the next tick, and let happen what is due there."""
        t = min(self.loop.time, self._engines[0].end)
        for engine in self._engines:
            engine.advance(t)
        if self._told is None and self._engines[0].run.ended:
            self._told = self._tell()
        rows, x = list(self._rows.values()), self._states()
        before = x[rows]
        self.loop.tick(x)
        for engine, old, new in zip(self._engines, before.T, x[rows].T, strict=True):
            if not np.array_equal(old, new):
                noted = len(engine.run.events)
                engine.hold(dict(zip(self._rows, new.tolist(), strict=True)))
                if t <= engine.times[0]:  # the mode at the start is no event
                    del engine.run.events[noted:]

    def solutions(self) -> list[Solution]:
        """All so far; the first with readings and ambiguous ticks."""
        run, *others = (engine.solution() for engine in self._engines)
        readings, ambiguous = self._told or self._tell()
        pieces = (replace(run.pieces[0], readings=readings), *run.pieces[1:])
        events = tuple(sorted((*run.events, *ambiguous), key=lambda event: event.t))
        return [replace(run, pieces=pieces, events=events), *others]

    def _tell(self) -> tuple[dict[str, Readings], list[Event]]:
        """The readings and the ambiguous ticks so far."""
        return self.loop.readings, events_of(self.loop)

    def _states(self) -> Array:
        """The states (size, n) now, with the numbers that hold."""
        for i, engine in enumerate(self._engines):
            self._x[: len(engine.run.x), i] = engine.run.x
        return self._x


def forces_in_modes(engines: Sequence[TickEngine]) -> Forces:
    """Forces that sensors feel in each solution, which has its own mode."""
    states = [engine.run.mode_state for engine in engines]
    each = [forces_seen(one.own.equations, one.t, one.full_state()[:, None]) for one in states]
    return Forces(
        np.concatenate([one.a for one in each]),
        np.concatenate([one.tau for one in each]),
        [row for one in each for row in one.wrenches],
        lambda link: np.concatenate([one.on(link) for one in each]),
    )
