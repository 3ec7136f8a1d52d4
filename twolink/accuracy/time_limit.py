"""A limit on the time of a solution: every solver calls its progress function now and then."""

import time
from collections.abc import Callable


class OverBudget(Exception):
    """The time is up at a simulated time t [s], after so many seconds. It never leaves this package."""

    def __init__(self, t: float, seconds: float) -> None:
        self.t, self.seconds = t, seconds
        super().__init__(f"stopped at t = {t:.3g} s after {seconds:g} s, the budget of a run")


class TimeLimit:
    """A progress function that raises OverBudget `seconds` after its first call: compiling comes before that.

    clock: `time.process_time` counts the seconds of computing, which other work on the machine does not prolong.
    """

    def __init__(self, seconds: float, clock: Callable[[], float] | None = None) -> None:
        self.seconds, self.clock = seconds, clock or time.perf_counter
        self.start: float | None = None

    def __call__(self, t: float) -> None:
        now = self.clock()
        if self.start is None:
            self.start = now
        if now - self.start >= self.seconds:
            raise OverBudget(t, self.seconds)
