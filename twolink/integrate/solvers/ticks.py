"""Ticks: solving from tick to tick, where controllers change the numbers that a state holds in between.

`Lanes` is the stepping core: some solutions of one scene as columns of a state array. Their steps end at the times that
are asked for, and go on as if they had not.
"""

import functools
import math

import numpy as np

from twolink.effects.inputs import Sampled, Slot
from twolink.errors import ControllerError
from twolink.integrate.event import AMBIGUOUS, Event
from twolink.integrate.forces_seen import forces_seen
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.state import Array
from twolink.integrate.solution import Piece, Progress, Solution
from twolink.integrate.steps.beside import Beside
from twolink.integrate.steps.methods import Method
from twolink.integrate.steps.outcomes import FINE, Block, failure_of, outcome_of
from twolink.integrate.steps.perturbation import MIN_STEPS, NO_PERTURBATION, Perturbation, disturbances
from twolink.integrate.steps.step_map import StepMap, step_map
from twolink.integrate.steps.stepping import start_state
from twolink.loop.sampled_loop import SampledLoop, Sampling

LOOK = 64  # attempted steps between two looks at whether they get on
FEW = 8  # ticks whose disturbances are drawn at once
LEAST = 0.1  # of the time to the next tick: steps may grow to it
SAME_TIME = 1e-12  # relative: a time this near to a tick is that tick
NAMED = 20  # ticks that are named


class Lanes:
    """Solutions of one scene side by side, advanced by a step map.

    Parameters
    ----------
    by : StepMap
    t : float
        Time of the start, s.
    end : float
        Until when they are meant to go, s: it sets the first and the longest steps.
    setting : float
        The tolerance of the method, or its step, s.
    perturbations : tuple of Perturbation
        Of each.
    progress : callable, optional
        Called with the time now and then.
    rate : ndarray (nq + nv, 1), optional
        Of the states at the start, where the caller knows it.

    Attributes
    ----------
    x : ndarray (size, n)
        The states with the numbers that they hold, which may be written between two calls of `advance`.
    """

    def __init__(
        self,
        by: StepMap,
        t: float,
        end: float,
        setting: float,
        perturbations: tuple[Perturbation, ...],
        progress: Progress | None = None,
        rate: Array | None = None,
    ) -> None:
        count, size = len(perturbations), by.equations.space.size
        vector = 4 if by.compiled and count > 1 else 1
        every = perturbations + perturbations[-1:] * (-count % vector)
        start = np.repeat(by.equations.start[:, None], len(every), axis=1)
        self._by, self._rows, self._setting = by, by.rows, setting
        self.state, self._limit = start_state(by, start, t, end, setting, every, span=end - t, rate=rate)
        self.state[by.rows.time, count:] = np.inf  # they fill the vector
        self.spare, self._call, self._size, self._count = np.empty_like(self.state), by.call(len(every)), size, count
        self._rounded = tuple(one for one in perturbations if one.rounding)  # the last ones
        self._finer = [i for i, one in enumerate(perturbations) if one.finer > 1.0 and i > 0]
        self._moves = by.equations.layout.moves(self.x[by.equations.moving :])[:, count - len(self._rounded) :]
        self._progress, self._longest = progress, (end - t) / MIN_STEPS
        self._start, self._ticks, self._tried = self.state[by.rows.time].copy(), 0, 1
        self._added = np.empty(0)

    @property
    def x(self) -> Array:
        """The states (size, n)."""
        return self.state[: self._size, : self._count]

    @property
    def time(self) -> float:
        """Where they are, s."""
        return float(self.state[self._rows.time, 0])

    @property
    def step(self) -> float:
        """How long the next step of the first is meant to be, s."""
        return float(self.state[self._rows.step, 0])

    @property
    def counts(self) -> tuple[int, int]:
        """Accepted and rejected steps of the first."""
        return int(self.state[self._rows.accepted, 0]), int(self.state[self._rows.rejected, 0])

    def advance(self, end: float) -> list[tuple[float, Array]]:
        """Advance all to a time, s. Returns where steps of the first ended on the way: times and states (size,)."""
        rows, state, on_the_way, time = self._rows, self.state, [], self._rows.time
        before, start = state[rows.step].copy(), state.item(time, 0)
        for i in self._finer:  # its steps are at most half as long as the run's, also where a tick ends both
            half = 0.5 * min(end - start, max(before.item(0), LEAST * (end - start)))
            state[rows.step, i], state[rows.longest, i] = min(before.item(i), half), min(self._longest, half)
        state[rows.end] = end
        self._disturb()
        new, tried, late = self.spare, 0, list(range(self._count))
        while late:
            self._call(state, new)
            state, new, tried = new, state, tried + 1
            if late[0] == 0 and start < (start := state.item(time, 0)) < end:
                on_the_way.append((start, state[: self._size, 0].copy()))
            late = [i for i in late if state.item(time, i) < end]
            self.state, self.spare = state, new
            if tried % LOOK == 0:
                self._require_fine()
        self._tried = tried
        if tried <= 2 or not self._by.method.adaptive:  # the tick was shorter than the step
            np.maximum(state[rows.step], before, out=state[rows.step])
        self._ticks += 1
        if self._ticks % LOOK == 0:
            self._require_fine()
            self._call = self._by.call(state.shape[1])
        return on_the_way

    def _disturb(self) -> None:
        """Disturb the solutions that show rounding."""
        if not self._rounded:
            return
        equations, row = self._by.equations, self._ticks % FEW
        part = self.state[: equations.moving, self._count - len(self._rounded) : self._count]
        if row == 0 or self._ticks < FEW:  # by the size of the state then
            counts = self._ticks - row + np.repeat(np.arange(FEW)[:, None], len(self._rounded), axis=1)
            self._added = math.sqrt(self._tried) * disturbances(self._rounded, counts, part, equations.space)
            self._added *= self._moves
        part += self._added[row]

    def _require_fine(self) -> None:
        """Tell the time, and require that the steps get on. Raises AccuracyError."""
        if self._progress is not None:
            self._progress(self.time)
        lanes = self.state[:, : self._count]
        outcome = outcome_of(self._by, lanes, self._start[: self._count], self._limit)
        for i in np.flatnonzero(outcome != FINE):
            alone = lanes[None, :, [i]]
            raise failure_of(
                self._by, Block(np.zeros(1, int), alone, alone[:, self._rows.time], outcome[[i]]), self._limit
            )


