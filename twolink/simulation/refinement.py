"""Refinement: which method and setting solve more accurately, and the errors where none does."""

from dataclasses import replace

from twolink.dynamics.kernels import heyoka
from twolink.errors import AccuracyError
from twolink.integrate.equations import Equations
from twolink.integrate.failures import MAX_STEPS
from twolink.integrate.method_choice import MethodChoice, second_tolerance
from twolink.integrate.methods import METHODS
from twolink.integrate.solver import smallest_tolerance
from twolink.simulation.trajectory import Trajectory

ROOM = 5.0  # times the smallest tolerance: a second solution must be able to be more accurate


def finer(choice: MethodChoice, equations: Equations, accuracy: float) -> MethodChoice:
    """What solves more accurately than the choice by construction. Raises AccuracyError where nothing does."""
    method, setting = choice.method, choice.setting
    if not method.adaptive:
        return replace(choice, setting=setting / 2)
    if method.kind == "taylor" and choice.precision == "double" and not equations.analytic:
        return MethodChoice(METHODS["dop853"], max(setting / 30, 1e-13), "the series may not converge")
    smallest = smallest_tolerance(method, choice.precision)
    if setting / 4 > smallest:
        return replace(choice, setting=max(second_tolerance(method, setting), smallest))
    if choice.precision == "double" and equations.analytic and heyoka() is not None:
        return MethodChoice(METHODS["taylor"], 1e-18, "more digits", "extended")
    raise AccuracyError(
        f"{accuracy:g} is below what can be verified in {choice.precision} precision",
        argument="accuracy",
        remedy='precision="quad", or the answer without an error bar: verify=False',
        code="accuracy-not-verifiable",
        precision=_more_precise(choice, equations),
    )


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
    smallest = smallest_tolerance(method, choice.precision) * (1.0 if equations.analytic else ROOM)
    if choice.setting <= smallest * 1.01:
        raise _accuracy_limit(choice, equations, accuracy, error, run)
    return replace(choice, setting=max(choice.setting * 0.5 / excess, smallest))


def _more_precise(choice: MethodChoice, equations: Equations) -> str:
    """The precision that would reach further, or ""."""
    return "quad" if choice.precision == "double" and equations.analytic else ""


def _accuracy_limit(
    choice: MethodChoice, equations: Equations, accuracy: float, error: float, run: Trajectory
) -> AccuracyError:
    until, more = run.trusted_until or 0.0, _more_precise(choice, equations)
    also = f', or precision="{more}"' if more else ""
    return AccuracyError(
        f"{accuracy:g} cannot be kept in {choice.precision} precision: the error bar is {error:.1e} at the end",
        where=f"t = {until:.6g} s",
        remedy=f"it is kept up to then: ask for duration={until:.6g}, for less accuracy{also}",
        code="accuracy-limit",
        run=run,
        trusted_until=until,
        precision=more,
    )
