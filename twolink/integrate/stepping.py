"""Marching with a step map: one world with samples, or many to the same end, each with steps of its own."""

from __future__ import annotations

import itertools
import math
from typing import Any, Protocol

import numpy as np

from twolink.algorithms import sincos
from twolink.errors import AccuracyError
from twolink.integrate import step_control as control
from twolink.integrate.equations import Equations
from twolink.integrate.methods import Method
from twolink.integrate.perturbation import MIN_STEPS
from twolink.integrate.pinocchio_rate import rate as rate_by_pinocchio
from twolink.integrate.solution import (
    MAX_STEPS,
    Progress,
    Solution,
    collapsed,
    not_finite,
    out_of_reach,
    too_many_steps,
)
from twolink.integrate.state import Array
from twolink.integrate.step_map import LANES, StepMap

MAX_FIXED = 100_000_000  # steps of one size
SURE, HOPELESS = 20_000, 100  # steps after which the pace tells; how far beyond the limit it must lead
BLOCK = 256  # steps whose states are kept to take samples from
FIRST_BLOCK = 4  # after an event, when the next may be near; then twice as many each time


class Watcher(Protocol):
    """What looks for events along the states of a march."""

    def first(self, t: Array, x: Array) -> Any:
        """The first event, with its time `t`, along states x (k, size) at times t (k,); None if there is none."""


def march(
    step_map: StepMap,
    times: Array,
    setting: float,
    progress: Progress | None = None,
    *,
    watcher: Watcher | None = None,
    longest: float | None = None,
) -> Solution:
    """Solve from the equations' start at times[0] for the samples `times` (n,).

    setting: the tolerance of an adaptive method, or the step [s], which is shortened so that equal steps end at the
    last sample. A sample is one step from the state before it: as exact as the method. Raises AccuracyError when the
    step size collapses or the state stops being finite.

    watcher: ends the march at the first event that it finds. longest: no step of an adaptive method is longer, s; by
    default a sixteenth of the time from the first sample to the last.
    """
    equations, method = step_map.equations, step_map.method
    size, x0 = equations.space.size, equations.start[:, None]
    start, end = float(times[0]), float(times[-1])
    first, tolerance, limit = _first_step(equations, method, x0, setting, start, end)
    initial = step_map.initial(x0, start, first, end, tolerance, longest=longest or (end - start) / MIN_STEPS)
    states = np.empty((BLOCK + 1, *initial.shape))
    states[0] = initial
    out = np.empty((size, len(times)))
    out[:, 0] = equations.start
    done, attempts, interrupted, hit = 1, 0, False, None
    block = BLOCK if watcher is None else FIRST_BLOCK
    clock, step = size + control.TIME, size + control.STEP
    try:
        while done < len(times):
            k = 0
            while k < block and states[k, clock, 0] < end:
                step_map(states[k], states[k + 1])
                k += 1
            attempts += k
            t = states[: k + 1, clock, 0]
            _require_progress(equations, method, states[: k + 1, :size, 0], t, float(states[0, step, 0]))
            if watcher is not None:
                hit = watcher.first(t, states[: k + 1, :size, 0])
                block = min(2 * block, BLOCK)
            reached = int(np.searchsorted(times, t[k] if hit is None else hit.t, side="right"))
            if reached > done:
                before = np.searchsorted(t, times[done:reached], side="left") - 1
                out[:, done:reached] = step_map.partial(states[before, :size, 0].T, t[before], times[done:reached])
                if reached == len(times) and hit is None:
                    out[:, -1] = states[k, :size, 0]  # a step ended there
                done = reached
            if hit is not None:
                done = min(done, reached)  # it may lie in the block before
                break
            _require_pace(float(t[k]), start, end, attempts, limit)
            states[0] = states[k]
            if progress is not None:
                progress(float(t[k]))
    except KeyboardInterrupt:
        interrupted = True
    accepted, rejected = (int(states[0, size + row, 0]) for row in (control.ACCEPTED, control.REJECTED))
    evaluations = (accepted + rejected + done) * method.evaluations
    return Solution(times[:done], out[:, :done], accepted, evaluations, rejected, step_map.compile_seconds,
                    step_map.compiled, interrupted, hit=hit)  # fmt: skip


def march_many(
    step_map: StepMap,
    x0: Array,
    times: Array,
    setting: float,
    parameters: Array | None = None,
    progress: Progress | None = None,
    longest: float = math.inf,
) -> tuple[Array, Array, int]:
    """Solve many worlds x0 (size, n), each with its own steps, for the samples `times` (m,).

    parameters (p, n): the run-time parameters of each. longest: no step is longer. Returns the states (m, size, n), the
    steps of each world (n,), and attempts in all. Worlds that have arrived at a sample wait for the others there. A
    world whose step size collapses or whose state stops being finite is NaN from there on, and the others go on.
    """
    equations, method = step_map.equations, step_map.method
    start, moving = float(times[0]), equations.moving
    ends = {float(t) for t in times[1:]}
    stops = sorted(ends.union(t for t in equations.breaks(float(times[-1])) if t > start))
    x0 = _with_rows(equations, x0[:moving], start, stops[0])
    size, count = x0.shape
    first, tolerance, limit = _first_step(equations, method, x0, setting, start, stops[0])
    if not method.adaptive:  # equal steps to the end, where there are no breaks
        first, _, limit = _first_step(equations, method, x0, setting, start, float(times[-1]))
    longest = min(longest, (float(times[-1]) - start) / MIN_STEPS)
    state = step_map.initial(x0, start, first, float(times[-1]), tolerance, parameters, longest)
    out = np.empty((len(times), moving, count))
    out[0] = x0[:moving]
    attempts, sample = 0, 0
    for begin, end in itertools.pairwise([start, *stops]):
        state[:size] = _with_rows(equations, state[:moving], begin, end)
        before = state[size + control.STEP].copy()
        attempts += _march_to(step_map, state, end, limit)
        # A step cut short by the sample is no reason for the next to be short.
        state[size + control.STEP] = np.maximum(state[size + control.STEP], before) if method.adaptive else before
        if end in ends:
            sample += 1
            out[sample] = state[:moving]
            if progress is not None:
                progress(end)
    return out, state[size + control.ACCEPTED].astype(int), attempts


