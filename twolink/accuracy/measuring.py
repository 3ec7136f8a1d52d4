"""Measuring methods: a row for each setting, from rough to accurate, as long as it pays; the reference that errors are
measured against, and its own error.

The reference is Taylor's method in numbers of 31 digits, verified as every run is. They are kept as sums of two
doubles, q + rest. With events it is Dormand and Prince's of order 8.
"""

import importlib
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from twolink.accuracy.study_data import MethodFailure, Reference, Row
from twolink.errors import AccuracyError, TwolinkError
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.state import Array, StateSpace
from twolink.integrate.solution import Solution
from twolink.integrate.solver import MethodChoice, first_setting, smallest_tolerance, solve
from twolink.integrate.solvers.taylor import Precision
from twolink.integrate.steps.methods import METHODS, Method
from twolink.integrate.steps.step_map import step_map
from twolink.native.library import library
from twolink.native.programs import SPENT
from twolink.simulation.refinement import DIGITS
from twolink.simulation.time_limit import OutOfTime, TimeLimit
from twolink.simulation.verification import Verification

TOLERANCES = tuple(float(f"1e-{k}") for k in range(2, 17))
TAYLOR_TOLERANCES = tuple(float(f"1e-{k}") for k in range(2, 17, 2))
STEP_SIZES = 14  # of a method of fixed steps
MAX_FACTOR = 4.0  # from one step size to the next: a method of order 1 would jump by 10 for a digit
NO_LIBRARY = "there is no native library"
FINEST: dict[Precision, float] = {"double": 2.3e-13, "extended": 1e-24, "quad": 1e-32}
EPSILON = {"double": 2.2e-16, "extended": 1e-32, "quad": 1e-32}  # of what two doubles keep
ROUGH = 0.1  # rad or m: the error that the first step size of a method of fixed steps aims at
ROUNDING_BELOW = 1e-3  # an error above it may stop to fall for other reasons than rounding, such as chaos
IMPROVED = 0.7  # of the best error so far: a row above it is no improvement
MAX_WITHOUT_IMPROVEMENT = 2  # rows, after which rounding decides
SLOW = 0.5  # of the budget: what all timed runs of a row may take together


def count(method: Method, tolerances: tuple[float, ...] | None) -> int:
    """The largest number of settings of a method."""
    return STEP_SIZES if tolerances is None and not method.adaptive else len(adaptive_settings(method, tolerances))


def adaptive_settings(method: Method, tolerances: tuple[float, ...] | None) -> list[float]:
    """The tolerances of an adaptive method, from rough to accurate; none is below what its numbers resolve."""
    wanted = tolerances or (TAYLOR_TOLERANCES if method.kind == "taylor" else TOLERANCES)
    return sorted({max(t, smallest_tolerance(method)) for t in wanted}, reverse=True)


def why_not_here(method: Method) -> str | None:
    """Why a method cannot run here; None when it can."""
    if method.kind == "scipy":
        importlib.import_module("scipy.integrate")  # takes longer than most runs, and must not count as a run's time
        return None
    return NO_LIBRARY if method.kind == "taylor" and library() is None else None


@dataclass(frozen=True)
class ReferenceSolution:
    """A reference with its samples: q (n, nq) on its manifold, and `rest` (n, nq), its digits beyond a double.

    digits_error: its error without the rounding that a comparison on a curved manifold adds. precision: of its numbers.
    """

    about: Reference
    q: Array
    rest: Array
    digits_error: float
    precision: Precision

    def error_of(self, space: StateSpace, q: Array) -> float:
        """max over samples of |difference(q, reference)| for q (n, nq) on the manifold, rad or m."""
        if space.curved:
            return float(space.distance(q, self.q).max(initial=0.0))
        return float(np.abs((q - self.q) - self.rest).max(initial=0.0))


def first_reference(equations: Equations, times: Array) -> ReferenceSolution:
    """The quickest good reference at the samples `times` (n,). Raises AccuracyError where the motion cannot be solved.

    Without the native library it is SciPy's at its tightest tolerance; with events it is one that locates them.
    """
    if equations.has_events:
        return _in_doubles(equations, times, "dop853", "it locates events")
    if library() is None:
        return _in_doubles(equations, times, "scipy-dop853", NO_LIBRARY)
    return by_taylor(equations, times)


def by_taylor(equations: Equations, times: Array, precision: Precision = "extended") -> ReferenceSolution:
    """A reference by Taylor's method at the samples `times` (n,)."""
    how = f"Taylor's method in {precision} precision ({DIGITS[precision]})"
    return _verified(equations, times, MethodChoice(METHODS["taylor"], FINEST[precision], how, precision))


def _in_doubles(equations: Equations, times: Array, method: str, why: str) -> ReferenceSolution:
    how = f"{method} in double precision, as {why},"
    return _verified(equations, times, MethodChoice(METHODS[method], FINEST["double"], how))


def _verified(equations: Equations, times: Array, choice: MethodChoice) -> ReferenceSolution:
    """A solution, with its error by the solutions beside it, as that of every run."""
    start, space = time.perf_counter(), equations.space
    run = Verification(equations, times, np.arange(len(times)), 0.0)(choice)
    if run.truncation is None or run.rounding is None:  # Ctrl-C has cut it short: half a reference is of no use
        raise KeyboardInterrupt
    if not np.isfinite(run.solution.x).all():
        raise AccuracyError("the reference is not finite", where="reference", remedy="a shorter duration")
    if run.solution.t[-1] < times[-1]:
        raise AccuracyError(f"an event ends the motion at {run.solution.t[-1]:.6g} s", where="reference",
                            remedy="a shorter duration")  # fmt: skip
    q, rest = _parts(run.solution, space)
    # Two solutions may agree by chance, or be the start itself.
    error = digits_error = max(float((run.truncation + run.rounding).max()), EPSILON[choice.precision])
    if space.curved:
        q = space.rows(np.pad(q.T, ((0, space.nv), (0, 0))))[0]
        # The difference of two rotations is computed in doubles, and so is that of two places.
        error += 2.0 * float(np.finfo(float).eps * (1.0 + np.abs(q).max(initial=0.0)))
    text = f"{choice.why} at tolerance {choice.setting:.2g}, its error by a finer solution and disturbed ones"
    about = Reference(text, error, time.perf_counter() - start, tuple(q[-1].tolist()))
    return ReferenceSolution(about, q, rest, digits_error, choice.precision)


