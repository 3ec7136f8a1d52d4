"""Ladders: the settings of a method from rough to accurate, and one run at each, as long as it pays."""

from __future__ import annotations

import importlib
import math
import statistics
import time
from collections.abc import Callable, Generator
from dataclasses import dataclass, field, replace

from twolink.accuracy.result import Failure, Row
from twolink.accuracy.time_limit import Clock, OverBudget
from twolink.accuracy.truth import TAYLOR_COMPILES_LIKE, Truth
from twolink.dynamics.kernels import heyoka
from twolink.errors import AccuracyError, TwolinkError
from twolink.integrate.compile_time import MAX_COMPILING, compiling_seconds
from twolink.integrate.equations import Equations
from twolink.integrate.method_choice import first_setting
from twolink.integrate.methods import Method
from twolink.integrate.solution import Solution
from twolink.integrate.solver import smallest_tolerance, solve
from twolink.integrate.state import Array

TOLERANCES = tuple(float(f"1e-{k}") for k in range(2, 17))
TAYLOR_TOLERANCES = tuple(float(f"1e-{k}") for k in range(2, 17, 2))  # each is an order, to be compiled
ROUGH = 0.1  # rad or m: where the ladder of a fixed-step method begins, about
RUNGS = 14  # of a fixed-step method
MOST_SHORTENED = 4.0  # from one step size to the next: order 1 would jump by 10
JACOBIAN = 2.5  # how much more there is to compile with a Jacobian and linear equations (ur5, panda)
ROUNDING_BELOW = 1e-3  # an error above this stands still for other reasons, such as chaos
IMPROVED = 0.7
SLOW = 0.5  # of the budget: what all timed runs of an entry may take together


@dataclass
class Entry:
    """A method at a setting: its row, its q (n, nq) to measure the error again by, and the seconds of its runs."""

    method: Method
    row: Row
    q: Array
    seconds: list[float]

    @property
    def setting(self) -> float:
        """The tolerance or the step."""
        return float(self.row.tolerance or self.row.step or 0.0)


@dataclass
class Measuring:
    """What every entry of a study has in common, the entries so far, and the failures."""

    equations: Equations
    times: Array
    truth: Truth
    repeats: int
    budget: float
    found: list[Entry] = field(default_factory=list)
    failures: list[Failure] = field(default_factory=list)

    def fail(self, method: Method, setting: float | None, reason: str) -> None:
        """Note a failure."""
        tolerance, step = (setting, None) if method.adaptive else (None, setting)
        self.failures.append(Failure(method.name, tolerance, step, reason))

    def enter(self, method: Method, setting: float) -> Row | None:
        """The row of a method at a setting, noted; None when there is none. Raises OverBudget, KeyboardInterrupt."""
        try:
            first, warming = self._run(method, setting, Clock(self.budget))
        except AccuracyError as error:
            self.fail(method, setting, str(error))
            return None
        # A slow first run counts itself: what it warms up is little in comparison.
        seconds = self._run(method, setting)[1] if warming < SLOW * self.budget else warming
        tolerance, step = (setting, None) if method.adaptive else (None, setting)
        q = self.equations.space.rows(first.x)[0]
        off = self.truth.error_of(self.equations.space, q)
        row = Row(method.name, tolerance, step, off, seconds, first.evaluations, first.steps, first.rejected,
                  first.compile_seconds)  # fmt: skip
        self.found.append(Entry(method, row, q, [seconds]))
        return row

    def time_again(self, number: int) -> None:
        """Another run of each entry, in turns, so that a slow moment of the machine does not hit one entry alone.

        number: which run it is, from 2. Entries whose runs are slow have fewer of them.
        """
        for entry in self.found:
            if entry.row.seconds * number < SLOW * self.budget:
                entry.seconds.append(self._run(entry.method, entry.setting)[1])
                entry.row = replace(entry.row, seconds=statistics.median(entry.seconds))

    def _run(self, method: Method, setting: float, clock: Clock | None = None) -> tuple[Solution, float]:
        start = time.perf_counter()
        solution = solve(self.equations, method, self.times, setting, clock)
        if solution.interrupted:
            raise KeyboardInterrupt
        return solution, time.perf_counter() - start - solution.compile_seconds


