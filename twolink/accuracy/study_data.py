"""What an accuracy study measured, as frozen data and as text: rows, failures, the reference and the Pareto front."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby

from twolink.errors import AccuracyError

COARSEST, FINEST = 0.1, 1e-16  # rad or m: the first digit that has a price, and the last one of a double
BETTER = 100.0  # how many times better than a row the reference must be for the row's error to be known
UNITS = ((1.0, "s"), (1e-3, "ms"), (1e-6, "us"))


@dataclass(frozen=True)
class Row:
    """A method at a setting: its error [rad, m], the largest of q at any sample, and its seconds of wall clock.

    tolerance: of adaptive methods, else None. step: of methods with fixed steps [s], else None. seconds: the median of
    some runs after a first one, compiling not counted; compile_seconds: that, 0 where it was at hand. front: no other
    row is both more accurate and quicker. resolved: the reference is 100 times better than this row, so that the error
    is known; where it is not, the error is at most `error` plus the reference's own.
    """

    method: str
    tolerance: float | None
    step: float | None
    error: float
    seconds: float
    evaluations: int
    steps: int
    rejected: int = 0
    compile_seconds: float = 0.0
    front: bool = False
    resolved: bool = True

    @property
    def setting(self) -> str:
        """The tolerance or the step, as text."""
        return f"tolerance {self.tolerance:.2g}" if self.step is None else f"step {self.step:.3g} s"


@dataclass(frozen=True)
class MethodFailure:
    """A method, at a setting or altogether (both None), that gave no row, and why."""

    method: str
    tolerance: float | None
    step: float | None
    reason: str


@dataclass(frozen=True)
class Price:
    """The cheapest row with an error of at most `accuracy` [rad, m]: its seconds, and those over the decade before."""

    accuracy: float
    seconds: float
    ratio: float | None
    row: Row


@dataclass(frozen=True)
class Reference:
    """How the reference was computed, its own error [rad, m], its seconds, and q at its end (nq,)."""

    how: str
    error: float
    seconds: float
    q_end: tuple[float, ...]


@dataclass(frozen=True)
class StudyData:
    """What each method's accuracy costs on a scene.

    Parameters
    ----------
    robot : str
        The robot's name.
    duration : float
        Simulated time, s.
    samples : int
        Number of times at which errors were taken.
    rows : tuple of Row
        By method, from rough to accurate.
    failures : tuple of MethodFailure
        Settings and methods without a row, and why.
    reference : Reference
        What the errors were measured against.
    seconds : float
        Of the whole study.
    interrupted : bool
        Ctrl-C ended it early.
    """

    robot: str
    duration: float
    samples: int
    rows: tuple[Row, ...]
    failures: tuple[MethodFailure, ...]
    reference: Reference
    seconds: float
    interrupted: bool = False

    @property
    def front(self) -> tuple[Row, ...]:
        """The Pareto front: rows that no other beats in both error and seconds, from rough to accurate."""
        return tuple(sorted((row for row in self.rows if row.front), key=lambda row: -row.error))

    def cheapest(self, accuracy: float) -> Row:
        """The row with the fewest seconds among those with an error of at most `accuracy` [rad, m].

        The reference's own error counts as the row's. Raises AccuracyError with the best that was reached.
        """
        good = [row for row in self.rows if row.error + self.reference.error <= accuracy]
        if good:
            return min(good, key=lambda row: row.seconds)
        best = min(self.rows, key=lambda row: row.error, default=None)
        if best is None:
            why = self.failures[0].reason if self.failures else "it was interrupted"
            raise AccuracyError(f"the study has no rows: {why}", where="accuracy", remedy="a larger budget= or others")
        raise AccuracyError(
            f"nothing reached {accuracy:g}: the best was {best.error:.1e} by {best.method}, {best.setting}",
            where="accuracy",
            remedy="ask for less, or simulate with precision='quad'",
        )

    def price_of_digits(self) -> tuple[Price, ...]:
        """For each decade of accuracy that was reached, 0.1 and better: the fewest seconds, and what that is as a
        multiple of the decade before."""
        prices: list[Price] = []
        best = min((row.error + self.reference.error for row in self.rows), default=math.inf)
        accuracy = COARSEST
        while best <= accuracy and accuracy >= FINEST:
            row = self.cheapest(accuracy)
            prices.append(Price(accuracy, row.seconds, row.seconds / prices[-1].seconds if prices else None, row))
            accuracy = float(f"1e{round(math.log10(accuracy)) - 1}")
        return tuple(prices)


def with_front(rows: Sequence[Row], reference: Reference) -> tuple[Row, ...]:
    """The rows, each with whether it is on the Pareto front and whether its error is resolved."""
    bounds = [row.error + reference.error for row in rows]
    order = sorted(range(len(rows)), key=lambda i: (rows[i].seconds, bounds[i]))
    best, front = math.inf, set()
    for i in order:
        if bounds[i] < best:
            best = bounds[i]
            front.add(i)
    return tuple(
        replace(row, front=i in front, resolved=row.error >= BETTER * reference.error) for i, row in enumerate(rows)
    )


def in_words(seconds: float) -> str:
    """Seconds in three digits with a unit, such as 12.3 ms."""
    size, unit = next(((size, unit) for size, unit in UNITS if seconds >= size * 0.9995), UNITS[-1])
    return f"{seconds / size:.3g} {unit}"


def study_text(study: StudyData) -> str:
    """The whole study."""
    parts = [_head(study), _rows(study), _prices(study), _failures(study)]
    return "\n\n".join(part for part in parts if part)


def _head(study: StudyData) -> str:
    about = study.reference
    ended = "; INTERRUPTED, this is what was done" if study.interrupted else ""
    return (
        f"{study.robot}: {study.duration:g} s, {study.samples} samples; {len(study.rows)} entries "
        f"in {study.seconds:.0f} s{ended}\n"
        f"errors: the largest of q at any sample, rad or m, against\n  {about.how}\n"
        f"  its own error is {about.error:.1e}; it took {in_words(about.seconds)}"
    )


def _rows(study: StudyData) -> str:
    lines = [f"{'method':<20}{'setting':<20}{'error':>9} {'time':>11}{'evaluations':>13}{'steps':>9}{'rejected':>10}"]
    for row in study.rows:
        mark = " *" if row.front else ""
        doubt = "" if row.resolved else "  (within the reference's own error)"
        lines.append(
            f"{row.method:<20}{row.setting:<20}{row.error:>9.1e} {in_words(row.seconds):>11}{row.evaluations:>13}"
            f"{row.steps:>9}{row.rejected:>10}{mark}{doubt}"
        )
    compiled = sum(row.compile_seconds for row in study.rows)
    lines.append(f"* on the front: nothing else is both more accurate and quicker. Compiling, apart: {compiled:.1f} s.")
    return "\n".join(lines) if study.rows else ""


def _prices(study: StudyData) -> str:
    prices = study.price_of_digits()
    if not prices:
        return "no entry has an error of 0.1 or less: study a shorter duration, or with a larger budget"
    lines = ["what accuracy costs: the cheapest for each", f"{'error at most':>14}{'time':>11}{'a digit more':>14}  by"]
    for price in prices:
        more = "" if price.ratio is None else "the same" if price.ratio == 1.0 else f"x {price.ratio:.2f}"
        by = f"{price.row.method}, {price.row.setting}"
        lines.append(f"{price.accuracy:>14.0e}{in_words(price.seconds):>11}{more:>14}  {by}")
    return "\n".join(lines)


def _failures(study: StudyData) -> str:
    if not study.failures:
        return ""
    lines = ["no row from"]
    for (method, reason), group in groupby(study.failures, key=lambda f: (f.method, f.reason)):
        lines.append(f"  {method}{', '.join(_settings(group))}: {reason}")
    return "\n".join(lines)


def _settings(failures: Iterator[MethodFailure]) -> Iterator[str]:
    for failure in failures:
        if failure.tolerance is not None:
            yield f" at tolerance {failure.tolerance:.2g}"
        elif failure.step is not None:
            yield f" at step {failure.step:.3g} s"