def _parts(solution: Solution, space: StateSpace) -> tuple[Array, Array]:
    """q (n, nq) as a sum of two doubles."""
    if solution.precise is None:
        q = space.rows(solution.x)[0]
        return q, np.zeros_like(q)
    return solution.precise[:, : space.nq, 0], solution.precise[:, : space.nq, 1]


@dataclass
class Measurement:
    """A method at a setting: its row, its q (n, nq) to compute the error from, and the seconds of its runs."""

    method: Method
    setting: float
    row: Row
    q: Array
    seconds: list[float]


@dataclass
class StudyRun:
    """The data common to all rows of a study, its measurements so far, and its failures."""

    equations: Equations
    times: Array
    reference: ReferenceSolution
    repeats: int
    budget: float
    done: list[Measurement] = field(default_factory=list)
    failures: list[MethodFailure] = field(default_factory=list)

    def fail(self, method: Method, setting: float | None, reason: str) -> None:
        """Add a failure."""
        tolerance, step = (setting, None) if method.adaptive else (None, setting)
        self.failures.append(MethodFailure(method.name, tolerance, step, reason))

    def measure(self, method: Method, setting: float) -> Row | None:
        """Add the row of a method at a setting; None when there is none. Raises OutOfTime, KeyboardInterrupt."""
        before = SPENT.seconds
        try:
            if method.kind not in ("taylor", "scipy"):
                step_map(self.equations, method)  # in no run's time
            first, first_seconds = self._run(method, setting, TimeLimit(self.budget))
        except OutOfTime:
            raise
        except AccuracyError as error:
            self.fail(method, setting, str(error))
            return None
        compiling = SPENT.seconds - before
        # A slow first run counts itself: warming up takes little in comparison.
        seconds = self._run(method, setting)[1] if first_seconds < SLOW * self.budget else first_seconds
        tolerance, step = (setting, None) if method.adaptive else (None, setting)
        q = self.equations.space.rows(first.x)[0]
        distance = self.reference.error_of(self.equations.space, q)
        row = Row(method.name, tolerance, step, distance, seconds, first.evaluations, first.steps, first.rejected,
                  compiling)  # fmt: skip
        self.done.append(Measurement(method, setting, row, q, [seconds]))
        return row

    def time_again(self, number: int) -> None:
        """Run each row once more, all in turns: what else the machine does only adds to them, and not to one row alone.

        number: which run it is, from 2. Rows whose runs are slow have fewer of them.
        """
        for entry in self.done:
            if entry.row.seconds * number < SLOW * self.budget:
                entry.seconds.append(self._run(entry.method, entry.setting)[1])
                entry.row = replace(entry.row, seconds=min(entry.seconds))

    def _run(self, method: Method, setting: float, limit: TimeLimit | None = None) -> tuple[Solution, float]:
        start = time.perf_counter()
        solution = solve(self.equations, method, self.times, setting, limit)
        if solution.interrupted:
            raise KeyboardInterrupt
        return solution, time.perf_counter() - start - solution.compile_seconds


class _Progression:
    """The rows of one method, and whether more of them pay."""

    def __init__(
        self, measurements: StudyRun, method: Method, to_the_end: bool, announce: Callable[[int, float], None]
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
    measurements: StudyRun, method: Method, tolerances: tuple[float, ...] | None, announce: Callable[[int, float], None]
) -> None:
    """Measure a method at its settings, rough ones first, until a run takes too long or rounding decides.

    tolerances: all of them, in place of our own; a method of fixed steps takes steps that aim at them. announce: called
    with the number of each row and its setting.
    """
    equations = measurements.equations
    reason = why_not_here(method)
    if reason is not None:
        measurements.fail(method, None, reason)
        return
    progression = _Progression(measurements, method, tolerances is not None, announce)
    longest = float(measurements.times[-1]) / 2
    if not method.adaptive and tolerances is None:
        _measure_step_sizes(progression, min(longest, first_setting(equations, method, ROUGH)), longest)
        return
    if method.adaptive:
        settings = adaptive_settings(method, tolerances)
    else:  # steps that aim at the tolerances, from rough to accurate
        settings = sorted({min(longest, first_setting(equations, method, t)) for t in tolerances or ()}, reverse=True)
    for setting in settings:
        progression.measure(setting)
        if progression.ended:
            return


def _measure_step_sizes(progression: _Progression, start: float, longest: float) -> None:
    """Longer steps from the start while the error is well below ROUGH, then shorter ones, a decade of error each."""
    factor, step = min(MAX_FACTOR, 10.0 ** (1 / progression.method.order)), start  # where it keeps its order
    row = progression.measure(step)
    while row is not None and row.error < ROUGH / 3 and step * factor <= longest:
        if progression.ended or progression.number >= STEP_SIZES // 2:
            break
        step *= factor
        row = progression.measure(step)
    for i in range(1, STEP_SIZES - progression.number + 1):
        if progression.ended:
            return
        progression.measure(start / factor**i)
