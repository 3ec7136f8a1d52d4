"""How long compiling takes, estimated from the number of operations, what is too long to do unasked, and saying so."""

import contextlib
import logging
import os
import time
from collections.abc import Iterator
from contextvars import ContextVar

from twolink.integrate.equations import Equations
from twolink.integrate.methods import Method

MAX_COMPILING = 15.0  # s: code that takes longer to compile is not compiled unasked
MAX_IN_PARTS = 300.0  # s: of a scene with constraints or events, whose steps would take as long uncompiled
WORTH_A_WARNING = 5.0  # s
PROJECTED = 5.0  # evaluations that compile as slowly as the projection in a step
PROJECTION = 1.3  # the same of the projection alone
TAYLOR_EVALUATIONS = 12.0  # that compile as slowly as Taylor's method
UNOPTIMIZED = {"opt_level": 0}  # heyoka's option for code that is not called often: two to eight times as soon compiled
UNOPTIMIZED_SHARE = 1 / 7  # of the time to compile
log = logging.getLogger("twolink")
_asked_for: ContextVar[bool] = ContextVar("reproducible", default=False)


def is_reproducible() -> bool:
    """Whether the same bits are asked for from a scene's first run on: by TWOLINK_REPRODUCIBLE=1 or `reproducible`.

    The first code of a scene and the optimized code that follows round differently, and a study of this machine may
    choose another method.
    """
    return _asked_for.get() or os.environ.get("TWOLINK_REPRODUCIBLE", "") not in ("", "0")


@contextlib.contextmanager
def reproducible() -> Iterator[None]:
    """Within it, a run has the same bits on every machine of one kind, whatever ran before."""
    token = _asked_for.set(True)
    try:
        yield
    finally:
        _asked_for.reset(token)


def compiling_seconds(operations: float) -> float:
    """Seconds to compile so many operations, roughly.

    Processor seconds and their estimates, for steps of DOP853: UR5 3.0 and 2.7, Panda 12.8 and 11.3, squeezer 7.0 and
    4.8, bricard 10.9 and 10.3; for the rates of rows of 16 and 40 four-bars 0.8 and 0.9, 2.3 and 2.8.
    """
    return operations / 4_000 * (1.0 + operations / 20_000)


def step_seconds(equations: Equations, method: Method) -> float:
    """Seconds to compile a whole step."""
    projected = PROJECTED if equations.constraints is not None else 0.0
    return compiling_seconds(equations.operations * (method.evaluations + projected))


def in_parts(equations: Equations, method: Method) -> bool:
    """Whether the rate and the projection are compiled alone, since a whole step would take too long to compile."""
    return step_seconds(equations, method) > MAX_COMPILING


def parts_seconds(equations: Equations) -> float:
    """Seconds to compile the rate and, of constraints, the projection."""
    projection = PROJECTION if equations.constraints is not None else 0.0
    return compiling_seconds(equations.operations) + compiling_seconds(projection * equations.operations)


def taylor_seconds(equations: Equations) -> float:
    """Seconds to compile Taylor's method."""
    return compiling_seconds(equations.operations * TAYLOR_EVALUATIONS)


@contextlib.contextmanager
def announced(what: str, expected: float) -> Iterator[None]:
    """Log what is compiled and how long it is expected to take [s]: as a warning where somebody waits for it."""
    level, start = logging.WARNING if expected > WORTH_A_WARNING else logging.INFO, time.perf_counter()
    log.log(level, "compiling %s, about %.0f s, once: then it is in the cache", what, expected)
    yield
    log.log(level, "compiled and certified in %.1f s", time.perf_counter() - start)
