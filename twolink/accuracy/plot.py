"""The figure of an accuracy study: what each method's accuracy costs, the front, and the price of each digit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from twolink.accuracy.study_data import BETTER, Price, Reference, Row, StudyData
from twolink.errors import ShowError
from twolink.show.direct_labels import label_ends
from twolink.show.figure import COLOURS, new_figure, plain, save_figure

BLUE, ORANGE, GREEN, PINK, SKY, RED, BLACK = COLOURS
STYLES = {
    "taylor": RED, "dop853": BLUE, "rk45": ORANGE, "rk23": SKY, "esdirk43": GREEN,
    "rk4": ORANGE, "suzuki4": PINK, "implicit-midpoint": GREEN, "midpoint": SKY, "semi-implicit-euler": BLACK,
    "scipy-rk45": ORANGE, "scipy-dop853": BLUE, "scipy-lsoda": BLACK, "scipy-radau": GREEN,
}  # fmt: skip
ADAPTIVE: dict[str, Any] = {"linestyle": "-", "marker": "o", "linewidth": 1.8}
FIXED: dict[str, Any] = {"linestyle": "--", "marker": "s", "linewidth": 1.2}
PEERS: dict[str, Any] = {"linestyle": ":", "marker": "^", "linewidth": 1.5}
WORST = 3.0  # rad or m: beyond it an answer tells nothing
BEYOND = 200.0  # how far the figure goes beyond the best entry, at most


def plot_study(study: StudyData, path: Path) -> Path:
    """Seconds over error, both logarithmic, accuracy growing to the right. Raises ShowError when there is nothing."""
    rows = [row for row in study.rows if row.error <= WORST]
    if not rows:
        remedy = "study a shorter duration"
        raise ShowError(f"no entry has an error below {WORST:g}", where=str(path), remedy=remedy)
    figure, axes = new_figure(1, size=(11, 6.6))
    axis = axes[0, 0]
    axis.set(xscale="log", yscale="log")
    floor = study.reference.error
    _set_limits(axis, rows, floor)
    _shade(axis, study.reference)
    front = [row for row in study.front if row.error <= WORST]
    axis.plot(*_points(front, floor), color="0.82", linewidth=11, solid_capstyle="round", zorder=1)
    _write_prices(axis, study.price_of_digits())
    lines = {name: [row for row in rows if row.method == name] for name in dict.fromkeys(row.method for row in rows)}
    for name, own in lines.items():
        _draw_line(axis, name, own, floor)
    _explain(axis, figure, study)
    styles = {name: _label_style(name, own[0]) for name, own in lines.items()}
    label_ends(figure, axis, {name: _points(own, floor) for name, own in lines.items()}, styles)
    return save_figure(figure, path)


def _points(rows: list[Row], floor: float) -> tuple[list[float], list[float]]:
    return [max(row.error, floor) for row in rows], [row.seconds for row in rows]


def _set_limits(axis: Any, rows: list[Row], floor: float) -> None:
    errors, seconds = _points(rows, floor)
    best = min(errors)
    axis.set_xlim(max(errors) * 2, max(min(best, BETTER * floor) / 4, best / BEYOND))
    axis.set_ylim(min(seconds) / 3.5, max(seconds) * 2)
    axis.xaxis.set_major_locator(_decades())
    axis.yaxis.set_major_formatter(lambda y, _: _seconds(y))
    axis.minorticks_off()


def _decades() -> Any:
    from matplotlib.ticker import LogLocator

    return LogLocator(base=10, numticks=30)


def _seconds(value: float) -> str:
    size, unit = next(((s, u) for s, u in ((1.0, "s"), (1e-3, "ms")) if value >= 0.9995 * s), (1e-6, "µs"))
    return f"{value / size:.3g} {unit}"


def _shade(axis: Any, reference: Reference) -> None:
    """Where the reference is not 100 times better, errors are not known."""
    start, end = BETTER * reference.error, axis.get_xlim()[1]
    if start <= end:
        return
    axis.axvspan(start, end, color="0.93", zorder=0, linewidth=0)
    axis.text(
        np.sqrt(start * end),
        0.3,
        f"the reference itself is good to {reference.error:.0e}",
        fontsize=8,
        color="0.45",
        va="center",
        ha="center",
        rotation=90,
        transform=axis.get_xaxis_transform(),
    )


def _write_prices(axis: Any, prices: tuple[Price, ...]) -> None:
    """Under the front at each decade: the least seconds, and between two decades what the second one costs."""
    left, right = axis.get_xlim()
    for height, words in ((0.05, "least time"), (0.012, "a digit more")):
        axis.text(1.006, height, words, transform=axis.transAxes, fontsize=8, color="0.35", va="bottom")
    for before, price in zip((None, *prices), prices, strict=False):
        if not right <= price.accuracy <= left:
            continue
        if before is not None and price.ratio is not None:
            middle = np.sqrt(before.accuracy * price.accuracy)
            dear = price.ratio > 1.005
            axis.text(middle, 0.012, f"×{price.ratio:.2f}" if dear else "=", transform=axis.get_xaxis_transform(),
                      ha="center", va="bottom", fontsize=8, fontweight="bold" if dear else "normal",
                      color="0.15" if dear else "0.55")  # fmt: skip
        axis.text(price.accuracy, 0.05, _seconds(float(f"{price.seconds:.2g}")), ha="center", va="bottom", fontsize=7.5,
                  color="0.35", transform=axis.get_xaxis_transform(), bbox={"facecolor": "white", "pad": 0.5,
                  "edgecolor": "none"})  # fmt: skip


def _draw_line(axis: Any, name: str, rows: list[Row], floor: float) -> None:
    x, y = _points(rows, floor)
    colour, style = STYLES.get(name, "0.4"), _style(name, rows[0])
    line = axis.plot(x, y, color=colour, markersize=0, **{**style, "marker": None}, zorder=3)[0]
    line.set_alpha(0.9)
    for known in (True, False):
        chosen = [i for i, row in enumerate(rows) if row.resolved is known]
        face = colour if known else "white"
        look = {"marker": style["marker"], "markersize": 4.2, "markerfacecolor": face, "markeredgecolor": colour}
        axis.plot([x[i] for i in chosen], [y[i] for i in chosen], linestyle="none", zorder=4, **look)


def _style(name: str, row: Row) -> dict[str, Any]:
    return PEERS if name.startswith("scipy") else FIXED if row.step is not None else ADAPTIVE


def _label_style(name: str, row: Row) -> dict[str, Any]:
    weight = "bold" if _style(name, row) is ADAPTIVE else "normal"
    return {"color": STYLES.get(name, "0.4"), "fontweight": weight}


def _explain(axis: Any, figure: Any, study: StudyData) -> None:
    from matplotlib.lines import Line2D

    def kind(label: str, style: dict[str, Any]) -> Any:
        return Line2D([], [], color="0.3", markersize=4, label=label, **style)

    handles = [kind("steps by a tolerance", ADAPTIVE), kind("steps of one size", FIXED), kind("SciPy's", PEERS)]
    handles.append(Line2D([], [], color="0.82", linewidth=9, label="the front: nothing is both better and quicker"))
    if not all(row.resolved for row in study.rows):
        doubt = {"marker": "o", "linestyle": "none", "markerfacecolor": "white"}
        handles.append(kind("within 100 times the reference's error", doubt))
    axis.legend(
        handles=handles,
        loc="lower left",
        bbox_to_anchor=(0, 1.0),
        ncols=len(handles),
        fontsize=8.5,
        frameon=False,
        columnspacing=1.5,
    )
    axis.set_xlabel("error of q, the largest at any sample (rad, m): more accurate to the right")
    axis.set_ylabel("time to solve, compiling not counted")
    ended = ", interrupted" if study.interrupted else ""
    figure.suptitle(f"{plain(study.robot)}: what accuracy costs for {study.duration:g} s of motion{ended}")
