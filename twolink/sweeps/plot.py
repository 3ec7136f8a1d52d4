"""Figures of a sweep: curves with error bars over one quantity, a heat map over two; runs without a result marked."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from twolink.errors import ShowError
from twolink.show.figure import COLOURS, new_figure, plain, save_figure
from twolink.sweeps.outputs import ABANDONED, DONE, FAILED, INACCURATE, PENDING
from twolink.sweeps.results import column, column_names, run_dims, turns_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WITHOUT = {FAILED: "failed", ABANDONED: "given up", PENDING: "not computed"}
GREY = "0.55"
RARE = 1.0  # %: of the values at each end that have no colours of their own where they take half of the range


def plot_sweep(
    data: Any, path: str | os.PathLike[str] | None = None, variable: str = "", *, turns: bool = False
) -> Path | Figure:  # fmt: skip
    """Draw a number of every run over one or two quantities.

    Parameters
    ----------
    data : xarray.Dataset
        From `sweep` or `open_sweep`; of more than two quantities, a selection (`data.sel(...)`).
    path : path-like, optional
        A .png, .svg or .pdf file.
    variable : str
        "end.q.JOINT", "end.v.JOINT" or a variable of the sweep; by default the first one.
    turns : bool
        Draw whole turns of the angle, and leave out those that the error bar does not decide.

    Returns
    -------
    Path or matplotlib.figure.Figure
        The path; without one the figure, which notebooks show.

    Raises
    ------
    ShowError
        More than two quantities vary, or the file cannot be written.
    SceneError
        There is no such variable.
    """
    name = variable or next(n for n in column_names(data) if data.get(n) is None or data[n].dtype.kind == "f")
    values = np.asarray(column(data, name).values, dtype=float)
    status, bar = data["status"].values, data["error"].values
    shown = np.isfinite(values) & np.isin(status, (DONE, INACCURATE))
    label = _label(data, name)
    if turns:
        values, sure = turns_of(data, name)
        shown, label = shown & sure, f"{name.partition('.')[2].partition('.')[2]}, turns"
    axes = _axes(data)
    if len(axes) == 1:
        bars = bar if name.startswith("end.q.") and not turns else None
        figure = _curve(axes, values, bars, shown, status, label)
    else:
        figure = _map(axes, values, shown, status, label)
    return figure if path is None else save_figure(figure, Path(path))


def _label(data: Any, name: str) -> str:
    units = (data[name] if name in data else column(data, name)).attrs.get("units", "")
    return plain(f"{name}, {units}" if units else name)


def _axes(data: Any) -> list[tuple[str, np.ndarray]]:
    """What the runs are drawn over: names with units, and values (n,), of one or two quantities that differ."""
    dims = run_dims(data)
    names = list(dims) if dims != ("run",) else [str(n) for n in data.coords if data[n].dims == dims and n != "run"]
    varied = [name for name in names if data[name].size > 1] or names[:1]
    if len(varied) > 2:
        raise ShowError(f"{len(varied)} quantities vary: {', '.join(varied)}", argument="data",
                        remedy="select values of the others: data.sel(...)")  # fmt: skip
    return [(plain(f"{n}, {data[n].attrs.get('units', '')}".rstrip(", ")), data[n].values) for n in varied]


def _curve(
    axes: list[tuple[str, np.ndarray]], values: np.ndarray, bars: np.ndarray | None, shown: np.ndarray,
    status: np.ndarray, label: str,
) -> Figure:  # fmt: skip
    ((name, x),) = axes
    figure, ((axis,),) = new_figure(1, size=(7.0, 4.2))
    x = _positions(axis.xaxis, x.ravel())
    order = np.argsort(x, kind="stable")
    x, y, here = x[order], values.ravel()[order], shown.ravel()[order]
    error = None if bars is None else bars.ravel()[order][here]
    axis.errorbar(x[here], y[here], yerr=error, color=COLOURS[0], marker=".", markersize=3, linewidth=1.0, capsize=2)
    missing = status.ravel()[order]
    for code, (number, text) in enumerate(WITHOUT.items()):
        some = ~here & (missing == number)
        if some.any():
            axis.plot(x[some], np.full(some.sum(), 0.02 + 0.03 * code), "x", transform=axis.get_xaxis_transform(),
                      color=COLOURS[5], label=text)  # fmt: skip
    if axis.get_legend_handles_labels()[0]:
        axis.legend(frameon=False)
    axis.set(xlabel=name, ylabel=label)
    if _scale(x) == "log":  # to set "linear" again would take the names from the ticks
        axis.set_xscale("log")
    return figure


def _positions(axis: Any, x: np.ndarray) -> np.ndarray:
    """Values as positions on an axis: names are numbered, and written beside their ticks."""
    if x.dtype.kind in "fiub":
        return x.astype(float)
    axis.set_ticks(np.arange(len(x)), [plain(str(name)) for name in x], fontsize=6)
    return np.arange(len(x), dtype=float)


def _scale(x: np.ndarray) -> str:
    """Logarithmic where positive values span two decades, as accuracies do."""
    return "log" if x.min() > 0.0 and x.max() >= 100.0 * x.min() else "linear"


def _edges(x: np.ndarray) -> np.ndarray:
    """The edges (n + 1,) of cells round increasing values (n,): half way, in ratios on a logarithmic axis."""
    if len(x) == 1:
        return np.array([x[0] - 0.5, x[0] + 0.5])
    at = np.log(x) if _scale(x) == "log" else x
    middle = (at[1:] + at[:-1]) / 2
    edges = np.concatenate([[2 * at[0] - middle[0]], middle, [2 * at[-1] - middle[-1]]])
    return np.asarray(np.exp(edges) if _scale(x) == "log" else edges)


def _colours(values: np.ndarray) -> tuple[float, float, str]:
    """The values of the first and the last colour, and how the colour bar shows that there are values beyond."""
    finite = values[np.isfinite(values)]
    if not finite.size:
        return 0.0, 1.0, "neither"
    least, low, high, most = np.percentile(finite, (0.0, RARE, 100.0 - RARE, 100.0))
    if low == high or high - low > (most - least) / 2:
        return float(least), float(most), "neither"
    return float(low), float(high), "both"


def _map(
    axes: list[tuple[str, np.ndarray]], values: np.ndarray, shown: np.ndarray, status: np.ndarray,
    label: str,
) -> Figure:  # fmt: skip
    (down, y), (across, x) = axes
    figure, ((axis,),) = new_figure(1, size=(7.4, max(6.0, 0.14 * len(y) if y.dtype.kind in "OU" else 0.0)))
    kept = np.where(shown, values, np.nan)
    low, high, beyond = _colours(kept)
    limits = {"vmin": low, "vmax": high}
    if values.squeeze().ndim == 2:
        x, y = _positions(axis.xaxis, x), _positions(axis.yaxis, y)
        order = np.ix_(np.argsort(y), np.argsort(x))
        kept, status = kept.reshape(len(y), len(x))[order], status.reshape(len(y), len(x))[order]
        x, y = np.sort(x), np.sort(y)
        axis.set_facecolor(GREY)
        norm = _scale(kept[np.isfinite(kept)]) if np.isfinite(kept).any() else None
        if norm == "log":
            limits, beyond = {}, "neither"
        image = axis.pcolormesh(_edges(x), _edges(y), kept, rasterized=True, norm=norm, **limits)
        rows, columns = np.nonzero(np.isin(status, (FAILED, ABANDONED)))
        axis.plot(x[columns], y[rows], "x", color=COLOURS[5], markersize=3)
    else:
        failed = ~shown.ravel()
        image = axis.scatter(x[~failed], y[~failed], c=kept.ravel()[~failed], s=8, **limits)
        axis.plot(x[failed], y[failed], "x", color=COLOURS[5], markersize=3)
    figure.colorbar(image, ax=axis, label=label, extend=beyond)
    axis.grid(False)
    share = float((~shown).mean())
    note = f"; grey: {share:.1%} without a number that can be trusted" if share else ""
    axis.set(xlabel=across, ylabel=down)
    for values_of, set_scale in ((x, axis.set_xscale), (y, axis.set_yscale)):
        if _scale(values_of) == "log":
            set_scale("log")
    axis.set_title(f"{shown.size:,} runs{note}", fontsize=9)
    return figure
