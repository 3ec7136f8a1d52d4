"""heyoka, a peer of Taylor's method: our formulas as its expressions, and its integrators of our equations.

Biscani, Izzo: MNRAS 504 (2021) 2614-2628. There are wheels for Linux.
"""

import sys
from collections.abc import Mapping
from typing import Any

import numpy as np

from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.formulas import traced_rate
from twolink.integrate.solvers.taylor import COMPANION, exact_constants, with_companion

DIGITS = 256  # bits of constants


def heyoka() -> Any:
    """The module, without SymPy, which it imports for conversions, and without its caches."""
    hidden = "sympy" not in sys.modules
    if hidden:
        sys.modules["sympy"] = None  # makes its import fail
    try:
        import heyoka as module
    finally:
        if hidden:
            del sys.modules["sympy"]
    module.llvm_state.set_diskcache_enabled(False)
    module.llvm_state.set_memcache_limit(0)
    return module


class Expressions:
    """The namespace xp of its expressions."""

    def __init__(self, module: Any) -> None:
        self.module, self.sin, self.cos = module, module.sin, module.cos
        self.sqrt, self.exp, self.tanh, self.atan2 = module.sqrt, module.exp, module.tanh, module.atan2
        self.where = np.frompyfunc(lambda c, a, b: module.select(c, self.lift(a), self.lift(b)), 3, 1)
        self.less = np.frompyfunc(lambda a, b: module.lt(self.lift(a), self.lift(b)), 2, 1)
        self.less_equal = np.frompyfunc(lambda a, b: module.lte(self.lift(a), self.lift(b)), 2, 1)

    def lift(self, x: Any) -> Any:
        """x as an expression."""
        return x if isinstance(x, self.module.expression) else self.module.expression(float(x))

    def reciprocal(self, x: Any) -> Any:
        """1 / x of a positive x. Behind a condition it stays one division for all its uses."""
        return self.module.select(self.module.gt(x, self.lift(0.0)), 1.0 / x, self.lift(np.nan))

    def both(self, a: Any, b: Any) -> Any:
        """Whether both hold."""
        return self.module.logical_and([a, b])

    @staticmethod
    def power(x: Any, exponent: float) -> Any:
        """x to a constant power."""
        return x**exponent


def number_type(precision: str) -> Any:
    """The type of its numbers of 16, 19 and 33 digits."""
    return {"double": float, "extended": np.longdouble, "quad": getattr(heyoka(), "real128", None)}[precision]


def parts_of(x: np.ndarray) -> np.ndarray:
    """Numbers of any type as sums of three doubles (..., 3)."""
    out = []
    for _ in range(3):
        out.append(x.astype(float))
        x = x - out[-1].astype(x.dtype)
    return np.stack(out, axis=-1)


def system_of(equations: Equations, constants: Mapping[str, Any] | None = None) -> list[tuple[Any, Any]]:
    """x' as its expressions; the numbers of the state array, then the equations' parameters, are its `par`.

    constants: of the model, by name.
    """
    module, size = heyoka(), equations.moving
    xp, rows = Expressions(module), equations.space.size - size
    x: Any = np.array([module.expression(f"x{i}") for i in range(size)] + [module.par[i] for i in range(rows)])
    given = {name: module.par[i] for i, name in enumerate(equations.parameters, rows)}
    rate = traced_rate(equations, module.time, x, xp, {**(constants or {}), **given})[:size]
    return list(zip(x[:size], map(xp.lift, rate), strict=True))


def integrator(equations: Equations, tolerance: float, precision: str, **options: Any) -> Any:
    """Its integrator of equations at their start, with the constants and the companion of ours."""
    module, kind = heyoka(), number_type(precision)
    exact = {name: module.expression(module.real(value, DIGITS)) for name, value in exact_constants(equations).items()}
    system = system_of(equations, {} if precision == "double" else exact)
    x, rate = (np.array(part, dtype=object) for part in zip(*system, strict=True))
    rates = with_companion(equations, x, rate)
    start = np.append(equations.start[: len(x)], 0.5 * np.log(COMPANION + np.square(equations.start[: len(x)]).sum()))
    made = module.taylor_adaptive([*zip([*x, module.expression("u")], rates, strict=True)], start.astype(kind),
                                  fp_type=kind, tol=kind(tolerance), **options)  # fmt: skip
    made.pars[:] = equations.start[len(x) :].astype(kind)[: len(made.pars)]
    return made


def states_at(made: Any, times: np.ndarray, longest: float) -> np.ndarray:
    """The states (n, size) of an integrator at times, of which the first is where it is."""
    kind = type(made.time)
    found = made.propagate_grid(times.astype(kind), max_delta_t=kind(longest))
    if found[0] != heyoka().taylor_outcome.time_limit:
        raise ArithmeticError(str(found[0]))
    return np.asarray(found[-1][:, :-1])