def count(method: Method, tolerances: tuple[float, ...] | None) -> int:
    """How many entries a method's ladder has at most."""
    if tolerances is None and not method.adaptive:
        return RUNGS
    return len(settings(method, tolerances))


def settings(method: Method, tolerances: tuple[float, ...] | None) -> list[float]:
    """The tolerances of an adaptive method, from rough to accurate; none is below what its numbers resolve."""
    wanted = tolerances or (TAYLOR_TOLERANCES if method.kind == "taylor" else TOLERANCES)
    return sorted({max(t, smallest_tolerance(method)) for t in wanted}, reverse=True)


def climb(
    measuring: Measuring, method: Method, tolerances: tuple[float, ...] | None, before: Callable[[int, float], None]
) -> None:
    """Measure a method at its settings, rough ones first, until a run takes too long or rounding decides.

    tolerances: all of them, in place of our own; a method of fixed steps takes steps that aim at them. before: called
    with the number of each entry and its setting.
    """
    reason = not_here(measuring.equations, method)
    if reason is not None:
        measuring.fail(method, None, reason)
        return
    number, stands, best, finest = 0, 0, math.inf, math.inf
    rungs = _rungs(measuring, method, tolerances)
    setting = next(rungs)
    while True:
        before(number, setting)
        try:
            row = measuring.enter(method, setting)
        except OverBudget as over:
            what = f"stopped at t = {over.t:.3g} s after {measuring.budget:g} s, the budget of a run"
            measuring.fail(method, setting, what)
            return
        except TwolinkError as error:  # not of this setting, such as a compiled step that disagrees with Pinocchio's
            measuring.fail(method, setting, str(error))
            return
        if row is not None and setting < finest:
            stands = stands + 1 if best < ROUNDING_BELOW and row.error > IMPROVED * best else 0
            best, finest = min(best, row.error), setting
        if (stands >= 2 and tolerances is None) or (row is not None and row.seconds > measuring.budget):
            return
        number += 1
        try:
            setting = rungs.send(row)
        except StopIteration:
            return


def _rungs(
    measuring: Measuring, method: Method, tolerances: tuple[float, ...] | None
) -> Generator[float, Row | None, None]:
    """The settings one by one; each is answered with the row it gave.

    Steps of fixed size begin where the error is expected near 0.1, go up while it is smaller, and then down, each for
    a decade of error where the method keeps its order.
    """
    equations, longest = measuring.equations, float(measuring.times[-1]) / 2
    if method.adaptive:
        given = settings(method, tolerances)
    else:
        given = sorted({min(longest, first_setting(equations, method, t)) for t in tolerances or ()}, reverse=True)
    for setting in given:  # noqa: UP028  # a list takes no answers
        yield setting
    if given:
        return
    factor = min(MOST_SHORTENED, 10.0 ** (1 / method.order))
    step = start = min(longest, first_setting(equations, method, ROUGH))
    row = yield step
    taken = 1
    while row is not None and row.error < ROUGH / 3 and step * factor <= longest and taken < RUNGS // 2:
        step *= factor
        row = yield step
        taken += 1
    for i in range(1, RUNGS - taken + 1):
        yield start / factor**i


def not_here(equations: Equations, method: Method) -> str | None:
    """Why a method cannot run here, or would take too long to compile; None when it can."""
    if method.kind == "scipy":
        importlib.import_module("scipy.integrate")  # takes longer than most runs, and is none of their business
        return None
    if heyoka() is None:
        return "it needs heyoka, which is not installed" if method.kind == "taylor" else None
    evaluations = TAYLOR_COMPILES_LIKE if method.kind == "taylor" else float(method.evaluations)
    if method.kind == "implicit":
        evaluations *= JACOBIAN
    seconds = compiling_seconds(int(equations.operations * evaluations))
    if seconds <= MAX_COMPILING:
        return None
    return f"its steps would take about {seconds:.0f} s to compile, the limit is {MAX_COMPILING:.0f} s"
