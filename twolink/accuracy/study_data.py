"""Measurements of an accuracy study: rows, failures, the reference and the Pareto front, as data, text and figure."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import TYPE_CHECKING, Any

import numpy as np

from twolink.errors import AccuracyError, ShowError
from twolink.show.figure import COLOURS, label_ends, new_figure, plain

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COARSEST, FINEST = 0.1, 1e-16  # rad or m: the first digit that has a price, and the last one of a double
BETTER = 100.0  # how many times better than a row the reference must be for the row's error to be known
UNITS = ((1.0, "s"), (1e-3, "ms"), (1e-6, "us"))


@dataclass(frozen=True)
class Row:
    """A method at a setting: its error [rad, m], the largest of q at any sample, and its seconds of wall clock.

    tolerance: of adaptive methods, else None. step: of methods with fixed steps [s], else None. seconds: the least of
    some runs after a first one, compiling not counted: what else the machine does only adds to it; compile_seconds:
    that, 0 where it was at hand. front: no other row is both more accurate and quicker. resolved: the reference is 100
    times better than this row, so that the error is known; where it is not, the error is at most `error` plus the
    reference's own.
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
    """The reference: its method in words, its own error [rad, m], its seconds, and q at its end (nq,)."""

    how: str
    error: float
    seconds: float
    q_end: tuple[float, ...]


@dataclass(frozen=True)
class StudyData:
    """The cost of each method's accuracy on a scene.

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
    unit : str
        Of errors: "rad", "m", or "rad or m".
    """

    robot: str
    duration: float
    samples: int
    rows: tuple[Row, ...]
    failures: tuple[MethodFailure, ...]
    reference: Reference
    seconds: float
    interrupted: bool = False
    unit: str = "rad or m"

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
        f"errors: the largest of q at any sample, {study.unit}, against\n  {about.how}\n"
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


BLUE, ORANGE, GREEN, PINK, SKY, RED, BLACK = COLOURS
STYLES = {
    "taylor": RED, "dop853": BLUE, "rk45": ORANGE, "rk23": SKY, "esdirk43": GREEN,
    "rk4": ORANGE, "suzuki4": PINK, "implicit-midpoint": GREEN, "midpoint": SKY, "semi-implicit-euler": BLACK,
    "scipy-rk45": ORANGE, "scipy-dop853": BLUE, "scipy-lsoda": BLACK, "scipy-radau": GREEN,
}  # fmt: skip
ADAPTIVE: dict[str, Any] = {"linestyle": "-", "marker": "o", "linewidth": 1.8}
FIXED: dict[str, Any] = {"linestyle": "--", "marker": "s", "linewidth": 1.2}
PEERS: dict[str, Any] = {"linestyle": ":", "marker": "^", "linewidth": 1.5}
MAX_ERROR = 3.0  # rad or m: an answer with a larger error says nothing
BEYOND = 200.0  # largest ratio of the best error to the end of the error axis
KINDS = {"steps by a tolerance": ADAPTIVE, "steps of one size": FIXED, "SciPy's": PEERS}
SMALL: dict[str, Any] = {"fontsize": 8, "va": "bottom", "color": "0.35"}
DOUBTFUL: dict[str, Any] = {"marker": "o", "linestyle": "none", "markerfacecolor": "white"}
Points = tuple[list[float], list[float]]


def plot_study(study: StudyData) -> Figure:
    """Draw seconds over error, both logarithmic, with accuracy growing to the right.

    Parameters
    ----------
    study : StudyData

    Returns
    -------
    Figure

    Raises
    ------
    ShowError
        No row has an error below 3.
    """
    rows = [row for row in study.rows if row.error <= MAX_ERROR]
    if not rows:
        what, remedy = f"no entry has an error below {MAX_ERROR:g}", "study a shorter duration"
        raise ShowError(what, where="plot", remedy=remedy, code="nothing-to-draw")
    figure, axes = new_figure(1, size=(11, 6.6))
    axis, floor = axes[0, 0], study.reference.error
    _set_axes(axis, *_points(rows, floor), floor, study.unit)
    front = [row for row in study.front if row.error <= MAX_ERROR]
    axis.plot(*_points(front, floor), color="0.82", linewidth=11, solid_capstyle="round", zorder=1)
    _write_prices(axis, study.price_of_digits())
    by_method = {name: [row for row in rows if row.method == name] for name in dict.fromkeys(r.method for r in rows)}
    for name, of_method in by_method.items():
        _draw_line(axis, name, of_method, floor)
    styles = [_style(of_method[0]) for of_method in by_method.values()]
    _write_legend(axis, [kind for kind, style in KINDS.items() if style in styles], all(r.resolved for r in rows))
    ended = ", interrupted" if study.interrupted else ""
    figure.suptitle(f"{plain(study.robot)}: what accuracy costs for {study.duration:g} s of motion{ended}")
    labels = {name: {"color": STYLES.get(name, "0.4"), "fontweight": "bold" if style is ADAPTIVE else "normal"}
              for name, style in zip(by_method, styles, strict=True)}  # fmt: skip
    label_ends(figure, axis, {name: _points(of_method, floor) for name, of_method in by_method.items()}, labels)
    return figure


