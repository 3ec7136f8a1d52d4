"""The figure of an accuracy study: what each method's accuracy costs, the front, and the price of each digit."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from twolink.accuracy.study_data import BETTER, Price, Row, StudyData, in_words
from twolink.errors import ShowError
from twolink.show.figure import COLOURS, label_ends, new_figure, plain, save_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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


def plot_study(study: StudyData, path: Path | None) -> Path | Figure:
    """Draw seconds over error, both logarithmic, with accuracy growing to the right.

    Parameters
    ----------
    study : StudyData
    path : Path or None
        A .png, .svg or .pdf file; None to keep the figure.

    Returns
    -------
    Path or Figure
        The path, or the figure.

    Raises
    ------
    ShowError
        No row has an error below 3.
    """
    rows = [row for row in study.rows if row.error <= MAX_ERROR]
    if not rows:
        what, remedy = f"no entry has an error below {MAX_ERROR:g}", "study a shorter duration"
        raise ShowError(what, where="plot" if path is None else str(path), remedy=remedy, code="nothing-to-draw")
    figure, axes = new_figure(1, size=(11, 6.6))
    axis, floor = axes[0, 0], study.reference.error
    _set_axes(axis, *_points(rows, floor), floor)
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
    return figure if path is None else save_figure(figure, path)


def _points(rows: list[Row], floor: float) -> Points:
    return [max(row.error, floor) for row in rows], [row.seconds for row in rows]


def _set_axes(axis: Any, errors: list[float], seconds: list[float], floor: float) -> None:
    """Limits, ticks and titles; errors that are within 100 times the reference's own are shaded."""
    from matplotlib.ticker import LogLocator

    best = min(errors)
    axis.set(xscale="log", yscale="log", ylim=(min(seconds) / 3.5, max(seconds) * 2),
             xlim=(max(errors) * 2, max(min(best, BETTER * floor) / 4, best / BEYOND)),
             xlabel="error of q, the largest at any sample (rad, m): more accurate to the right",
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
