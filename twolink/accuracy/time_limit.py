"""A clock that ends a solution when its time is up: every solver calls its progress function now and then."""

from __future__ import annotations

import time


class OverBudget(Exception):
    """The time is up at the simulated time `t` [s]. It never leaves this package."""

    def __init__(self, t: float) -> None:
        super().__init__(t)
        self.t = t


class Clock:
    """A progress function that raises OverBudget `limit` seconds after its first call: compiling comes before that."""

    def __init__(self, limit: float) -> None:
        self.limit = limit
        self.start: float | None = None

    @classmethod
    def of(cls, limit: float | None) -> Clock | None:
        """A clock, or None for no limit."""
        return None if limit is None else cls(limit)

    def __call__(self, t: float) -> None:
        now = time.perf_counter()
        if self.start is None:
            self.start = now
        elif now - self.start > self.limit:
            raise OverBudget(t)
