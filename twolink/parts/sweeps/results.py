"""The results of a sweep: how far it is, also while another process computes it, its runs as a table, and figures."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from twolink.errors import SceneError, ShowError, require_known
from twolink.io.files import path_to_write, write_atomic
from twolink.io.tables import require_format
from twolink.parts.sweeps.outputs import ABANDONED, DONE, FAILED, INACCURATE, PENDING, STATUS
from twolink.parts.sweeps.store import read_record
from twolink.show.figure import COLOURS, new_figure, plain, save_figure
from twolink.simulation.text import BaseResult

if TYPE_CHECKING:
    from matplotlib.figure import Figure

RECENT = 20  # blocks, from whose times the rate is told


@dataclass(frozen=True, repr=False)
class SweepStatus(BaseResult):
    """The runs of a sweep by their status.

    total; pending, done, inaccurate, failed, abandoned: numbers of runs. rate, 1/s: of the last blocks; seconds_left:
    at that rate; None where that cannot be told, or nothing is left.
    """

    total: int
    pending: int
    done: int
    inaccurate: int
    failed: int
    abandoned: int
    rate: float | None
    seconds_left: float | None

    def __repr__(self) -> str:
        finished = self.total - self.pending
        parts = [f"{finished:,} of {self.total:,} runs finished ({finished / self.total:.1%})"]
        parts += [f"{n:,} {name}" for name in ("inaccurate", "failed", "abandoned") if (n := getattr(self, name))]
        if self.rate is not None and self.seconds_left is not None:
            parts.append(f"{self.rate:.4g} runs/s, {self.seconds_left:.0f} s left at that rate")
        return "; ".join(parts)


def sweep_status(path: str | os.PathLike[str]) -> SweepStatus:
    """The progress of a sweep.

    Parameters
    ----------
    path : path-like
        Its store.

    Raises
    ------
    SceneError
        It is no store of a sweep; code "no-sweep".
    """
    array = read_record(Path(path))[0]["status"]
    counts, times = np.zeros(len(STATUS), dtype=int), []
    for file in sorted((Path(path) / "status" / "c").rglob("*")):
        if not file.is_file() or file.name.endswith(".partial"):
            continue
        index = tuple(int(part) for part in file.relative_to(Path(path) / "status" / "c").parts)
        numbers = np.bincount(np.asarray(array.blocks[index]).ravel(), minlength=len(STATUS))
        counts += numbers
        times.append((file.stat().st_mtime, int(numbers[1:].sum())))
    counts[0] = array.size - counts[1:].sum()
    recent = sorted(times)[-RECENT:]
    elapsed = recent[-1][0] - recent[0][0] if len(recent) > 1 else 0.0
    rate = sum(n for _, n in recent[1:]) / elapsed if elapsed > 0.0 and counts[0] else None
    by_name = {name: int(n) for name, n in zip(STATUS, counts, strict=True)}
    return SweepStatus(array.size, rate=rate, seconds_left=counts[0] / rate if rate else None, **by_name)


SUFFIXES = (".csv", ".parquet")
END = {"q": "q_name", "v": "v_name"}


def run_dims(data: Any) -> tuple[str, ...]:
    """The dimensions of the runs."""
    return tuple(str(name) for name in data["status"].dims)


def column_names(data: Any) -> list[str]:
    """The names of the numbers and texts that every run has: variables, and end.q.JOINT and end.v.JOINT."""
    dims = run_dims(data)
    names = [str(name) for name in data.data_vars if data[name].dims == dims]
    ends = [f"end.{letter}.{joint}" for letter, own in END.items() if letter in data for joint in data[own].values]
    return [*ends, *names]


def column(data: Any, name: str) -> Any:
    """A number or text of every run, as an xarray.DataArray.

    Parameters
    ----------
    data : xarray.Dataset
    name : str
        A variable such as "energy", or "end.q.JOINT" or "end.v.JOINT".

    Raises
    ------
    SceneError
        There is none of this name.
    """
    require_known(name, column_names(data), SceneError, "the sweep has no {!r}", argument="variable")
    if name.startswith("end."):
        _, letter, joint = name.split(".", 2)
        return data[letter].sel({END[letter]: joint}, drop=True)
    return data[name]


def sweep_frame(data: Any) -> Any:
    """A sweep as a pandas.DataFrame: a row a run, with what varies, then the columns of `column_names`."""
    import pandas as pd

    dims = run_dims(data)
    rows = {str(name): data[name].broadcast_like(data["status"]).transpose(*dims).values.ravel()
            for name in data.coords if set(data[name].dims) <= set(dims)}  # fmt: skip
    return pd.DataFrame(rows | {name: column(data, name).values.ravel() for name in column_names(data)})


def write_sweep_table(data: Any, path: str | os.PathLike[str]) -> Path:
    """Write a row for each run into a .csv or .parquet file. Samples stay in the store. Returns the path.

    Raises
    ------
    SceneError
        The path ends otherwise.
    TwolinkError
        The file cannot be written (code "not-writable").
    """
    suffix = require_format(path_to_write(path), SUFFIXES, SceneError)
    frame = sweep_frame(data)

    def write(file: BinaryIO) -> None:
        if suffix == ".csv":
            frame.to_csv(file, index=False, lineterminator="\n")
        else:
            frame.to_parquet(file, index=False)

    return write_atomic(Path(path), write)


def turns_of(data: Any, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Whole turns of a joint at the end, and whether each can be trusted.

    A turn number round(q / 2 pi) is certain where the error bar does not reach the next half turn.
    """
    angle, bar = column(data, name).values, data["error"].values
    turns = np.round(angle / (2.0 * np.pi))
    room = np.pi - np.abs(angle - 2.0 * np.pi * turns)
    with np.errstate(invalid="ignore"):
        return turns, np.isfinite(turns) & (bar < room)


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
        None or more than two quantities vary, or the file cannot be written.
    SceneError
        There is no such variable.
    """
    numbers = [each for each in column_names(data) if column(data, each).dtype.kind in "fiu"]
    lengths = json.loads(data["q_name"].attrs.get("lengths", "[]")) if "q_name" in data else []
    angles = [each for each in numbers if each.startswith("end.q.") and each.replace(".q.", ".v.", 1) in numbers
              and each.removeprefix("end.q.") not in lengths]  # fmt: skip
    name = variable or next(each for each in numbers if column(data, each).dtype.kind == "f")
    what = "{!r} is no angle, which has turns" if turns else "the sweep has no number {!r}"
    require_known(name, angles if turns else numbers, SceneError, what, argument="variable")
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
    return figure if path is None else save_figure(figure, path_to_write(path))


def _label(data: Any, name: str) -> str:
    units = (data[name] if name in data else column(data, name)).attrs.get("units", "")
    return plain(f"{name}, {units}" if units else name)


def _axes(data: Any) -> list[tuple[str, np.ndarray]]:
    """The axes of a drawing of runs: names with units, and values (n,), of one or two quantities that differ."""
    dims = run_dims(data)
    names = list(dims) if dims != ("run",) else [str(n) for n in data.coords if data[n].dims == dims and n != "run"]
    varied = [name for name in names if data[name].size > 1] or names[:1]
    if not varied:
        raise ShowError("it is one run, in which nothing varies", argument="data", remedy="give the sweep's Dataset")
    if len(varied) > 2:
        raise ShowError(f"{len(varied)} quantities vary: {', '.join(varied)}", argument="data",
                        remedy="select values of the others: data.sel(...)")  # fmt: skip
    return [(_label(data, name), data[name].values) for name in varied]


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
        axis.legend()
    axis.set(xlabel=name, ylabel=label)
    if _scale(x) == "log":  # to set "linear" again would take the names from the ticks
        axis.set_xscale("log")
    return figure


def _positions(axis: Any, x: np.ndarray) -> np.ndarray:
    """Values as positions on an axis: names are numbered, and written beside their ticks."""
    if x.dtype.kind in "fiub":
        return x.astype(float)
    names = list(dict.fromkeys(x.tolist()))
    axis.set_ticks(np.arange(len(names)), [plain(str(name)) for name in names], fontsize=6)
    return np.array([names.index(name) for name in x.tolist()], dtype=float)


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
    return np.exp(edges) if _scale(x) == "log" else edges


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
    x, y = _positions(axis.xaxis, x), _positions(axis.yaxis, y)
    if values.squeeze().ndim == 2:
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
