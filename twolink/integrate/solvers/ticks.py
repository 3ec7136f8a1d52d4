"""Ticks: solving from tick to tick, where controllers change the numbers that a state holds in between.

`Lanes` is the stepping core: some solutions of one scene as columns of a state array. Their steps end at the times that
are asked for, and go on as if they had not.
"""

import copy
import functools
from collections.abc import Callable

import numpy as np

from twolink.effects.inputs import Sampled
from twolink.errors import ControllerError
from twolink.integrate.event import events_of
from twolink.integrate.forces_seen import forces_seen
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.state import Array
from twolink.integrate.solution import Piece, Progress, Solution
from twolink.integrate.steps.beside import Beside
from twolink.integrate.steps.methods import Method
from twolink.integrate.steps.outcomes import FINE, Block, failure_of, outcome_of
from twolink.integrate.steps.perturbation import MIN_STEPS, NO_PERTURBATION, Perturbation, step_disturbances
from twolink.integrate.steps.step_control import MAX_FACTOR, MIN_SQUARE
from twolink.integrate.steps.step_map import StepMap, step_map
from twolink.integrate.steps.stepping import start_state
from twolink.loop.clock import SAME_TIME
from twolink.loop.sampled_loop import SampledLoop, Sampling

LOOK = 64  # attempted steps between two looks at whether they get on
AT_ONCE = 8  # attempted steps in a call, at most: a call ends where all have arrived
LEAST = 0.1  # of the time to the next tick: steps may grow to it
AHEAD = 8  # steps between two stops at which solutions are only compared: where steps are long, they pass those times
NONE: Array = np.empty(0)
Passed = list[tuple[float, Array]]  # times and states where steps ended


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
    by : StepMap
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
        start = np.repeat(by.equations.start[:, None], len(perturbations), axis=1)
        self.by, self._rows, self._setting = by, by.rows, setting
        self.state, self._limit = start_state(by, start, t, end, setting, perturbations, span=end - t, rate=rate)
        self._size, self._count = by.equations.space.size, len(perturbations)
        self._disturbances = step_disturbances(perturbations, self.state, by.equations)
        finer = sum(one.finer > 1.0 for one in perturbations[1:])
        self._finer = slice(1, 1 + finer) if finer else None  # the next ones
        self._progress, self._longest = progress, (end - t) / MIN_STEPS
        self._start, self._ticks, self._half = self.state[by.rows.time].copy(), 0, 0.0
        self._own_steps()

    def _own_steps(self) -> None:
        """Let attempts begin at the state, in a place of their own."""
        self._steps = np.empty((AT_ONCE + 1, *self.state.shape))
        self._steps[0] = self.state
        self.state = self._steps[0]
        self._attempt: Callable[[int, int], int] | None = None

    def copied(self) -> "Lanes":
        """Solutions that go on from here with the same bits, whatever these do."""
        other = copy.copy(self)
        other._own_steps()
        return other

    @property
    def x(self) -> Array:
        """The states (size, n)."""
        return self.state[: self._size]

    @property
    def time(self) -> float:
        """The time that the solutions have reached, s."""
        return float(self.state.item(self._rows.time, 0))

    @property
    def step(self) -> float:
        """The planned length of the first solution's next step, s."""
        return float(self.state[self._rows.step, 0])

    @property
    def counts(self) -> tuple[int, int]:
        """Accepted and rejected steps of the first."""
        return int(self.state[self._rows.accepted, 0]), int(self.state[self._rows.rejected, 0])

    @property
    def beside(self) -> int:
        """The most steps that another solution has attempted beyond those of the first."""
        tried = self.state[self._rows.accepted] + self.state[self._rows.rejected]
        return int(tried.max() - tried[0])

    def advance(self, end: float, looks: Array = NONE, passed: "Passed | None" = None) -> Array:
        """Advance all to a time, s.

        passed: where steps of the first ended on the way, to which times and states (size,) are added. Returns all
        states (size, m, n) at times (m,) on the way.
        """
        rows, state = self._rows, self.state
        time, step_row, start, step = rows.time, rows.step, state.item(rows.time, 0), state.item(rows.step, 0)
        adaptive = self.by.method.adaptive
        short = end - start  # the tick ends a step before its time, and would make the next ones shorter
        planned = state[step_row].copy() if step > MAX_FACTOR * short or not adaptive else None
        # The steps of finer solutions are at most half as long as the run's, also where a tick ends both.
        half = 0.5 * (short if step > short else max(step, LEAST * short))
        if self._finer is not None and abs(half - self._half) > SAME_TIME * end:
            self._half = half
            state[step_row, self._finer] = np.minimum(state[step_row, self._finer], half)
            state[rows.longest, self._finer] = min(self._longest, half)
        state[rows.end] = end
        tried, looked, taken = 0, LOOK, [state[None].copy()] if len(looks) else []
        attempt, steps = self._attempt or self._begun(), self._steps
        while state[time].min() < end:
            made = attempt(AT_ONCE, AT_ONCE)
            if taken:
                taken.append(steps[1 : made + 1].copy())
            if passed is not None:
                start = _pass(passed, steps[1 : made + 1, :, 0], time, self._size, start, end)
            state[:], tried = steps[made], tried + made
            if tried >= looked:
                looked += LOOK
                self._require_fine()
        if planned is not None and (tried <= 2 or not adaptive):
            np.maximum(state[step_row], planned, out=state[step_row])
        elif step < short and state.item(rows.previous, 0) <= MIN_SQUARE:
            # Two steps to a tick are as short as their end makes them, not as their error.
            np.minimum(2.0 * state[step_row], state[rows.longest], out=state[step_row])
        self._ticks += 1
        if self._ticks % LOOK == 0:
            self._require_fine()
        return self._between(np.concatenate(taken), looks) if taken else NONE

    def _begun(self) -> Callable[[int, int], int]:
        """Prepare attempts: the function that makes them."""
        attempt = self._attempt = self.by.on(self._steps, self._disturbances)
        return attempt

    def _between(self, taken: Array, looks: Array) -> Array:
        """The states (size, m, n) at times (m,), from those after each attempted step (k, rows, n)."""
        ends, count = taken[:, self._rows.time], self._count
        step = np.stack([np.searchsorted(ends[:, i], looks, side="right") - 1 for i in range(count)], axis=1)
        lane = np.broadcast_to(np.arange(count), step.shape)
        x = taken[step, : self._size, lane].reshape(-1, self._size).T
        at = self.by.partial(x, ends[step, lane].ravel(), np.repeat(looks, count))
        return at.reshape(self._size, len(looks), count)

    def _require_fine(self) -> None:
        """Tell the time, and require that the steps get on. Raises AccuracyError."""
        if self._progress is not None:
            self._progress(self.time)
        lanes = self.state
        outcome = outcome_of(self.by, lanes, self._start, self._limit)
        for i in np.flatnonzero(outcome != FINE):
            alone = lanes[None, :, [i]]
            raise failure_of(
                self.by, Block(np.zeros(1, int), alone, alone[:, self._rows.time], outcome[[i]]), self._limit
            )


