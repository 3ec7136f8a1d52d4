"""The settings at which a method is measured, and whether it can be measured here."""

import importlib

from twolink.dynamics.kernels import heyoka
from twolink.integrate.compile_time import MAX_COMPILING, TAYLOR_EVALUATIONS, compiling_seconds
from twolink.integrate.equations import Equations
from twolink.integrate.method_choice import first_setting
from twolink.integrate.methods import Method
from twolink.integrate.solver import smallest_tolerance

TOLERANCES = tuple(float(f"1e-{k}") for k in range(2, 17))
TAYLOR_TOLERANCES = tuple(float(f"1e-{k}") for k in range(2, 17, 2))  # each needs an order of its own, compiled
STEP_SIZES = 14  # of a method of fixed steps
MAX_FACTOR = 4.0  # from one step size to the next: a method of order 1 would jump by 10 for a digit
JACOBIAN = 2.5  # how much more there is to compile with a Jacobian and linear equations (UR5, Panda)


def count(method: Method, tolerances: tuple[float, ...] | None) -> int:
    """The largest number of settings of a method."""
    return STEP_SIZES if tolerances is None and not method.adaptive else len(adaptive_settings(method, tolerances))


def adaptive_settings(method: Method, tolerances: tuple[float, ...] | None) -> list[float]:
    """The tolerances of an adaptive method, from rough to accurate; none is below what its numbers resolve."""
    wanted = tolerances or (TAYLOR_TOLERANCES if method.kind == "taylor" else TOLERANCES)
    return sorted({max(t, smallest_tolerance(method)) for t in wanted}, reverse=True)


def steps_for(equations: Equations, method: Method, tolerances: tuple[float, ...], longest: float) -> list[float]:
    """Step sizes [s] that aim at tolerances, from rough to accurate."""
    return sorted({min(longest, first_setting(equations, method, t)) for t in tolerances}, reverse=True)


def step_factor(method: Method) -> float:
    """From one step size to the next: a decade of error where the method keeps its order."""
    return float(min(MAX_FACTOR, 10.0 ** (1 / method.order)))


def why_not_here(equations: Equations, method: Method) -> str | None:
    """Why a method cannot run here, or would take too long to compile; None when it can."""
    if method.kind == "scipy":
        importlib.import_module("scipy.integrate")  # takes longer than most runs, and must not count as a run's time
        return None
    if heyoka() is None:
        return "it needs heyoka, which is not installed" if method.kind == "taylor" else None
    evaluations = TAYLOR_EVALUATIONS if method.kind == "taylor" else float(method.evaluations)
    if method.kind == "implicit":
        evaluations *= JACOBIAN
    seconds = compiling_seconds(equations.operations * evaluations)
    if seconds <= MAX_COMPILING:
        return None
    return f"its steps would take about {seconds:.0f} s to compile, the limit is {MAX_COMPILING:.0f} s"
