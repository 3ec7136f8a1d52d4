"""Stepping: worlds advance by a step map, each with steps of its own; samples are taken between the steps.

`advance` attempts blocks of steps and yields the states on the way, from which samples are taken and events are looked
for, with what became of each world.
Many worlds, each with steps of its own, go in batches to the same times, on threads where that pays.
"""

import functools
import itertools
import math
import threading
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from twolink.dynamics.threads import is_forked_child, share, thread_count
from twolink.errors import AccuracyError
from twolink.integrate.motion.state import Array
from twolink.integrate.solution import Progress
from twolink.integrate.steps.failures import MAX_STEPS, cause, failure, is_hopeless
from twolink.integrate.steps.perturbation import NO_PERTURBATION, Perturbation, step_disturbances
from twolink.integrate.steps.step_control import RESOLUTION, initial_state
from twolink.integrate.steps.step_map import StepMap
from twolink.native.machine import MANY

MAX_FIXED_STEPS = 100_000_000  # steps of one size
BLOCK = 256  # steps between two looks at what they gave
LOOK = 8  # steps between two looks at whether half of the worlds have arrived
BLOCK_NUMBERS = 200_000  # in a block, which stays in the cache: with many worlds it has fewer steps
FEW = 8  # worlds, of each of which the steps before its samples are searched, as counting those of all takes longer
SMALLEST_TOLERANCE = 1e-15  # below this the rounding of the numbers decides
SINGULAR = 0.1  # relative: singular values of constraint rows below it are those near a singular position
SMALLEST_STEP = 1e-60  # s: of steps at t = 0, where any step changes the time
PACE_FROM = 10_000  # steps after which the pace so far is taken for the pace to the end
STUCK = 10  # limits of steps as short as the last one that would be left
FINE, NOT_FINITE, COLLAPSED, TOO_MANY = range(4)  # what became of a world
CODES = ("", "not-finite", "steps-collapsed", "too-many-steps")  # of failures, by outcome


class Block(NamedTuple):
    """Attempted steps of some worlds.

    worlds (w,): their numbers. states (k + 1, rows, w): state arrays from before the first step to after the last. t
    (k + 1, w): their times. outcome (w,): FINE, or why the world cannot go on.
    """

    worlds: Array
    states: Array
    t: Array
    outcome: Array


def outcome_of(step_map: StepMap, state: Array, start: Array, limit: int) -> Array:
    """Outcome of each world since its start: FINE, or why it cannot go on."""
    rows, space = step_map.rows, step_map.equations.space
    t, end, tried = state[rows.time], state[rows.end], state[rows.accepted] + state[rows.rejected]
    outcome = np.full(len(t), FINE)
    left = t < end
    if tried.max() > min(PACE_FROM, limit):
        late = tried > PACE_FROM
        outcome[left & ((late & is_hopeless(tried, limit, t, start, end)) | (tried > limit))] = TOO_MANY
        outcome[left & late & (end - t > STUCK * limit * state[rows.step])] = COLLAPSED
    outcome[left & (t + np.fmax(state[rows.step] - SMALLEST_STEP, 0.0) <= t)] = COLLAPSED
    outcome[~np.isfinite(state[: space.size]).all(axis=0)] = NOT_FINITE
    return outcome


def failure_of(step_map: StepMap, block: Block, limit: int) -> AccuracyError:
    """The error of the first world of a block."""
    t, outcome = block.t[:, 0], int(block.outcome[0])
    if outcome == NOT_FINITE:
        finite = np.isfinite(block.states[:, : step_map.equations.space.size, 0]).all(axis=1)
        last = float(t[max(0, int(np.argmin(finite)) - 1)])
        if step_map.method.adaptive:
            state = block.states[int(np.argmin(finite)), : step_map.equations.space.size, 0]
            return failure("not-finite", last, cause(step_map.equations, last, state))
        return failure("step-too-large", last, step=float(block.states[0, step_map.rows.step, 0]))
    constraints, space = step_map.equations.constraints, step_map.equations.space
    if outcome == COLLAPSED and constraints is not None:
        rows = constraints.jacobian_at(block.states[-1, : space.nq, 0], constraints.kept)
        sizes = np.linalg.svd(rows * np.array(constraints.scales)[:, None], compute_uv=False)
        if sizes[-1] < SINGULAR * sizes[0]:
            return failure("loops-singular", float(t[-1]))
    why = cause(step_map.equations, float(t[-1]), block.states[-1, : space.size, 0])
    return failure(CODES[outcome], float(t[-1]), why, **({"limit": limit} if outcome == TOO_MANY else {}))


