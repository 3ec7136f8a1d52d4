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
from twolink.integrate.compile_time import UNOPTIMIZED, is_reproducible, taylor_seconds
from twolink.integrate.equations import Equations
from twolink.integrate.failures import MAX_STEPS, failure
from twolink.integrate.formulas import traced_rate
from twolink.integrate.perturbation import MIN_STEPS
from twolink.integrate.pieces import in_pieces
from twolink.integrate.scene_equations import structure_of
from twolink.integrate.solution import Code, Progress, Solution
from twolink.integrate.state import Array

COMPACT_FROM = 4  # degrees of freedom from which heyoka compiles loops in place of straight code
RESTORING = 1.0  # 1/s: how fast a quaternion's length returns to 1, which the exact motion never leaves
DIGITS = 256  # bits of the constants behind quadruple precision
COMPANION = 16.0  # c
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
    min_steps: float = MIN_STEPS,
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
    min_steps : float
        The smallest number of steps of a piece.

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

    def piece(equations: Equations, times: Array) -> Solution:
        # Loops compile in about a second. Straight code is twice as fast, but compiles for minutes where it is long.
        loops = equations.space.nv >= COMPACT_FROM or precision != "double"
        code = _Code(equations, tolerance, precision, loops)
        names.add(code.best)
        try:
            solution = _propagate(code, equations, times, progress, precision, min_steps)
        finally:
            _pool.setdefault(code.name, []).append(code.integrator)
        return replace(solution, evaluations=solution.steps * order_of(tolerance), compile_seconds=code.compile_seconds)

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

    def __init__(self, equations: Equations, tolerance: float, precision: Precision, compact: bool) -> None:
        parts = ("taylor", str(order_of(tolerance)), precision, "compact" if compact else "straight")
        self.best, self.compile_seconds = equations.key(*parts), 0.0
        self._limit, self._how = taylor_seconds(equations), (tolerance, precision, compact)
        self._equations, rows = equations, equations.start[equations.moving :]
        at_hand = bool(_pool.get(self.best)) or cache.has(self.best)
        if at_hand or is_reproducible() or _spent.get(self.best, 0.0) > self._limit:
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

    def spend(self, seconds: float) -> None:
        """Count what solving took; go on with optimized code where that has become worth its compiling."""
        if self.name == self.best:
            return
        _spent[self.best] = _spent.get(self.best, 0.0) + seconds
        if _spent[self.best] > self._limit:
            integrator = self._made(self.best, self._equations)
            integrator.time, integrator.state[:] = self.integrator.time, self.integrator.state
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
    start_values = [kind(0.0)] * (size + 1)
    integrator = module.taylor_adaptive(
        system, start_values, compact_mode=compact, fp_type=kind, tol=kind(tolerance), **options
    )
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
    min_steps: float,
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
    done, steps, chunk, interrupted = 1, 0, CHUNK, False
    grid = times.astype(kind)
    try:
        while done < len(times):
            stop = min(len(times), done + chunk)
            start = time.perf_counter()
            taken, states = _grid(code.integrator, grid[done - 1 : stop], kind((times[-1] - times[0]) / min_steps))
            code.spend(time.perf_counter() - start)
            steps += taken
            out[done:stop] = states[1:, :size]
            done = stop
            if steps > MAX_STEPS:
                raise failure("too-many-steps", float(times[done - 1]), limit=MAX_STEPS)
            if progress is not None:
                progress(float(times[done - 1]))
            chunk = min(chunk * 4, MAX_CHUNK)
    except KeyboardInterrupt:
        interrupted = True
    double = out[:done].astype(float, copy=False).T
    precise = None if precision == "double" else out[:done]
    compiled: Code = "steps" if code.name == code.best else "first"
    return Solution(times[:done], double, steps, 0, compiled=compiled, interrupted=interrupted, precise=precise)


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
