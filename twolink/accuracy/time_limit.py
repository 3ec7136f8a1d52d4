"""A limit on the time of a solution: every solver calls its progress function now and then."""

import time


class OverBudget(Exception):
    """The time is up at a simulated time t [s], after so many seconds. It never leaves this package."""

    def __init__(self, t: float, seconds: float) -> None:
        self.t, self.seconds = t, seconds
        super().__init__(f"stopped at t = {t:.3g} s after {seconds:g} s, the budget of a run")


class TimeLimit:
    """A progress function that raises OverBudget `seconds` after its first call: compiling comes before that."""

    def __init__(self, seconds: float) -> None:
        self.seconds = seconds
        self.start: float | None = None

    def __call__(self, t: float) -> None:
        now = time.perf_counter()
        if self.start is None:
            self.start = now
        if now - self.start >= self.seconds:
            raise OverBudget(t, self.seconds)
