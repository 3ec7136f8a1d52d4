"""Compiled Taylor integrators: made, kept by name for one user at a time, and optimized once that pays.

The step size follows from the last two coefficients. Where a motion starts from symmetric rest, both may vanish by
symmetry, and the step size becomes infinite (the paper's own release does so at orders 8, 12 and 20). A companion with
the motion's singularities, but not its symmetries, is therefore integrated beside it:

    u = log(c + x . x) / 2,   u' = x . x' / (c + x . x)

From rest, all even coefficients of u are nonzero, and one of two neighbouring orders is even. A logarithm grows slowly,
so that u never decides the scale of the error. c = 16 costs 2 % more steps on the paper's arm. c = 1 adds singularities
(20 % more steps); c = 1000 protects less.
"""

import logging
import math
import threading
import time
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np

from twolink.algorithms.mechanism import nominal, parameter_names
from twolink.algorithms.namespaces import Expressions
from twolink.dynamics.kernels import heyoka
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.formulas import traced_rate
from twolink.integrate.motion.scene_equations import structure_of
from twolink.integrate.steps.compile_time import UNOPTIMIZED, count, is_reproducible, spent, taylor_seconds
from twolink.io import cache

COMPACT_FROM = 4  # degrees of freedom from which heyoka compiles loops in place of straight code
RESTORING = 1.0  # 1/s: how fast a quaternion's length returns to 1, which the exact motion never leaves
DIGITS = 256  # bits of the constants behind quadruple precision
COMPANION = 16.0  # c

Precision = Literal["double", "extended", "quad"]
log = logging.getLogger("twolink")


def number_type(precision: Precision) -> Any:
    """The type of a number of this precision."""
    return {"double": float, "extended": np.longdouble, "quad": getattr(heyoka(), "real128", None)}[precision]


def order_of(tolerance: float) -> int:
    """The order that makes a step's error the tolerance: ceil(1 - log(tolerance) / 2) (Jorba, Zou 2005)."""
    return max(3, math.ceil(1 - math.log(tolerance) / 2))


_pool: dict[str, list[Any]] = {}
_lock = threading.Lock()
MAX_POOL = 64


class Integrator:
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
        at_hand = bool(_pool.get(self.best)) or spent(self.best) > self._limit
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
        count(self.best, seconds)
        if spent(self.best) > self._limit:
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
    kind = number_type(precision)
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
