"""Taylor's method, by heyoka: the series of the motion to an order that the tolerance calls for.

The step size follows from the last two coefficients. Where a motion starts from symmetric rest, both may vanish by
symmetry, and the step size becomes infinite (the paper's own release does so at orders 8, 12 and 20). A companion with
the motion's singularities, but not its symmetries, is therefore integrated beside it:

    u = log(c + x . x) / 2,   u' = x . x' / (c + x . x)

From rest, all even coefficients of u are nonzero, and one of two neighbouring orders is even. A logarithm grows slowly,
so that u never decides the scale of the error. c = 16 costs 2 % more steps on the paper's arm. c = 1 adds singularities
(20 % more steps); c = 1000 protects less.
"""

import contextlib
import logging
import math
import threading
import time
from collections.abc import Iterator, Sequence
from contextvars import ContextVar
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from twolink.algorithms.mechanism import nominal, parameter_names
from twolink.algorithms.namespaces import Expressions
from twolink.dynamics import cache
from twolink.dynamics.kernels import heyoka
from twolink.errors import MissingExtraError
from twolink.integrate.beside import Beside
from twolink.integrate.compile_time import UNOPTIMIZED, is_reproducible, taylor_seconds
from twolink.integrate.equations import Equations
from twolink.integrate.failures import MAX_STEPS, failure
from twolink.integrate.formulas import traced_rate
from twolink.integrate.perturbation import MIN_STEPS, NO_PERTURBATION, Perturbation, disturbances
from twolink.integrate.pieces import in_pieces
from twolink.integrate.scene_equations import structure_of
from twolink.integrate.solution import Code, Progress, Solution
from twolink.integrate.state import Array

COMPACT_FROM = 4  # degrees of freedom from which heyoka compiles loops in place of straight code
RESTORING = 1.0  # 1/s: how fast a quaternion's length returns to 1, which the exact motion never leaves
DIGITS = 256  # bits of the constants behind quadruple precision
COMPANION = 16.0  # c
ROUNDING_UNIT = {"double": 2.2e-16, "extended": 1.1e-19, "quad": 1.9e-34}
SHORTEST = 1e-300  # s: of the longest step, which heyoka wants to be above 0
OFTEN = 32  # disturbances of a solution that is solved by itself
DISTURBANCES = 4  # of a solution, evenly: each as large as those of the steps up to the next one together
CHUNK, MAX_CHUNK = 100, 6400  # samples between looks at Ctrl-C: numbers, not seconds, as a look ends a step


Precision = Literal["double", "extended", "quad"]
log = logging.getLogger("twolink")


def _kind(precision: Precision) -> Any:
    """The type of a number of this precision."""
    return {"double": float, "extended": np.longdouble, "quad": getattr(heyoka(), "real128", None)}[precision]


def order_of(tolerance: float) -> int:
    """The order that makes a step's error the tolerance: ceil(1 - log(tolerance) / 2) (Jorba, Zou 2005)."""
    return max(3, math.ceil(1 - math.log(tolerance) / 2))


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
        code = _Code(equations, tolerance, precision, loops)
        names.add(code.best)
        try:
            solution = _propagate(code, equations, times, progress, precision, perturbation)
        finally:
            code.give_back()
        seconds = code.compile_seconds
        if beside is not None and not solution.interrupted:
            lanes = _Code(
                equations, tolerance / beside.perturbations[0].finer, precision, loops, len(beside.perturbations)
            )
            try:
                _propagate_beside(lanes, equations, times, progress, beside, solution.steps / DISTURBANCES)
            except KeyboardInterrupt:
                solution = replace(solution, interrupted=True)
            finally:
                lanes.give_back()
            seconds += lanes.compile_seconds
            names.add(lanes.best)
        return replace(solution, evaluations=solution.steps * order_of(tolerance), compile_seconds=seconds)

    names: set[str] = set()
    solution = in_pieces(equations, times, piece)
    if precision == "double" and not _few.get():
        _spent.update(dict.fromkeys(names, math.inf))  # what is solved again is solved often; some bits change once
    return solution


@contextlib.contextmanager
def few_solutions() -> Iterator[None]:
    """What is solved within is not solved often: it is optimized only when it has cost as much as that would."""
    token = _few.set(True)
    try:
        yield
    finally:
        _few.reset(token)


