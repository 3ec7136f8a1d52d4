"""A limit of wall clock for solving."""

import time
from collections.abc import Callable
from typing import Any

from twolink.errors import AccuracyError
from twolink.integrate.solution import Progress


class OutOfTime(AccuracyError):
    """Solving took longer than allowed."""

    code = "out-of-time"

    def with_run(self, run: Any) -> "OutOfTime":
        """Copy the error, with the best run so far."""
        if run is None or run.error is None:
            return self
        bar = float(run.error[-1])
        return OutOfTime(f"{self.what}; the best run has an error bar of {bar:.1e} at the end", run=run,
                         where=self.where, remedy=f"{self.remedy}, such as accuracy={1.1 * bar:.2g}",
                         **self.data, trusted_until=run.trusted_until)  # fmt: skip


class TimeLimit:
    """A function of progress that raises OutOfTime when the time is up. Every solver calls it now and then.

    Parameters
    ----------
    seconds : float
        The time, from the first call on: compiling comes before that.
    clock : callable, optional
        `time.process_time` counts the seconds of computing, which other work on the machine does not prolong.
    progress : callable, optional
        Called too, with the simulated time.
    from_now : bool
        The time begins now, and compiling counts.
    """

    def __init__(
        self,
        seconds: float,
        clock: Callable[[], float] | None = None,
        *,
        progress: Progress | None = None,
        from_now: bool = False,
    ) -> None:
        self.seconds, self.clock, self.progress = seconds, clock or time.perf_counter, progress
        self.start: float | None = self.clock() if from_now else None

    def __call__(self, t: float, *_: object) -> None:
        now = self.clock()
        if self.start is None:
            self.start = now
        if now - self.start >= self.seconds:
            raise OutOfTime(f"stopped after {self.seconds:g} s, the time allowed", where=f"t = {t:.3g} s",
                            remedy=f"patience={10 * self.seconds:g}, or less accuracy",
                            t=t, seconds=self.seconds)  # fmt: skip
        if self.progress is not None:
            self.progress(t)