def _points(rows: list[Row], floor: float) -> Points:
    return [max(row.error, floor) for row in rows], [row.seconds for row in rows]


def _set_axes(axis: Any, errors: list[float], seconds: list[float], floor: float, unit: str) -> None:
    """Limits, ticks and titles; errors that are within 100 times the reference's own are shaded."""
    from matplotlib.ticker import LogLocator

    best = min(errors)
    axis.set(xscale="log", yscale="log", ylim=(min(seconds) / 3.5, max(seconds) * 2),
             xlim=(max(errors) * 2, max(min(best, BETTER * floor) / 4, best / BEYOND)),
             xlabel=f"error of q, the largest at any sample ({unit}): more accurate to the right",
             ylabel="time to solve, compiling not counted")  # fmt: skip
    axis.xaxis.set_major_locator(LogLocator(base=10, numticks=30))
    axis.yaxis.set_major_formatter(lambda y, _: in_words(y).replace("us", "µs"))
    axis.minorticks_off()
    start, end = BETTER * floor, axis.get_xlim()[1]
    if start > end:
        axis.axvspan(start, end, color="0.93", zorder=0, linewidth=0)
        axis.text(np.sqrt(start * end), 0.3, f"the reference itself is good to {floor:.0e}", fontsize=8, color="0.45",
                  va="center", ha="center", rotation=90, transform=axis.get_xaxis_transform())  # fmt: skip


def _write_prices(axis: Any, prices: tuple[Price, ...]) -> None:
    """Under the front at each decade: the fewest seconds, and between two decades the factor from one to the other."""
    left, right = axis.get_xlim()
    at_error = {**SMALL, "transform": axis.get_xaxis_transform(), "ha": "center"}
    for height, words in ((0.05, "least time"), (0.012, "a digit more")):
        axis.text(1.006, height, words, transform=axis.transAxes, **SMALL)
    for before, price in zip((None, *prices), prices, strict=False):
        if not right <= price.accuracy <= left:
            continue
        if before is not None and price.ratio is not None:
            dearer, middle = price.ratio > 1.005, np.sqrt(before.accuracy * price.accuracy)
            look = {"fontweight": "bold", "color": "0.15"} if dearer else {"color": "0.55"}
            axis.text(middle, 0.012, f"×{price.ratio:.2f}" if dearer else "=", **{**at_error, **look})
        box = {"facecolor": "white", "pad": 0.5, "edgecolor": "none"}
        seconds = in_words(float(f"{price.seconds:.2g}")).replace("us", "µs")
        axis.text(price.accuracy, 0.05, seconds, bbox=box, **at_error)


def _draw_line(axis: Any, name: str, rows: list[Row], floor: float) -> None:
    """A method's line; rows whose error is not resolved have white markers."""
    x, y = _points(rows, floor)
    colour, style = STYLES.get(name, "0.4"), _style(rows[0])
    axis.plot(x, y, color=colour, alpha=0.9, zorder=3, **{**style, "marker": None})
    faces = [colour if row.resolved else "white" for row in rows]
    axis.scatter(x, y, s=17.6, marker=style["marker"], facecolors=faces, edgecolors=colour, zorder=4)


def _style(row: Row) -> dict[str, Any]:
    return PEERS if row.method.startswith("scipy") else FIXED if row.step is not None else ADAPTIVE


def _write_legend(axis: Any, kinds: list[str], resolved: bool) -> None:
    from matplotlib.lines import Line2D

    looks = {kind: KINDS[kind] for kind in kinds}
    if not resolved:
        looks["within 100 times the reference's error"] = DOUBTFUL
    handles = [Line2D([], [], color="0.3", markersize=4, label=label, **look) for label, look in looks.items()]
    handles.append(Line2D([], [], color="0.82", linewidth=9, label="the front: nothing is both better and quicker"))
    axis.legend(handles=handles, loc="lower left", bbox_to_anchor=(0, 1.0), ncols=len(handles), fontsize=8.5,
                frameon=False, columnspacing=1.5)  # fmt: skip