_pool: dict[str, list[Any]] = {}
_spent: dict[str, float] = {}  # s, of solving by code without optimization, by the name of the optimized one
_few: ContextVar[bool] = ContextVar("_few", default=False)  # whether each motion is solved a few times only
_lock = threading.Lock()
MAX_POOL = 64


class _Code:
    """An integrator that no thread is using, `integrator`, the name of its code, and the numbers that are its `pars`.

    The first code is compiled without optimization, in double precision with the numbers of the scene as parameters.
    It takes a seventh of the time to compile, serves other numbers too, and takes twice the time to run. When that has
    cost as much as compiling, the best code follows.
    """

    def __init__(
        self, equations: Equations, tolerance: float, precision: Precision, compact: bool, lanes: int = 1
    ) -> None:
        parts = ("taylor", str(order_of(tolerance)), precision, "compact" if compact else "straight", f"{lanes} lanes")
        self.best, self.compile_seconds = equations.key(*parts), 0.0
        self._limit, self._how = taylor_seconds(equations), (tolerance, precision, compact, lanes)
        self._equations, rows = equations, equations.start[equations.moving :]
        at_hand = bool(_pool.get(self.best)) or _spent.get(self.best, 0.0) > self._limit
        if at_hand or is_reproducible() or cache.has(self.best):
            self.name, self.integrator, self.numbers = self.best, self._made(self.best, equations), rows
            return
        base, values = structure_of(equations) if precision == "double" else (equations, np.empty(0))
        self.name, self.numbers = base.key(*parts, "first"), np.concatenate([rows, values])
        self.integrator = self._made(self.name, base, base.parameters if len(values) else (), **UNOPTIMIZED)

    def _made(self, name: str, equations: Equations, parameters: Sequence[str] = (), **options: Any) -> Any:
        start = time.perf_counter()
        integrator = _take(name) or _build(name, equations, *self._how, parameters, **options)
        self.compile_seconds += time.perf_counter() - start
        return integrator

    def give_back(self) -> None:
        """Let others use the integrator."""
        _pool.setdefault(self.name, []).append(self.integrator)

    def spend(self, seconds: float) -> None:
        """Count what solving took; go on with optimized code where that has become worth its compiling."""
        if self.name == self.best:
            return
        _spent[self.best] = _spent.get(self.best, 0.0) + seconds
        if _spent[self.best] > self._limit:
            integrator = self._made(self.best, self._equations)
            integrator.state[:] = self.integrator.state
            if np.ndim(integrator.state) == 1:
                integrator.time = self.integrator.time
            else:
                integrator.set_time(self.integrator.time)
            integrator.pars[:] = self.integrator.pars[: len(integrator.pars)]
            self.name, self.integrator = self.best, integrator


def _take(name: str) -> Any:
    """An integrator that no thread is using, from this process or the disk cache."""
    with _lock:
        while len(_pool) > MAX_POOL:
            del _pool[next(iter(_pool))]
        free = _pool.setdefault(name, [])
        if free:
            return free.pop()
    content = cache.load(name)
    return content if type(content).__name__.startswith("taylor_adaptive") else None


def _build(
    name: str,
    equations: Equations,
    tolerance: float,
    precision: Precision,
    compact: bool,
    lanes: int,
    parameters: Sequence[str],
    **options: Any,
) -> Any:
    module, start = heyoka(), time.perf_counter()
    log.info("compiling Taylor's method of order %d for %s", order_of(tolerance), equations.robot.name)
    xp = Expressions(module)
    size = equations.moving
    rows = [module.par[i] for i in range(equations.space.size - size)]
    x = np.array([module.expression(f"x{i}") for i in range(size)] + rows, dtype=object)
    constants = {name: module.par[i] for i, name in enumerate(parameters, len(rows))}
    if precision != "double":
        constants = _exact_constants(equations, module)
    rate, x = traced_rate(equations, module.time, x, xp, constants)[:size], x[:size]
    square = (x * x).sum()
    companion = (x * rate).sum() / (COMPANION + square)
    for joint in equations.space.curved:
        if joint.unit is not None:
            part = x[joint.unit]
            rate[joint.unit] = rate[joint.unit] + part * ((1.0 - (part * part).sum()) * RESTORING)
    system = [*zip(x, (xp.lift(r) for r in rate), strict=True), (module.expression("companion"), companion)]
    kind = _kind(precision)
    make, start_values = module.taylor_adaptive, np.zeros(size + 1, dtype=kind)
    if lanes > 1:
        make, start_values = module.taylor_adaptive_batch, np.zeros((size + 1, lanes), dtype=kind)
    integrator = make(system, start_values, compact_mode=compact, fp_type=kind, tol=kind(tolerance), **options)
    cache.store(name, integrator)
    log.info("compiled in %.1f s", time.perf_counter() - start)
    return integrator


