"""Failures that every solver reports alike, with codes: no finite numbers, no progress, or too many steps."""

from __future__ import annotations

from typing import Any

from twolink.errors import AccuracyError

MAX_STEPS = 10_000_000
HOPELESS = 100  # how many times too slow the pace must be


def is_hopeless(steps: Any, limit: float, t: Any, start: Any, end: Any) -> Any:
    """Whether the pace so far leads beyond HOPELESS times the limit of steps; of numbers or of one a world (n,)."""
    return steps * (end - start) > HOPELESS * limit * (t - start)


def collapsed(t: float) -> AccuracyError:
    """The step size has become too small to go on."""
    return AccuracyError(
        "the step size has collapsed: the equations are stiff, singular or not finite there",
        where=f"t = {t:.6g} s",
        remedy='try method="esdirk43" or "scipy-radau" for stiff scenes, a shorter duration, or less accuracy',
        code="steps-collapsed",
        t=t,
    )


def not_finite(t: float, step: float | None = None) -> AccuracyError:
    """The state is not finite any more, by steps of a fixed size `step` or by adapted ones (None)."""
    remedy = "check forces and the initial state" if step is None else f"take steps smaller than {step:.3g} s"
    what = "the state is not finite any more"
    return AccuracyError(what, where=f"t = {t:.6g} s", remedy=remedy, code="not-finite", t=t)


def acceleration_not_finite(t: float) -> AccuracyError:
    """The equations give no finite acceleration."""
    return AccuracyError(
        "the acceleration is not finite",
        where=f"t = {t:.6g} s",
        remedy="check forces, masses and the initial state",
        code="not-finite",
        t=t,
    )


def too_many_steps(t: float, limit: int = MAX_STEPS) -> AccuracyError:
    """More steps than the limit are needed."""
    return AccuracyError(
        f"more than {limit:,} steps are needed to the end",
        where=f"t = {t:.6g} s",
        remedy="ask for a shorter duration or less accuracy",
        code="too-many-steps",
        t=t,
        limit=limit,
    )


def angle_out_of_reach(t: float, limit: float) -> AccuracyError:
    """An angle is beyond the arguments that the compiled sine takes."""
    return AccuracyError(
        f"an angle is beyond {limit:.0e} rad",
        where=f"t = {t:.6g} s",
        remedy='make the joint continuous, or use method="taylor" or "scipy-dop853"',
        code="angle-out-of-reach",
        t=t,
    )
