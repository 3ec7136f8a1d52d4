"""Many worlds: each with steps of its own, in batches to the same times, on threads where that pays."""

import functools
import itertools
import threading

import numpy as np

from twolink.dynamics.threads import is_forked_child, share, thread_count
from twolink.integrate.motion.state import Array
from twolink.integrate.solution import Progress
from twolink.integrate.steps.perturbation import NO_PERTURBATION, Perturbation
from twolink.integrate.steps.step_map import StepMap
from twolink.integrate.steps.stepping import BLOCK, FINE, advance, start_state, take_samples
from twolink.native.machine import MANY

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
