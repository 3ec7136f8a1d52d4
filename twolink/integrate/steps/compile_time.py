"""When code is compiled, and how well: how long that takes, what is too long to do unasked, and what pays later.

Better code takes longer to compile. Where that is too long to wait for, a scene is solved by code that compiles sooner,
until that has lost what compiling the better code takes. The two together cost at most twice what the better of them
would have (the ski rental problem). What was lost is counted by the name of the better code, for the process.
"""

import contextlib
import logging
import math
import os
import time
from collections.abc import Iterable, Iterator
from contextvars import ContextVar

from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.state import Array
from twolink.integrate.steps.methods import Method
from twolink.integrate.steps.step_building import Map

MAX_COMPILING = 15.0  # s: code that takes longer to compile is not compiled unasked
MAX_IN_PARTS = 300.0  # s: of a scene with constraints or events, whose steps would take as long uncompiled
WORTH_A_WARNING = 5.0  # s
PROJECTED = 5.0  # evaluations that compile as slowly as the projection in a step
PROJECTION = 1.3  # the same of the projection alone
TAYLOR_EVALUATIONS = 12.0  # that compile as slowly as Taylor's method
UNOPTIMIZED = {"opt_level": 0}  # heyoka's option for code that is not called often: two to eight times as soon compiled
UNOPTIMIZED_SHARE = 1 / 7  # of the time to compile
QUICK = 0.5  # s: whole steps that compile in less are compiled at once
SHARE = 0.5  # of the time for whole steps, that parts may take
# s of an evaluation within a step, and of each world in it, rounded from `scripts.benchmarks.first_answers --parts`
EVALUATION, WORLD = 2.5e-5, 6e-7
LOSS = 2.5e-10  # s of an operation without optimization: in rates of 8,000 to 16,000, alone and in batches
FOR_ANY_NUMBERS = 3.0  # s: whole steps that take numbers as inputs are compiled where that takes less
OF_BODIES = 2.0  # s: the motion of bodies that are stepped is compiled where that takes less
SOON = 4.0  # s: the accelerations that guards look at are compiled at once where that takes less
BY_NUMPY = 2.5e-5  # s of an operation of a look by NumPy
log = logging.getLogger("twolink")
_spent: dict[str, float] = {}  # s, by the name of the better code, in this process
_few: ContextVar[bool] = ContextVar("_few", default=False)  # whether each motion is solved a few times only
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


def count(name: str, seconds: float) -> None:
    """Add what was spent on runs that code of this name would have shortened."""
    _spent[name] = spent(name) + seconds


def spent(name: str) -> float:
    """Seconds spent in this process on runs that code of this name would have shortened."""
    return _spent.get(name, 0.0)


@contextlib.contextmanager
def solved_rarely() -> Iterator[None]:
    """What is solved within is not solved often: it is optimized only when it has cost as much as that would."""
    token = _few.set(True)
    try:
        yield
    finally:
        _few.reset(token)


def solved_often(names: Iterable[str]) -> None:
    """What is solved again is solved often: its code is optimized at once from now on, and some bits change once."""
    if not _few.get():
        _spent.update(dict.fromkeys(names, math.inf))


def first_steps_pay(equations: Equations, method: Method, name: str) -> bool:
    """Whether first steps are the quicker way to an answer. name: of the better code.

    Whole compiled steps take a tenth to a fiftieth of the time of steps in parts, and ten times as long to compile.
    Where that is too long, optimized parts are the better code.
    """
    better = _better_seconds(equations, method)
    soon = in_parts(equations, method) or parts_seconds(equations) < SHARE * better
    return better > max(QUICK, spent(name)) and soon


def _better_seconds(equations: Equations, method: Method) -> float:
    """Seconds to compile the better code: whole steps, or optimized parts where those take too long."""
    return parts_seconds(equations) if in_parts(equations, method) else step_seconds(equations, method)


def looks_pay(name: str, compiling: float) -> bool:
    """Whether what guards look at, of this name, shall be compiled, which takes so many seconds, and not by NumPy."""
    return compiling <= SOON or (not is_reproducible() and spent(name) > compiling)


class FirstSteps:
    """A step map in parts that counts what its steps lose, under the name of the better code."""

    def __init__(self, equations: Equations, method: Method, name: str, steps: Map) -> None:
        self._name, self._steps, evaluations = name, steps, method.evaluations
        self._call, self._world = evaluations * EVALUATION, evaluations * WORLD
        if in_parts(equations, method):
            evaluations += 2 * equations.space.size * (method.kind == "implicit")  # those of the Jacobian
            self._call, self._world = 0.0, LOSS * evaluations * equations.operations
        self._limit = _better_seconds(equations, method)

    def __call__(self, state: Array, out: Array) -> None:
        """One attempted step of each world."""
        count(self._name, self._call + self._world * state.shape[1])
        self._steps(state, out)

    @property
    def used_up(self) -> bool:
        """Whether these steps have lost as much as compiling the better code takes."""
        return spent(self._name) > self._limit