def advance(
    step_map: StepMap,
    state: Array,
    limit: int,
    block_steps: int = BLOCK,
    perturbations: tuple[Perturbation, ...] = (),
    start: Array | None = None,
) -> Iterator[Block]:
    """Advance each world of `state` (rows, n), in place, to its own end, and yield the blocks of steps.

    limit: of attempted steps a world. block_steps: of the first block; each next one has twice as many up to BLOCK.
    Worlds that have arrived or cannot go on are left out of the next block. perturbations: of each world, which may be
    disturbed; or one, of all. start: when each began, by default now, s.
    """
    rows, same = step_map.rows, len(perturbations) == 1
    start = state[rows.time].copy() if start is None else start
    worlds = np.flatnonzero(state[rows.time] < state[rows.end])
    while worlds.size:
        own = perturbations if same else tuple(perturbations[i] for i in worlds)
        some = state[:, worlds]
        count = max(1, min(block_steps, max(LOOK, BLOCK_NUMBERS // some.size // LOOK * LOOK)))
        states = np.empty((count + 1, *some.shape))
        states[0] = some
        made = step_map.attempts(states, count, LOOK, step_disturbances(own, some, step_map.equations))
        states, last = states[: made + 1], states[made]
        outcome = outcome_of(step_map, last, start[worlds], limit)
        state[:, worlds] = last
        yield Block(worlds, states, states[:, rows.time], outcome)
        worlds = worlds[(last[rows.time] < last[rows.end]) & (outcome == FINE)]
        block_steps = min(2 * block_steps, BLOCK)


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
    if len(counts) <= FEW:
        parts = zip(block.t.T, before, reached, strict=True)
        step = np.concatenate([t.searchsorted(times[first:after]) for t, first, after in parts]) - 1
    else:
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


CHUNK, SMALL = 512, 64  # worlds that a thread takes at once, so that they stay in its cache; and that make one


def integrate_many(
    step_map: StepMap,
    x0: Array,
    times: Array,
    setting: float | Array,
    parameters: Array | None = None,
    progress: Progress | None = None,
    perturbation: Perturbation = NO_PERTURBATION,
) -> tuple[Array, Array, Array]:
    """Solve many worlds for the same samples, each with steps of its own.

    Parameters
    ----------
    step_map : StepMap
    x0 : ndarray (size, n)
        Initial states.
    times : ndarray (m,)
        Sample times, increasing, s.
    setting : float or ndarray (n,)
        The tolerance of an adaptive method, or the step of another, s.
    parameters : ndarray (p, n), optional
        Run-time parameters of each world.
    progress : callable, optional
        Called now and then with the mean of the times that worlds have reached.
    perturbation : Perturbation
        Of all worlds; their settings are divided by `finer`.

    Returns
    -------
    x : ndarray (m, nq + nv, n)
        States. A world whose step size collapses, or whose state stops being finite, is NaN from there on.
    steps, rejected : ndarray (n,)
        Steps and attempts in vain of each world.

    Raises
    ------
    AccuracyError
        No world has a finite acceleration at the start.
    """
    equations, rows = step_map.equations, step_map.rows
    start, end, moving = float(times[0]), float(times[-1]), equations.moving
    x = np.array(x0[:moving])
    out = np.full((len(times), x.shape[1], moving), np.nan)
    out[0] = x.T
    counts = np.zeros((2, x.shape[1]), dtype=int)
    for begin, stop in itertools.pairwise([start, *(t for t in equations.breaks(end) if t > start), end]):
        lost = ~np.isfinite(x).all(axis=0)
        if lost.all():
            break
        table_rows = np.repeat(equations.layout.numbers_at(0.5 * (begin + stop))[:, None], x.shape[1], axis=1)
        state, limit = start_state(step_map, np.concatenate([x, table_rows]), begin, stop, setting, (perturbation,),
                                   parameters, span=end - start)  # fmt: skip
        state[rows.time, lost] = stop
        _to_the_end(step_map, state, limit, times, out, progress, perturbation)
        x = state[:moving]
        counts += state[[rows.accepted, rows.rejected]].astype(int)
    return out.swapaxes(1, 2), counts[0], counts[1]


def _to_the_end(
    step_map: StepMap,
    state: Array,
    limit: int,
    times: Array,
    out: Array,
    progress: Progress | None,
    perturbation: Perturbation,
) -> None:
    """Advance all worlds of `state` (rows, n) to their ends, in chunks that threads share, with samples into `out`."""
    rows, count = step_map.rows, state.shape[1]
    moving, first = out.shape[2], step_map.equations.space.size + len(rows)
    shared = step_map.compiled == "steps" and not is_forked_child()  # Pinocchio's data are not for several threads
    chunk = min(CHUNK, -(-count // (MANY * thread_count())) * MANY) if shared and count >= 2 * SMALL else count

    def part(begin: int, stopped: threading.Event) -> None:
        own, samples = state[:, begin : begin + chunk], out[:, begin : begin + chunk]
        for block in advance(step_map, own, limit, BLOCK, (perturbation,)):
            own[:moving, block.worlds[block.outcome != FINE]] = np.nan
            take_samples(step_map, block, times, samples, own[first:] if len(own) > first else None)
            if stopped.is_set():
                return
            if progress is not None and chunk >= count:
                report()

    def report() -> None:
        if progress is not None:
            progress(float(state[rows.time].mean()))

    share([functools.partial(part, begin) for begin in range(0, count, chunk)], report)
