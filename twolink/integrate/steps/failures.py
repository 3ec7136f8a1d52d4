"""Failures that every solver reports alike: no finite numbers, no progress, or too many steps."""

from typing import Any

from twolink.errors import AccuracyError

MAX_STEPS = 10_000_000
HOPELESS = 100  # how many times too slow the pace must be
SHORTER = "ask for a shorter duration or less accuracy"
TEXTS = {  # by code: what, remedy
    "steps-collapsed": ("the step size has collapsed: the equations are stiff, singular or not finite there",
                        f'try method="esdirk43" or "scipy-radau" for stiff scenes, or {SHORTER}'),
    "loops-singular": ("the step size has collapsed: the loops are singular there, and steps of this tolerance do not "
                       "get across", "ask for less accuracy, or a duration that ends before"),
    "not-finite": ("the state is not finite any more", "check forces and the initial state"),
    "step-too-large": ("the state is not finite any more", "take steps smaller than {step:.3g} s"),
    "acceleration-not-finite": ("the acceleration is not finite", "check forces, masses and the initial state"),
    "too-many-steps": ("more than {limit:,} steps are needed to the end", SHORTER),
}  # fmt: skip


def failure(code: str, t: float, cause: str = "", **data: float) -> AccuracyError:
    """The error of a code at a time t [s], and what causes it; its data has t and the numbers of the message."""
    what, remedy = (text.format(**data) for text in TEXTS[code])
    what = f"{what}: {cause}" if cause else what
    return AccuracyError(what, where=f"t = {t:.6g} s", remedy=remedy, code=code, t=t, **data)


def is_hopeless(steps: Any, limit: float, t: Any, start: Any, end: Any) -> Any:
    """True if the pace so far leads beyond HOPELESS times the limit of steps; of numbers or of one a world (n,)."""
    return steps * (end - start) > HOPELESS * limit * (t - start)
