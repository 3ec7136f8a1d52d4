"""Stepping: worlds advance by a step map, each with steps of its own; samples are taken between the steps.

`advance` is the one loop. It attempts blocks of steps and yields the states on the way, from which samples are taken
and events are looked for. `integrate` runs one world through it, alone or as the first lane of a batch in which the
others are the solutions beside it.
"""

import math
from collections.abc import Iterator
from typing import Any, Protocol

import numpy as np

from twolink.errors import AccuracyError
from twolink.integrate.motion.causes import cause
from twolink.integrate.motion.state import Array
from twolink.integrate.solution import MAX_KEPT, Progress, Solution
from twolink.integrate.steps.beside import Beside
from twolink.integrate.steps.failures import MAX_STEPS, failure
from twolink.integrate.steps.outcomes import FINE, Block, failure_of, outcome_of
from twolink.integrate.steps.perturbation import NO_PERTURBATION, Perturbation, step_disturbances
from twolink.integrate.steps.step_control import RESOLUTION, initial_state
from twolink.integrate.steps.step_map import StepMap

MAX_FIXED_STEPS = 100_000_000  # steps of one size
BLOCK = 256  # steps between two looks at what they gave
LOOK = 8  # steps between two looks at whether half of the worlds have arrived
BLOCK_NUMBERS = 200_000  # in a block, which stays in the cache: with many worlds it has fewer steps
SMALLEST_TOLERANCE = 1e-15  # below this the rounding of the numbers decides


class EventWatcher(Protocol):
    """A watcher for events along the states of a world."""

    def first(self, t: Array, x: Array) -> Any:
        """The first event, with its time `t`, along states x (k, size) at times t (k,); None if there is none."""


def integrate(
    step_map: StepMap,
    times: Array,
    setting: float,
    progress: Progress | None = None,
    *,
    perturbation: Perturbation = NO_PERTURBATION,
    beside: Beside | None = None,
    watcher: EventWatcher | None = None,
    span: float | None = None,
    rate: Array | None = None,
    first_block: int = BLOCK,
) -> Solution:
    """Solve from the equations' start for samples, one world.

    Parameters
    ----------
    step_map : StepMap
    times : ndarray (n,)
        Sample times, increasing, s.
    setting : float
        The tolerance of an adaptive method. Or the step, s, which is shortened so that equal steps end at the last
        sample.
    progress : callable, optional
        Called with the simulated time after each block of steps.
    perturbation : Perturbation
        Of this solution; its setting is divided by `finer`.
    beside : Beside, optional
        Solutions that are solved in the same calls, from where they are to the last sample.
    watcher : EventWatcher, optional
        The first event that it finds ends the solution.
    span : float, optional
        The time of the whole run, s, of which a step is a part; by default that from first to last sample.
    rate : ndarray (nq + nv,), optional
        The rate at the start, where the caller knows it.
    first_block : int
        The steps of the first block; each next one has twice as many, up to BLOCK.

    Returns
    -------
    Solution
        Up to the last sample, the event, or Ctrl-C.

    Raises
    ------
    AccuracyError
        Codes "steps-collapsed", "loops-singular", "not-finite", "step-too-large" and "too-many-steps".
    """
    equations = step_map.equations
    size, start, end = equations.space.size, float(times[0]), float(times[-1])
    others = () if beside is None else beside.perturbations
    lanes, x = (perturbation, *others), equations.start[:, None]
    if beside is not None:
        numbers = np.repeat(x[equations.moving :], len(others), axis=1)
        x = np.concatenate([x, np.concatenate([beside.now, numbers])], axis=1)
    state, limit = start_state(step_map, x, start, end, setting, lanes, rate=rate, span=span or end - start)
    record, interrupted, hit, last = _Record(step_map, times), False, None, state[:, 0]
    try:
        for block in advance(step_map, state, limit, first_block, lanes):
            if beside is not None:
                _look_at(step_map, block, beside)
            if block.worlds[0] > 0:
                continue  # the run has arrived, another solution has not
            t, last = block.t[:, 0], block.states[-1, :, 0]
            if block.outcome[0] != FINE:
                raise failure_of(step_map, block, limit)
            hit = None if watcher is None else watcher.first(t, block.states[:, :size, 0])
            record.add(t, block.states[:, :size, 0], float(t[-1] if hit is None else hit.t))
            if hit is not None:
                last = block.states[max(0, int(np.searchsorted(t, hit.t)) - 1), :, 0]
                break
            if progress is not None:
                progress(float(t[-1]))
    except KeyboardInterrupt:
        interrupted = True
    if beside is not None:
        beside.now[:] = state[: equations.moving, 1:]
    tried = state[step_map.rows.accepted] + state[step_map.rows.rejected]
    return record.solution(last, hit, interrupted=interrupted, beside=int(tried.max() - tried[0]))