def _pass(passed: Passed, steps: Array, time: int, size: int, start: float, end: float) -> float:
    """Add times and states of attempted steps (k, rows) after `start` and before `end`; the last of the times."""
    for step in steps:
        if start < (start := step.item(time)) < end:
            passed.append((start, step[:size].copy()))
    return start


class _Run:
    """A run from tick to tick. t, x: where steps of the first solution ended, and with which held numbers."""

    def __init__(self, equations: Equations, lanes: Lanes, loop: SampledLoop, beside: Beside | None) -> None:
        self._equations, self._lanes, self._loop, self._beside = equations, lanes, loop, beside
        self.t, self.x = [lanes.time], [lanes.x[:, 0].copy()]
        self._passed: list[float] = []  # times at which the others are yet to be looked at

    def go(self, end: float) -> None:
        """Go to the end."""
        lanes, loop, breaks = self._lanes, self._loop, self._equations.breaks(end)
        stops = np.unique(np.append(breaks, end if self._beside is None else self._beside.t))
        for stop in stops[stops > lanes.time]:
            while loop.time <= stop * (1.0 + SAME_TIME):
                try:
                    self._to(min(loop.time, end))
                    loop.tick(lanes.x)
                finally:
                    self._keep()
            if stop < end and stop not in breaks and lanes.time < stop < lanes.time + AHEAD * lanes.step:
                self._passed.append(float(stop))
                continue
            if stop > self.t[-1] * (1.0 + SAME_TIME):
                self._to(float(stop))
                self._keep()
            if stop in breaks:
                self._take_tables(0.5 * (stop + min((t for t in breaks if t > stop), default=end)))
            if self._beside is not None:
                self._beside.x[self._beside.t == stop] = lanes.x[: self._equations.moving, 1:].T

    def _to(self, t: float) -> None:
        """Advance to a time."""
        if t > self.t[-1]:
            looks, on_the_way = np.array(self._passed), list[tuple[float, Array]]()
            seen = self._lanes.advance(t, looks, on_the_way)
            for at, x in on_the_way:
                self.t.append(at)
                self.x.append(x)
            self.t.append(t)
            if self._beside is not None and len(looks):
                self._beside.x[np.isin(self._beside.t, looks)] = seen[: self._equations.moving, :, 1:].transpose(
                    1, 2, 0
                )
                self._passed.clear()

    def _keep(self) -> None:
        """Keep the state of the first at the last of the times."""
        self.x[len(self.t) - 1 :] = [self._lanes.x[:, 0].copy()]

    def _take_tables(self, t: float) -> None:
        """Write the pieces of tables that hold at a time."""
        for rows, table in self._equations.layout.rows_of_tables():
            if isinstance(table, Sampled):
                self._lanes.x[rows] = table.rows_at(t)[:, None]
        self._keep()

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
                        interrupted, events=tuple(events_of(self._loop)), pieces=(piece,),
                        beside=self._lanes.beside)  # fmt: skip


def solve_ticks(
    equations: Equations,
    sampling: Sampling | None,
    method: Method,
    times: Array,
    setting: float,
    progress: Progress | None,
    perturbation: Perturbation = NO_PERTURBATION,
    beside: Beside | None = None,
) -> Solution:
    """Solve from the equations' start for samples; see `solver.solve`.

    sampling: None where only tables of samples change the numbers. Raises ControllerError, whose `run` is the solution
    so far.
    """
    equations.require(float(times[0]), float(times[-1]))
    start, end = float(times[0]), float(times[-1])
    every = (perturbation, *(() if beside is None else beside.perturbations))
    by = step_map(equations, method)
    lanes = Lanes(by, start, end, setting, every, progress)
    loop = SampledLoop(
        sampling or Sampling(equations.robot, {}, {}),
        equations.layout.rows_of_slots(),
        equations.space.states,
        lanes.x,
        functools.partial(forces_seen, equations),
    )
    interrupted = False
    run = _Run(equations, lanes, loop, beside)
    try:
        run.go(end)
        loop.require_repeatable()
    except KeyboardInterrupt:
        interrupted = True
    except ControllerError as error:
        error.run = run.solution(by, times[times <= error.data["t"] * (1.0 + SAME_TIME)], interrupted=True)
        raise
    return run.solution(by, times, interrupted=interrupted)