def _with_rows(equations: Equations, x: Array, begin: float, end: float) -> Array:
    """States (q, v) with what the tables are made of between two stops."""
    rows = equations.layout.numbers_at(0.5 * (begin + end))
    return np.concatenate([x, np.repeat(rows[:, None], x.shape[1], axis=1)])


def _march_to(step_map: StepMap, state: Array, end: float, limit: int) -> int:
    """Advance every world of `state` to the end, in place; returns how many steps were tried in all."""
    size = step_map.equations.space.size
    state[size + control.END] = end
    clock = size + control.TIME
    start = state[clock].copy()
    going = np.arange(state.shape[1])
    attempts = tried = 0
    while going.size:
        width = -(-going.size // LANES) * LANES if step_map.compiled else going.size
        chosen = np.append(going, np.full(width - going.size, going[-1]))
        now, new = np.ascontiguousarray(state[:, chosen]), np.empty((len(state), width))
        # Worlds that have arrived are left out once they are many: until then they cost, but change nothing.
        for n in range(1, BLOCK + 1):
            step_map(now, new)
            now, new = new, now
            left = now[clock] < end
            if not left.any() or (n >= LANES and 2 * left.sum() < width):
                break
        tried += n
        attempts += n * going.size
        now = now[:, : going.size]
        stuck = (n == BLOCK) & (now[clock] == state[clock, going])
        lost = _are_lost(step_map, now, tried, start[going], end, limit) | stuck
        now[:size, lost] = np.nan
        state[:, going] = now
        going = going[(now[clock] < end) & ~lost]
    return attempts


def _are_lost(step_map: StepMap, now: Array, tried: int, start: Array, end: float, limit: int) -> Array:
    """Which worlds cannot go on: not finite, beyond what steps can take, or hopelessly slow."""
    space, size = step_map.equations.space, step_map.equations.space.size
    t = now[size + control.TIME]
    beyond = np.abs(now[space.angles]).max(axis=0, initial=0.0) > 0.9 * sincos.LIMIT
    slow = (t < end) & ((tried > limit) | ((tried > SURE) & (tried * (end - start) > HOPELESS * limit * (t - start))))
    lost: Array = ~np.isfinite(now[:size]).all(axis=0) | slow
    return lost | beyond if step_map.method.kind != "implicit" else lost


def _first_step(
    equations: Equations, method: Method, x: Array, setting: float, start: float, end: float
) -> tuple[float | Array, float, int]:
    """The first step, or the only one; the tolerance; and how many steps are allowed."""
    duration, rate = end - start, np.abs(rate_by_pinocchio(equations, start, x))
    finite = np.isfinite(rate).all(axis=0)
    if not finite.any():
        raise AccuracyError("the acceleration is not finite", where=f"t = {start:.6g} s",
                            remedy="check forces, masses and the initial state")  # fmt: skip
    if not method.adaptive:
        if duration / setting > MAX_FIXED:
            raise AccuracyError(f"{duration / setting:.1e} steps of {setting:.3g} s, the limit is {MAX_FIXED:.0e}",
                                argument="step", remedy="take larger steps, or a method that adapts them")  # fmt: skip
        steps = max(1, math.ceil(duration / setting * (1 - 1e-12)))
        return duration / steps, math.inf, 2 * steps + BLOCK
    # A fraction of the time in which the state changes by its own size; the control grows it sixfold a step.
    change = (rate / (1.0 + np.abs(x))).max(axis=0, initial=0.0)
    change[~finite] = np.inf  # a step of 0: lost before it starts
    # It depends on the tolerance even where a piece is short: else two tolerances might take the same steps, and their
    # solutions say nothing of each other's error.
    natural = setting ** (1 / method.error_order)
    first = np.minimum(0.5 * natural / np.maximum(change, 1e-3), natural * duration / MIN_STEPS)
    return (float(first[0]) if first.size == 1 else first), setting, MAX_STEPS


def _require_progress(equations: Equations, method: Method, x: Array, t: Array, step: float) -> None:
    """Require that a block of steps x (k + 1, size) at times t went on, within what steps can take."""
    if not np.isfinite(x[-1]).all():
        last = int(np.argmax(~np.isfinite(x).all(axis=1)))
        raise not_finite(float(t[max(0, last - 1)]), None if method.adaptive else step)
    angles = np.abs(x[-1, equations.space.angles]).max(initial=0.0)
    if method.kind != "implicit" and angles > 0.9 * sincos.LIMIT:
        raise out_of_reach(float(t[-1]), sincos.LIMIT)
    if t[-1] == t[0] and len(t) > BLOCK:
        raise collapsed(float(t[-1]))


def _require_pace(t: float, start: float, end: float, attempts: int, limit: int) -> None:
    """Require that the end will be reached within the limit of steps, at the pace so far."""
    if attempts > limit or (attempts > SURE and attempts * (end - start) > HOPELESS * limit * (t - start)):
        raise too_many_steps(t, limit)
