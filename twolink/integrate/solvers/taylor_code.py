"""Compiled Taylor integrators: made, and kept by name for one user at a time.

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
from typing import Any, Literal

import numpy as np

from twolink.algorithms.mechanism import nominal, parameter_names
from twolink.algorithms.namespaces import Expressions
from twolink.dynamics.kernels import heyoka
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.formulas import traced_rate
from twolink.io import cache

COMPACT_FROM = 4  # degrees of freedom from which heyoka compiles loops in place of straight code
RESTORING = 1.0  # 1/s: how fast a quaternion's length returns to 1, which the exact motion never leaves
DIGITS = 256  # bits of the constants behind quadruple precision
COMPANION = 16.0  # c
TAYLOR_EVALUATIONS = 12.0  # that compile as slowly as Taylor's method
UNOPTIMIZED = {"opt_level": 0}  # heyoka's option for code that is not called often
UNOPTIMIZED_SHARE = 1 / 7  # of the time to compile

Precision = Literal["double", "extended", "quad"]
log = logging.getLogger("twolink")


def number_type(precision: Precision) -> Any:
    """The type of a number of this precision."""
    return {"double": float, "extended": np.longdouble, "quad": getattr(heyoka(), "real128", None)}[precision]


def taylor_seconds(equations: Equations) -> float:
    """Seconds to compile Taylor's method, roughly."""
    operations = equations.operations * TAYLOR_EVALUATIONS
    return operations / 4_000 * (1.0 + operations / 20_000)


def order_of(tolerance: float) -> int:
    """The order that makes a step's error the tolerance: ceil(1 - log(tolerance) / 2) (Jorba, Zou 2005)."""
    return max(3, math.ceil(1 - math.log(tolerance) / 2))


_pool: dict[str, list[Any]] = {}
_lock = threading.Lock()
MAX_POOL = 64


class Integrator:
    """An integrator that no thread is using, `integrator`, the name of its code, and the numbers that are its `pars`.

    Code of more digits than a double's is rarely run twice: it is not optimized, which compiles in a seventh of the
    time and runs twice as long.
    """

    def __init__(
        self, equations: Equations, tolerance: float, precision: Precision, compact: bool, lanes: int = 1
    ) -> None:
        parts = ("taylor", str(order_of(tolerance)), precision, "compact" if compact else "straight", f"{lanes} lanes")
        self.name, self.numbers = equations.key(*parts), equations.start[equations.moving :]
        options = {} if precision == "double" else UNOPTIMIZED
        start = time.perf_counter()
        self.integrator = _take(self.name) or _build(
            self.name, equations, tolerance, precision, compact, lanes, **options
        )
        self.compile_seconds = time.perf_counter() - start

    def give_back(self) -> None:
        """Let others use the integrator."""
        _pool.setdefault(self.name, []).append(self.integrator)


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
    **options: Any,
) -> Any:
    module, start = heyoka(), time.perf_counter()
    log.info("compiling Taylor's method of order %d for %s", order_of(tolerance), equations.robot.name)
    xp = Expressions(module)
    size = equations.moving
    rows = [module.par[i] for i in range(equations.space.size - size)]
    x = np.array([module.expression(f"x{i}") for i in range(size)] + rows, dtype=object)
    constants = {} if precision == "double" else _exact_constants(equations, module)
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
