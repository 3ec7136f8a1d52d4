"""Refinement: which method and setting solve more accurately, and the errors where none does."""

import math
from dataclasses import replace

import numpy as np

from twolink.dynamics.kernels import heyoka
from twolink.errors import AccuracyError
from twolink.integrate.compile_time import MAX_COMPILING, taylor_seconds
from twolink.integrate.equations import Equations
from twolink.integrate.failures import MAX_STEPS
from twolink.integrate.method_choice import MethodChoice, second_tolerance
from twolink.integrate.methods import METHODS, Method
from twolink.integrate.solver import smallest_tolerance
from twolink.simulation.trajectory import Trajectory

# Below this tolerance rounding may be a tenth of the error or more. The motion amplifies both alike, so that their
# ratio depends on the tolerance, not on the scene: on double pendulums of 5 to 20 s the error at 1e-11 is 45 times or
# more that of rounding alone in 9 of 10, by Taylor's method, DOP853 and RK45; at 1e-13 it is once to 12 times that.
ROUNDING_COUNTS = 5e-11
ROUNDING_MEASURED = 5e-12  # from this tolerance on a run that starts roundings away tells how much rounding counts
STIFF_ROUNDING_COUNTS = 1e-11  # of implicit methods: stiff motions damp roundings
MANY_STEPS = 2_000_000  # of a solution in double precision, that take minutes with more digits
MORE_DIGITS = 1e-18  # tolerance of solutions in extended precision that judge those in double precision
ROOM = 5.0  # times the smallest tolerance: a second solution must be able to be more accurate


def finer(
    choice: MethodChoice, equations: Equations, accuracy: float, steps: int = 0, *, digits_below: float = math.inf
) -> MethodChoice:
    """What solves more accurately than the choice, which took so many steps. Raises AccuracyError for nothing.

    digits_below: the tolerance below which it has more digits, at most that below which rounding may count.
    """
    method, setting = choice.method, choice.setting
    if not method.adaptive:
        return replace(choice, setting=setting / 2)
    if method.kind == "taylor" and choice.precision == "double" and not equations.analytic:
        return MethodChoice(METHODS["dop853"], max(setting / 30, 1e-13), "the series may not converge")
    smallest = smallest_tolerance(method, choice.precision)
    last = setting / 4 <= smallest
    if choice.precision == "double" and (last or setting < min(digits_below, rounding_tolerance(method))):
        more = more_digits(equations, steps, costly=last)
        if more is not None:
            return more
    if not last:
        return replace(choice, setting=max(second_tolerance(method, setting), smallest))
    raise AccuracyError(
        f"{accuracy:g} is below what can be verified in {choice.precision} precision",
        argument="accuracy",
        remedy='precision="quad", or the answer without an error bar: verify=False',
        code="accuracy-not-verifiable",
        precision=_more_precise(choice, equations),
    )


def rounding_tolerance(method: Method) -> float:
    """The tolerance of an adaptive method below which rounding may be a large part of the error."""
    return STIFF_ROUNDING_COUNTS if method.kind == "implicit" else ROUNDING_COUNTS


def more_digits(equations: Equations, steps: int = 0, *, costly: bool = False) -> MethodChoice | None:
    """Taylor's method in extended precision; None where the equations or the machine do not allow it.

    costly: even where it takes long to compile or to solve.
    """
    if not equations.analytic or heyoka() is None or np.finfo(np.longdouble).eps > 1e-18:
        return None
    if not costly and (taylor_seconds(equations) > MAX_COMPILING or steps > MANY_STEPS):
        return None
    return MethodChoice(METHODS["taylor"], MORE_DIGITS, "more digits", "extended")


def refined(choice: MethodChoice, equations: Equations, accuracy: float, run: Trajectory) -> MethodChoice:
    """The next setting for a run whose error bar is above the accuracy. Raises AccuracyError where there is none."""
    error = float(run.error[-1]) if run.error is not None else 0.0
    method, excess = choice.method, error / accuracy
    if not method.adaptive:
        setting = choice.setting * (0.5 / excess) ** (1 / method.order)
        steps = run.t[-1] / setting
        if steps > MAX_STEPS:
            raise AccuracyError(f"{method.name} would need {steps:.1e} steps for {accuracy:g}", argument="method",
                                remedy='method="auto", or less accuracy', code="too-many-steps", run=run)  # fmt: skip
        return replace(choice, setting=setting)
    room = ROOM if more_digits(equations, costly=True) is None else 1.0
    smallest = smallest_tolerance(method, choice.precision) * room
    if choice.setting <= smallest * 1.01:
        raise _accuracy_limit(choice, equations, accuracy, error, run)
    return replace(choice, setting=max(choice.setting * 0.5 / excess, smallest))


def limit_of_loops(
    error: AccuracyError, choice: MethodChoice, equations: Equations, accuracy: float, run: Trajectory | None
) -> AccuracyError:
    """The error to raise where a refined solution failed: what the run before can be trusted for, if there is one."""
    if error.code != "loops-singular" or run is None or run.error is None:
        return error
    return _accuracy_limit(choice, equations, accuracy, float(run.error[-1]), run)


def _more_precise(choice: MethodChoice, equations: Equations) -> str:
    """The precision that would reach further, or ""."""
    return "quad" if choice.precision == "double" and equations.analytic else ""


def _accuracy_limit(
    choice: MethodChoice, equations: Equations, accuracy: float, error: float, run: Trajectory
) -> AccuracyError:
    until, more = run.trusted_until or 0.0, _more_precise(choice, equations)
    shorter = f"it is kept up to then: ask for duration={until:.6g}, or " if until else ""
    also = f', or precision="{more}"' if more else ""
    return AccuracyError(
        f"{accuracy:g} cannot be kept in {choice.precision} precision: the error bar is {error:.1e} at the end",
        where=f"t = {until:.6g} s",
        remedy=f"{shorter}ask for less accuracy{also}",
        code="accuracy-limit",
        run=run,
        trusted_until=until,
        precision=more,
    )
