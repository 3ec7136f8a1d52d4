"""Measuring methods: a row for each setting, from rough to accurate, as long as it pays."""

import math
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

from twolink.accuracy import settings as plan
from twolink.accuracy.reference_solution import ReferenceSolution
from twolink.accuracy.study_data import Failure, Row
from twolink.errors import AccuracyError, TwolinkError
from twolink.integrate.equations import Equations
from twolink.integrate.method_choice import first_setting
from twolink.integrate.methods import Method
from twolink.integrate.solution import Solution
from twolink.integrate.solver import solve
from twolink.integrate.state import Array
from twolink.integrate.step_map import step_map
from twolink.simulation.time_limit import OutOfTime, TimeLimit

ROUGH = 0.1  # rad or m: the error that the first step size of a method of fixed steps aims at
ROUNDING_BELOW = 1e-3  # an error above it may stop to fall for other reasons than rounding, such as chaos
IMPROVED = 0.7  # of the best error so far: a row above it is no improvement
MAX_WITHOUT_IMPROVEMENT = 2  # rows, after which rounding decides
SLOW = 0.5  # of the budget: what all timed runs of a row may take together


@dataclass
class Measurement:
    """A method at a setting: its row, its q (n, nq) to compute the error from, and the seconds of its runs."""

    method: Method
    setting: float
    row: Row
    q: Array
    seconds: list[float]


@dataclass
class Measurements:
    """What all rows of a study have in common, the measurements so far, and the failures."""

    equations: Equations
    times: Array
    reference: ReferenceSolution
    repeats: int
    budget: float
    done: list[Measurement] = field(default_factory=list)
    failures: list[Failure] = field(default_factory=list)

    def fail(self, method: Method, setting: float | None, reason: str) -> None:
        """Add a failure."""
        tolerance, step = (setting, None) if method.adaptive else (None, setting)
        self.failures.append(Failure(method.name, tolerance, step, reason))

    def measure(self, method: Method, setting: float) -> Row | None:
        """Add the row of a method at a setting; None when there is none. Raises OutOfTime, KeyboardInterrupt."""
        compiling = 0.0
        try:
            if method.kind not in ("taylor", "scipy"):  # else the first rows might be of steps in parts
                compiling = step_map(self.equations, method, whole=True).compile_seconds
            first, first_seconds = self._run(method, setting, TimeLimit(self.budget))
        except OutOfTime:
            raise
        except AccuracyError as error:
            self.fail(method, setting, str(error))
            return None
        # A slow first run counts itself: warming up takes little in comparison.
        seconds = self._run(method, setting)[1] if first_seconds < SLOW * self.budget else first_seconds
        tolerance, step = (setting, None) if method.adaptive else (None, setting)
        q = self.equations.space.rows(first.x)[0]
        distance = self.reference.error_of(self.equations.space, q)
        row = Row(method.name, tolerance, step, distance, seconds, first.evaluations, first.steps, first.rejected,
                  compiling + first.compile_seconds)  # fmt: skip
        self.done.append(Measurement(method, setting, row, q, [seconds]))
        return row

    def time_again(self, number: int) -> None:
        """Run each row once more, all in turns: a slow moment of the machine must not affect one row alone.

        number: which run it is, from 2. Rows whose runs are slow have fewer of them.
        """
        for entry in self.done:
            if entry.row.seconds * number < SLOW * self.budget:
                entry.seconds.append(self._run(entry.method, entry.setting)[1])
                entry.row = replace(entry.row, seconds=statistics.median(entry.seconds))

    def _run(self, method: Method, setting: float, limit: TimeLimit | None = None) -> tuple[Solution, float]:
        start = time.perf_counter()
        solution = solve(self.equations, method, self.times, setting, limit)
        if solution.interrupted:
            raise KeyboardInterrupt
        return solution, time.perf_counter() - start - solution.compile_seconds


class _Progression:
    """The rows of one method, and whether more of them pay."""

    def __init__(
        self, measurements: Measurements, method: Method, to_the_end: bool, announce: Callable[[int, float], None]
    ) -> None:
        self.measurements, self.method, self.to_the_end, self.announce = measurements, method, to_the_end, announce
        self.number, self.without_improvement, self.best, self.finest = 0, 0, math.inf, math.inf
        self.ended = False

    def measure(self, setting: float) -> Row | None:
        """The row of a setting, or None; sets `ended` when a run took too long or rounding decides."""
        self.announce(self.number, setting)
        self.number += 1
        try:
            row = self.measurements.measure(self.method, setting)
        except TwolinkError as error:  # such as a compiled step that disagrees with Pinocchio's
            self.measurements.fail(self.method, setting, str(error))
            self.ended = True
            return None
        if row is None:
            return None
        if setting < self.finest:
            improved = self.best >= ROUNDING_BELOW or row.error <= IMPROVED * self.best
            self.without_improvement = 0 if improved else self.without_improvement + 1
            self.best, self.finest = min(self.best, row.error), setting
        rounding = self.without_improvement >= MAX_WITHOUT_IMPROVEMENT and not self.to_the_end
        self.ended = rounding or row.seconds > self.measurements.budget
        return row


def measure_method(
    measurements: Measurements,
    method: Method,
    tolerances: tuple[float, ...] | None,
    announce: Callable[[int, float], None],
) -> None:
    """Measure a method at its settings, rough ones first, until a run takes too long or rounding decides.

    tolerances: all of them, in place of our own; a method of fixed steps takes steps that aim at them. announce: called
    with the number of each row and its setting.
    """
    equations = measurements.equations
    reason = plan.why_not_here(equations, method)
    if reason is not None:
        measurements.fail(method, None, reason)
        return
    progression = _Progression(measurements, method, tolerances is not None, announce)
    longest = float(measurements.times[-1]) / 2
    if not method.adaptive and tolerances is None:
        _measure_step_sizes(progression, min(longest, first_setting(equations, method, ROUGH)), longest)
        return
    settings = (plan.adaptive_settings(method, tolerances) if method.adaptive
                else plan.steps_for(equations, method, tolerances or (), longest))  # fmt: skip
    for setting in settings:
        progression.measure(setting)
        if progression.ended:
            return


def _measure_step_sizes(progression: _Progression, start: float, longest: float) -> None:
    """Longer steps from the start while the error is well below ROUGH, then shorter ones, a decade of error each."""
    factor, step = plan.step_factor(progression.method), start
    row = progression.measure(step)
    while row is not None and row.error < ROUGH / 3 and step * factor <= longest:
        if progression.ended or progression.number >= plan.STEP_SIZES // 2:
            break
        step *= factor
        row = progression.measure(step)
    for i in range(1, plan.STEP_SIZES - progression.number + 1):
        if progression.ended:
            return
        progression.measure(start / factor**i)