class _Record:
    """The record of a run: x (size, n), its states at the times, of which so many are `done`; and its steps."""

    def __init__(self, step_map: StepMap, times: Array) -> None:
        self._map, self._times, start = step_map, times, step_map.equations.start
        self.x, self.done = np.empty((len(start), len(times))), 1
        self.x[:, 0] = start
        self._steps = [(times[:1], start[None, : step_map.equations.moving])]

    def add(self, t: Array, states: Array, end: float) -> None:
        """Take the samples up to an end from states (k, size) at times t (k,), and where steps ended."""
        reached = int(np.searchsorted(self._times, end, side="right"))
        if reached > self.done:
            wanted = self._times[self.done : reached]
            self.x[:, self.done : reached] = _states_at(self._map, t, states, wanted)
        self.done, moved = reached, t[1:] > t[:-1]  # not refused
        self._steps.append((t[1:][moved], states[1:, : self._map.equations.moving][moved]))

    def solution(self, last: Array, hit: Any, *, interrupted: bool, beside: int) -> Solution:
        """The solution so far. last: the state array (rows,) that it came to."""
        by, rows = self._map, self._map.rows
        accepted, rejected = int(last[rows.accepted]), int(last[rows.rejected])
        evaluations = (accepted + rejected + self.done) * by.method.evaluations
        return Solution(self._times[: self.done], self.x[:, : self.done], accepted, evaluations, rejected,
                        by.compile_seconds, by.compiled, interrupted, hit=hit, taken=self._taken(),
                        beside=beside)  # fmt: skip

    def _taken(self) -> tuple[Array, Array] | None:
        """Times (k,) and states (k, nq + nv) where steps ended; None where they are too many to keep."""
        times, states = zip(*self._steps, strict=True)
        if sum(map(len, times)) * states[0].shape[1] > MAX_KEPT:
            return None
        return np.concatenate(times), np.concatenate(states)


def _look_at(step_map: StepMap, block: Block, beside: Beside) -> None:
    """Take the samples of the solutions beside a run, which are numbered behind it."""
    for others, often in ((block.worlds == 1, slice(None)), (block.worlds > 1, beside.seldom)):
        if others.any():
            part = Block(
                block.worlds[others] - 1, block.states[:, :, others], block.t[:, others], block.outcome[others]
            )
            take_samples(step_map, part, beside.t[often], beside.x[often])


def _states_at(step_map: StepMap, t: Array, states: Array, wanted: Array) -> Array:
    """States (size, n) at times (n,) within the steps from states (k, size) at times t (k,)."""
    step = np.searchsorted(t, wanted) - 1
    out = step_map.partial(states.take(step, axis=0).T, t[step], wanted)
    at_end = np.flatnonzero(t[step + 1] == wanted)  # where a step ended, its own state
    out[:, at_end] = states[step[at_end] + 1].T
    return np.asarray(out)


def advance(
    step_map: StepMap,
    state: Array,
    limit: int,
    block_steps: int = BLOCK,
    perturbations: tuple[Perturbation, ...] = (),
) -> Iterator[Block]:
    """Advance each world of `state` (rows, n), in place, to its own end, and yield the blocks of steps.

    limit: of attempted steps a world. block_steps: of the first block; each next one has twice as many up to BLOCK.
    Worlds that have arrived or cannot go on are left out of the next block. perturbations: of each world, which may be
    disturbed; or one, of all.
    """
    rows, same = step_map.rows, len(perturbations) == 1
    start = state[rows.time].copy()
    worlds = np.flatnonzero(state[rows.time] < state[rows.end])
    while worlds.size:
        own = perturbations if same else tuple(perturbations[i] for i in worlds)
        states = _attempt(step_map, state[:, worlds], block_steps, own)
        last = states[-1]
        outcome = outcome_of(step_map, last, start[worlds], limit)
        state[:, worlds] = last
        yield Block(worlds, states, states[:, rows.time], outcome)
        worlds = worlds[(last[rows.time] < last[rows.end]) & (outcome == FINE)]
        block_steps = min(2 * block_steps, BLOCK)