def _exact_constants(equations: Equations, module: Any) -> dict[str, Any]:
    """The model's constants as numbers of many digits, so that what is made of them is not rounded to doubles."""
    model = equations.robot.model
    values = {name: nominal(model, name) for name in parameter_names(model) if not name.endswith(".damping")}
    exact = {k: v for k, v in values.items() if v not in (0.0, 1.0)}
    return {name: module.expression(module.real(value, DIGITS)) for name, value in exact.items()}


def _propagate(
    code: _Code,
    equations: Equations,
    times: Array,
    progress: Progress | None,
    precision: Precision,
    perturbation: Perturbation,
) -> Solution:
    size, kind, integrator = equations.moving, _kind(precision), code.integrator
    x0, numbers = equations.start[:size].astype(kind), code.numbers.astype(kind)
    integrator.time = kind(times[0])
    integrator.state[:size] = x0
    integrator.pars[:] = numbers[: len(integrator.pars)]  # heyoka keeps them up to the last that the motion depends on
    with np.errstate(over="ignore"):  # an overflow is reported by the equations
        integrator.state[size] = kind(0.5 * np.log(COMPANION + float(np.square(x0.astype(float)).sum())))
    out = np.empty((len(times), size), dtype=kind)
    out[0] = x0
    done, steps, taken, interrupted = 1, 0, 1, False
    chunk = -(-len(times) // OFTEN) if perturbation.rounding else CHUNK
    grid, longest = times.astype(kind), kind(max(SHORTEST, float(times[-1] - times[0]) / MIN_STEPS))
    try:
        while done < len(times):
            stop = min(len(times), done + chunk)
            start = time.perf_counter()
            if perturbation.rounding:
                _disturb(code.integrator, equations, precision, perturbation, done, taken)
            taken, states = _grid(code.integrator, grid[done - 1 : stop], longest)
            code.spend(time.perf_counter() - start)
            steps += taken
            out[done:stop] = states[1:, :size]
            done = stop
            if steps > MAX_STEPS:
                raise failure("too-many-steps", float(times[done - 1]), limit=MAX_STEPS)
            if progress is not None:
                progress(float(times[done - 1]))
            chunk = chunk if perturbation.rounding else min(chunk * 4, MAX_CHUNK)
    except KeyboardInterrupt:
        interrupted = True
    double = out[:done].astype(float, copy=False).T
    precise = None if precision == "double" else out[:done]
    compiled: Code = "steps" if code.name == code.best else "first"
    return Solution(times[:done], double, steps, 0, compiled=compiled, interrupted=interrupted, precise=precise)


def _disturb(
    integrator: Any, equations: Equations, precision: Precision, perturbation: Perturbation, number: int, steps: int
) -> None:
    """Disturb the state as much as so many steps would."""
    x, count = integrator.state[: equations.moving], np.full((1, 1), number)
    added = disturbances((perturbation,), count, x.astype(float)[:, None], equations.space.nq)[0, :, 0]
    x += (math.sqrt(max(1, steps)) * ROUNDING_UNIT[precision] / ROUNDING_UNIT["double"] * added).astype(x.dtype)


def _propagate_beside(
    code: _Code, equations: Equations, times: Array, progress: Progress | None, beside: Beside, steps: float
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
        x += math.sqrt(max(1.0, steps)) * disturbances(lanes, counts, x, equations.space.nq)[0]
        start = time.perf_counter()
        _, states = integrator.propagate_grid(part, max_steps=MAX_STEPS, max_delta_t=longest)
        code.spend(time.perf_counter() - start)
        if any(result[0] != arrived for result in integrator.propagate_res):
            return  # what is behind it stays NaN
        integrator = code.integrator
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
