"""Taylor's method, by heyoka: the series of the motion to an order that the tolerance calls for."""

import math
from dataclasses import replace
from typing import Any

import numpy as np

from twolink.dynamics.kernels import heyoka
from twolink.errors import MissingExtraError
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.state import Array
from twolink.integrate.solution import Progress, Solution
from twolink.integrate.solvers.pieces import in_pieces
from twolink.integrate.solvers.taylor_code import (
    COMPACT_FROM,
    COMPANION,
    Integrator,
    Precision,
    number_type,
    order_of,
)
from twolink.integrate.steps.beside import Beside
from twolink.integrate.steps.failures import MAX_STEPS, failure
from twolink.integrate.steps.perturbation import MIN_STEPS, NO_PERTURBATION, Perturbation, disturbances

ROUNDING_UNIT = {"double": 2.2e-16, "extended": 1.1e-19, "quad": 1.9e-34}
SHORTEST = 1e-300  # s: of the longest step, which heyoka wants to be above 0
OFTEN = 32  # disturbances of a solution that is solved by itself
DISTURBANCES = 4  # of a solution, evenly: each as large as those of the steps up to the next one together
CHUNK, MAX_CHUNK = 100, 6400  # samples between looks at Ctrl-C: numbers, not seconds, as a look ends a step


def solve(
    equations: Equations,
    times: Array,
    tolerance: float,
    progress: Progress | None = None,
    *,
    precision: Precision = "double",
    perturbation: Perturbation = NO_PERTURBATION,
    beside: Beside | None = None,
) -> Solution:
    """Solve from the equations' start for samples, by Taylor's method.

    Parameters
    ----------
    equations : Equations
    times : ndarray (n,)
        Sample times, increasing, s.
    tolerance : float
        Of the error in each step.
    progress : callable, optional
        Called with the simulated time now and then.
    precision : {"double", "extended", "quad"}
        16 digits, 19 (where the processor has them) or 33. Of the last two the states are in Solution.precise as well,
        and products of the model's constants keep their digits.
    perturbation : Perturbation
        Of this solution; its tolerance is divided by `finer`, which adds orders.
    beside : Beside, optional
        Solutions in double precision that are equally finer, as lanes of one integrator.

    Returns
    -------
    Solution

    Raises
    ------
    AccuracyError
        A step or the state is not finite, or too many steps are needed.
    MissingExtraError
        heyoka is not installed.
    """
    if heyoka() is None:
        raise MissingExtraError("Taylor's method needs heyoka", remedy='pip install heyoka, or method="dop853"')

    tolerance = tolerance / perturbation.finer

    def piece(equations: Equations, times: Array) -> Solution:
        # Loops compile in about a second. Straight code is twice as fast, but compiles for minutes where it is long.
        loops = equations.space.nv >= COMPACT_FROM or precision != "double"
        code = Integrator(equations, tolerance, precision, loops)
        try:
            solution = _propagate(code, equations, times, progress, precision, perturbation)
        finally:
            code.give_back()
        seconds = code.compile_seconds
        if beside is not None and not solution.interrupted:
            lanes = Integrator(
                equations, tolerance / beside.perturbations[0].finer, precision, loops, len(beside.perturbations)
            )
            try:
                _propagate_beside(lanes, equations, times, progress, beside, solution.steps / DISTURBANCES)
            except KeyboardInterrupt:
                solution = replace(solution, interrupted=True)
            finally:
                lanes.give_back()
            seconds += lanes.compile_seconds
        return replace(solution, evaluations=solution.steps * order_of(tolerance), compile_seconds=seconds)

    return in_pieces(equations, times, piece)


