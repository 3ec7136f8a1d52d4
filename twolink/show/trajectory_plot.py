"""Figures of a trajectory."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from twolink.errors import ShowError, TwolinkError
from twolink.io.atomic import write_atomic
from twolink.io.tables import require_format

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from twolink.simulation.trajectory import Trajectory

FORMATS = (".png", ".svg", ".pdf")
# Okabe and Ito's colours, which the colour-blind can tell apart.
COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#000000")
MAX_LINES = 14


def new_figure(rows: int, columns: int = 1, *, size: tuple[float, float], **options: Any) -> tuple[Figure, np.ndarray]:
    """A figure with axes (rows, columns) in our style; it belongs to no window and no global state."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, dpi=150, layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, **options)
    for axis in axes.flat:
        axis.grid(True, color="0.9", linewidth=0.6)
        axis.set_axisbelow(True)
        axis.spines[["top", "right"]].set_visible(False)
    return figure, axes


def save_figure(figure: Figure, path: Path) -> Path:
    """Save a figure as .png, .svg or .pdf, whole or not at all."""
    try:
        suffix = require_format(path, FORMATS)
        return write_atomic(path, lambda file: figure.savefig(file, format=suffix[1:]))
    except TwolinkError as error:
        raise ShowError(error.what, where=error.where, remedy=error.remedy) from None


def plain(name: str) -> str:
    """A name from outside as matplotlib shows it to the letter: no formulas, and no label that a legend leaves out."""
    text = name.replace("$", r"\$")
    return f" {text}" if text.startswith("_") else text


def plot_trajectory(run: Trajectory, path: Path) -> Path:
    """q, v, energy and the error bar over time, one under the other."""
    figure, axes = new_figure(4, size=(8, 9), sharex=True)
    (top, middle, energy, error) = axes[:, 0]
    columns = run.columns()
    for axis, prefix, label in (
        (top, "q.", "configuration q\n(rad, m)"),
        (middle, "v.", "velocity v\n(rad/s, m/s)"),
    ):
        names = [n for n in columns if n.startswith(prefix)]
        for name, colour in zip(names[:MAX_LINES], COLOURS * 2, strict=False):
            axis.plot(run.t, columns[name], color=colour, linewidth=1.2, label=plain(name.removeprefix(prefix)))
        title = None if len(names) <= MAX_LINES else f"the first {MAX_LINES} of {len(names)}"
        axis.legend(loc="upper left", bbox_to_anchor=(1.01, 1), fontsize=8, frameon=False, title=title)
        axis.set_ylabel(label)
    energy.plot(run.t, run.energy - run.energy[0], color="0.2", linewidth=1.2)
    energy.set_ylabel(f"energy (J)\nabove {run.energy[0]:.4g} J")
    _plot_error(error, run)
    error.set_xlabel("time t (s)")
    figure.suptitle(f"{plain(run.robot.name)}: {run.t[-1]:g} s")
    return save_figure(figure, path)


def _plot_error(axis: Any, run: Trajectory) -> None:
    axis.set_ylabel("error bar\n(rad, m)")
    if run.error is None:
        axis.text(0.5, 0.5, "not verified", transform=axis.transAxes, ha="center", va="center", color="0.4")
        axis.set_yticks([])
        return
    positive = run.error > 0
    axis.semilogy(run.t[positive], run.error[positive], color="#D55E00", linewidth=1.2)
