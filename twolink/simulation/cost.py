"""Cost: what a run took."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from twolink.integrate.solution import Code
from twolink.simulation.text import BaseResult

KINDS = {"steps": "native", "": "by NumPy or SciPy"}
SUMS = "steps", "evaluations", "rejected", "seconds", "verify_seconds", "compile_seconds"


@dataclass(frozen=True, repr=False)
class Cost(BaseResult):
    """The cost of a run: the method, its steps and evaluations of the dynamics, and seconds of wall clock.

    Parameters
    ----------
    method : str
        Name of the method.
    tolerance : float or None
        Of a method that adapts its steps; None for steps of one size.
    steps, evaluations, rejected : int
        Steps taken, evaluations of the dynamics, and steps that were tried in vain.
    seconds, verify_seconds, compile_seconds : float
        Of solving; of what the error bar took; and of tracing or loading programs. Solutions behind the bar that are
        columns of one batch with the run cost the steps that the batch made for them after as many as the run's own.
        Runs that were not accurate enough count for the bar.
    compiled : {"steps", ""}
        Whether the steps were native: those of the native library, or of Taylor's method.
    why : str
        The reason for the method.
    step : float or None
        The step size of a method with steps of one size, s; None for one that adapts them.
    precision : {"double", "extended", "quad"}
        Of the numbers.
    """

    method: str
    tolerance: float | None
    steps: int
    evaluations: int
    seconds: float
    verify_seconds: float = 0.0
    compile_seconds: float = 0.0
    rejected: int = 0
    compiled: Code = ""
    why: str = ""
    step: float | None = None
    precision: str = "double"

    @property
    def setting(self) -> float:
        """The tolerance, or the step, s."""
        return float(self.tolerance or self.step or 0.0)

    def __repr__(self) -> str:
        setting = f"step {self.step:.3g} s" if self.tolerance is None else f"tolerance {self.tolerance:.2g}"
        kind = KINDS[self.compiled]
        others = (("error bar", self.verify_seconds), ("preparing", self.compile_seconds))
        seconds = ", ".join([f"{self.seconds:.3g} s", *(f"{what} {taken:.3g} s" for what, taken in others if taken)])
        digits = "" if self.precision == "double" else f", {self.precision} precision"
        return (
            f"{self.method}, {setting}{digits} ({self.why or 'as asked'})\n"
            f"{self.steps} steps ({kind}), {self.rejected} rejected, {self.evaluations} evaluations\n"
            f"solved in {seconds}"
        )


def together(own: Cost, others: Sequence[Cost], why: str) -> Cost:
    """The cost of a run with those of others."""
    return replace(own, **{name: sum(getattr(cost, name) for cost in (own, *others)) for name in SUMS}, why=why)