def ambiguous_events(loop: SampledLoop) -> list[Event]:
    """The ambiguous ticks of a loop so far."""
    found = loop.ambiguous()
    events = [Event(at, AMBIGUOUS, what, "solutions of the error bar got different answers")
              for at, what in found[:NAMED]]  # fmt: skip
    if len(found) > NAMED:
        events.append(Event(found[NAMED][0], AMBIGUOUS, f"{len(found) - NAMED} more"))
    return events


class _Run:
    """A run from tick to tick. t, x: where steps of the first solution ended, and with which held numbers."""

    def __init__(self, equations: Equations, lanes: Lanes, loop: SampledLoop, beside: Beside | None) -> None:
        self._equations, self._lanes, self._loop, self._beside = equations, lanes, loop, beside
        self.t, self.x = [lanes.time], [lanes.x[:, 0].copy()]

    def go(self, end: float) -> None:
        """Go to the end."""
        lanes, loop, breaks = self._lanes, self._loop, self._equations.breaks(end)
        stops = np.unique(np.append(breaks, end if self._beside is None else self._beside.t))
        for stop in stops[stops > lanes.time]:
            while loop.time <= stop * (1.0 + SAME_TIME):
                self._to(min(loop.time, end))
                loop.tick(lanes.x)
                self.x[-1] = lanes.x[:, 0].copy()
            if stop > self.t[-1] * (1.0 + SAME_TIME):
                self._to(float(stop))
            if stop in breaks:
                self._take_tables(0.5 * (stop + min((t for t in breaks if t > stop), default=end)))
            if self._beside is not None:
                self._beside.x[self._beside.t == stop] = lanes.x[: self._equations.moving, 1:].T

    def _to(self, t: float) -> None:
        """Advance to a time."""
        if t <= self.t[-1]:
            return
        for at, x in (*self._lanes.advance(t), (t, self._lanes.x[:, 0].copy())):
            self.t.append(at)
            self.x.append(x)

    def _take_tables(self, t: float) -> None:
        """Write the pieces of tables that hold at a time."""
        for rows, table in self._equations.layout.rows_of_tables():
            if isinstance(table, Sampled):
                self._lanes.x[rows] = table.rows_at(t)[:, None]
        self.x[-1] = self._lanes.x[:, 0].copy()

    def solution(self, by: StepMap, times: Array, *, interrupted: bool) -> Solution:
        """The solution so far, with the samples at times (n,)."""
        t, x, moving = np.array(self.t), np.array(self.x), self._equations.moving
        times = times[: np.searchsorted(times, t[-1] * (1.0 + SAME_TIME), side="right")]
        step = np.searchsorted(t, times, side="right") - 1
        samples, between = x[step].T, t[step] < times
        if between.any():
            samples[:, between] = by.partial(samples[:, between], t[step[between]], times[between])
        accepted, rejected = self._lanes.counts
        evaluations = (accepted + rejected + int(between.sum())) * by.method.evaluations
        piece = Piece(self._equations, float(t[0]), len(times), (t, x[:, :moving]), held=x[:, moving:],
                      readings=self._loop.readings)  # fmt: skip
        return Solution(times, samples[:moving], accepted, evaluations, rejected, by.compile_seconds, by.compiled,
                        interrupted, events=tuple(ambiguous_events(self._loop)), pieces=(piece,))  # fmt: skip


def solve_ticks(
    equations: Equations,
    sampling: Sampling,
    method: Method,
    times: Array,
    setting: float,
    progress: Progress | None,
    perturbation: Perturbation = NO_PERTURBATION,
    beside: Beside | None = None,
) -> Solution:
    """Solve from the equations' start for samples; see `solver.solve`.

    Raises ControllerError, whose `run` is the solution so far.
    """
    equations.require(float(times[0]), float(times[-1]))
    others, by = () if beside is None else beside.perturbations, step_map(equations, method)
    lanes = Lanes(by, float(times[0]), float(times[-1]), setting, (perturbation, *others), progress)
    rows = {table.name: at.start for at, table in equations.layout.rows_of_tables() if isinstance(table, Slot)}
    loop = SampledLoop(sampling, rows, lanes.x, functools.partial(forces_seen, equations))
    interrupted = False
    run = _Run(equations, lanes, loop, beside)
    try:
        run.go(float(times[-1]))
    except KeyboardInterrupt:
        interrupted = True
    except ControllerError as error:
        error.run = run.solution(by, times, interrupted=True)
        raise
    return run.solution(by, times, interrupted=interrupted)