def _propagate(
    code: Integrator,
    equations: Equations,
    times: Array,
    progress: Progress | None,
    precision: Precision,
    perturbation: Perturbation,
) -> Solution:
    size, kind, integrator = equations.moving, number_type(precision), code.integrator
    x0, numbers = equations.start[:size].astype(kind), code.numbers.astype(kind)
    integrator.time = kind(times[0])
    integrator.state[:size] = x0
    integrator.pars[:] = numbers[: len(integrator.pars)]  # heyoka keeps them up to the last that the motion depends on
    with np.errstate(over="ignore"):  # an overflow is reported by the equations
        integrator.state[size] = kind(0.5 * np.log(COMPANION + float(np.square(x0.astype(float)).sum())))
    out = np.empty((len(times), size), dtype=kind)
    out[0] = x0
    done, steps, taken, interrupted = 1, 0, 1, False
    beside = perturbation != NO_PERTURBATION  # each look ends a step: those of all solutions beside a run end alike
    chunk = -(-len(times) // OFTEN) if beside else CHUNK
    grid, longest = times.astype(kind), kind(max(SHORTEST, float(times[-1] - times[0]) / MIN_STEPS))
    try:
        while done < len(times):
            stop = min(len(times), done + chunk)
            if perturbation.rounding:
                _disturb(code.integrator, equations, precision, perturbation, done, taken)
            taken, states = _grid(code.integrator, grid[done - 1 : stop], longest)
            steps += taken
            out[done:stop] = states[1:, :size]
            done = stop
            if steps > MAX_STEPS:
                raise failure("too-many-steps", float(times[done - 1]), limit=MAX_STEPS)
            if progress is not None:
                progress(float(times[done - 1]))
            chunk = chunk if beside else min(chunk * 4, MAX_CHUNK)
    except KeyboardInterrupt:
        interrupted = True
    double = out[:done].astype(float, copy=False).T
    precise = None if precision == "double" else out[:done]
    return Solution(times[:done], double, steps, 0, compiled="steps", interrupted=interrupted, precise=precise)


def _disturb(
    integrator: Any, equations: Equations, precision: Precision, perturbation: Perturbation, number: int, steps: int
) -> None:
    """Disturb the state as much as so many steps would."""
    x, count = integrator.state[: equations.moving], np.full((1, 1), number)
    added = disturbances((perturbation,), count, x.astype(float)[:, None], equations, max(1, steps))[0, :, 0]
    x += (ROUNDING_UNIT[precision] / ROUNDING_UNIT["double"] * added).astype(x.dtype)


def _propagate_beside(
    code: Integrator, equations: Equations, times: Array, progress: Progress | None, beside: Beside, steps: float
) -> None:
    """Solve from where the solutions beside a run are to the end of a piece. steps: between two disturbances."""
    size, integrator, lanes = equations.moving, code.integrator, beside.perturbations
    first, after = np.searchsorted(beside.t, times[[0, -1]], side="right")
    inside = beside.t[first:after]
    grid = np.concatenate([times[:1], inside, times[-1:] if not inside.size or inside[-1] < times[-1] else []])
    integrator.set_time(float(times[0]))
    integrator.state[:size] = beside.now
    integrator.pars[:] = code.numbers[: len(integrator.pars), None]
    integrator.state[size] = 0.5 * np.log(COMPANION + np.square(beside.now).sum(axis=0))
    longest = [max(SHORTEST, float(times[-1] - times[0]) / MIN_STEPS)] * len(lanes)
    arrived, stride = heyoka().taylor_outcome.time_limit, -(-len(grid) // DISTURBANCES)
    for begin in range(0, len(grid) - 1, stride):
        part = np.repeat(grid[begin : begin + stride + 1, None], len(lanes), axis=1)
        x = integrator.state[:size]
        counts = np.full((1, len(lanes)), begin)
        x += disturbances(lanes, counts, x, equations, max(1.0, steps))[0]
        _, states = integrator.propagate_grid(part, max_steps=MAX_STEPS, max_delta_t=longest)
        if any(result[0] != arrived for result in integrator.propagate_res):
            return  # what is behind it stays NaN
        places = slice(first + begin, min(first + begin + stride, after))
        beside.x[places] = states[1 : 1 + places.stop - places.start, :size].swapaxes(1, 2)
        if progress is not None:
            progress(float(part[-1, 0]))
    beside.now[:] = integrator.state[:size]


def _grid(integrator: Any, grid: Any, longest: Any) -> tuple[int, Any]:
    """The states at the grid's times, of which the first is where the integrator is, to rounding."""
    grid = grid.copy()
    grid[0] = integrator.time
    outcome, _, _, steps, _, states = integrator.propagate_grid(grid, max_steps=MAX_STEPS, max_delta_t=longest)
    if outcome == heyoka().taylor_outcome.time_limit:
        return steps, states
    if outcome == heyoka().taylor_outcome.step_limit:
        raise failure("too-many-steps", float(integrator.time), limit=MAX_STEPS)
    # After a step that is not finite the time may be NaN: the last sample before it is named then.
    t = float(integrator.time)
    raise failure("not-finite", t if math.isfinite(t) else float(grid[max(0, len(states) - 1)]))