def _attempt(step_map: StepMap, state: Array, count: int, perturbations: tuple[Perturbation, ...]) -> Array:
    """The states (k + 1, rows, w) of up to `count` attempts; fewer when half of the worlds have arrived.

    perturbations: of each world, or one of all, which are disturbed before each attempt.
    """
    count = max(1, min(count, max(LOOK, BLOCK_NUMBERS // state.size // LOOK * LOOK)))
    states = np.empty((count + 1, *state.shape))
    states[0] = state
    made = step_map.attempts(states, count, LOOK, step_disturbances(perturbations, state, step_map.equations))
    return states[: made + 1]


def take_samples(step_map: StepMap, block: Block, times: Array, out: Array, parameters: Array | None = None) -> None:
    """Write the samples that lie within a block into `out` (len(times), n, size).

    A sample within a step is one step from the state before it: as exact as the method.
    """
    before, reached = np.searchsorted(times, block.t[[0, -1]], side="right")
    counts = reached - before
    if not counts.any():
        return
    column = np.repeat(np.arange(len(counts)), counts)
    sample = before[column] + np.arange(len(column)) - np.repeat(np.cumsum(counts) - counts, counts)
    step = np.count_nonzero(block.t[:, column] < times[sample], axis=0) - 1
    states, worlds, size = block.states.swapaxes(1, 2), block.worlds[column], out.shape[2]
    at_end = times[sample] == block.t[step + 1, column]  # where a step ended, its own state
    out[sample[at_end], worlds[at_end]] = states[step[at_end] + 1, column[at_end], :size]
    if at_end.all():
        return
    step, column, sample, worlds = step[~at_end], column[~at_end], sample[~at_end], worlds[~at_end]
    x = states[step, column, : step_map.equations.space.size].T
    values = None if parameters is None else parameters[:, worlds]
    out[sample, worlds] = step_map.partial(x, block.t[step, column], times[sample], values)[:size].T


def start_state(
    step_map: StepMap,
    x: Array,
    start: float | Array,
    end: float | Array,
    setting: float | Array,
    perturbations: tuple[Perturbation, ...] = (),
    parameters: Array | None = None,
    *,
    span: float = math.inf,
    rate: Array | None = None,
) -> tuple[Array, int]:
    """The state array of worlds x (size, n) with their first steps, and the limit of steps.

    start, end: times, or one of each world (n,). perturbations: of each world. span: the time of the whole run, s, of
    which a step is a part. rate: of (q, v), (nq + nv, n or 1), where the caller knows it.
    Raises AccuracyError where no world has a finite rate.
    """
    equations, method = step_map.equations, step_map.method
    every = perturbations or (NO_PERTURBATION,)
    finer = np.array([one.finer for one in every])
    setting = np.asarray(setting / finer)
    if method.adaptive:
        setting = np.fmax(setting, SMALLEST_TOLERANCE)
    rate = step_map.rate(start, x, parameters) if rate is None else rate
    rate = np.abs(np.broadcast_to(rate, (len(rate), x.shape[1])))
    duration = np.asarray(end - start, dtype=float)
    finite = np.isfinite(rate).all(axis=0)
    if x.shape[1] and not finite.any():
        raise failure("acceleration-not-finite", at := float(np.min(start)), cause(equations, at, x[:, 0]))
    if not method.adaptive:
        steps = np.maximum(1.0, np.ceil(duration / setting * (1 - 1e-12)))
        largest = float(steps.max(initial=0.0))
        if largest > MAX_FIXED_STEPS:
            what = f"{largest:.1e} steps of {float(np.min(setting)):.3g} s, the limit is {MAX_FIXED_STEPS:.0e}"
            raise AccuracyError(what, argument="step", remedy="take larger steps, or a method that adapts them")
        return initial_state(x, start, duration / steps, end, math.inf, parameters=parameters), 2 * int(largest) + BLOCK
    # A fraction of the time in which the state changes by its own size; the control lengthens it step by step.
    change = (rate / (1.0 + np.abs(x[: len(rate)]))).max(axis=0, initial=0.0)
    change[~finite] = np.inf  # a step of 0, which counts as collapsed
    # It depends on the tolerance even where the duration is short: otherwise two tolerances could take the same steps,
    # and the distance of their solutions would say nothing about the error.
    fraction = setting ** (1 / method.error_order)
    first = np.minimum(0.5 * fraction / np.maximum(change, 1e-3), fraction * duration / every[0].min_steps(method))
    longest = span / np.array([one.min_steps(method) for one in every])
    return initial_state(x, start, first, end, setting, longest, parameters, (finer / RESOLUTION) ** 2), MAX_STEPS
