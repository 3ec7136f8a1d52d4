"""A limit of wall-clock time for a simulation."""

import time
from collections.abc import Callable


class TooSlowError(Exception):
    """A simulation took longer than its limit."""


def deadline(seconds: float) -> Callable[[float], None]:
    """A `progress` for `simulate` that raises TooSlowError this long after its first call: compiling does not count."""
    begin = 0.0

    def progress(t: float) -> None:
        nonlocal begin
        begin = begin or time.perf_counter()
        if time.perf_counter() - begin >= seconds:
            raise TooSlowError(f"given up after {seconds:g} s, at t = {t:.3g} s")

    return progress
