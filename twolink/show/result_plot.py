"""Figures of results that are no motions: bars with errors, and lines."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from twolink.show.figure import COLOURS, new_figure, plain, save_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_bars(
    path: str | Path | None, title: str, unit: str, names: Sequence[str], values: Sequence[float],
    errors: Sequence[float] | None = None,
) -> Path | Figure:  # fmt: skip
    """Draw numbers (n,) with their errors (n,) as bars by name. Returns the path; without one the figure."""
    figure, axes = new_figure(1, size=(6.0, 1.2 + 0.3 * len(names)))
    axis = axes[0, 0]
    axis.barh([plain(name) for name in names], values, xerr=errors, color=COLOURS[4], ecolor=COLOURS[6])
    axis.invert_yaxis()
    axis.set_xlabel(unit)
    axis.set_title(plain(title), fontsize=10)
    return figure if path is None else save_figure(figure, Path(path))


def plot_lines(
    path: str | Path | None, title: str, labels: tuple[str, str], x: np.ndarray, curves: Mapping[str, np.ndarray]
) -> Path | Figure:
    """Draw curves (n,) by name over x (n,). labels: of the axes. Returns the path; without one the figure."""
    figure, axes = new_figure(1, size=(6.4, 4.0))
    axis = axes[0, 0]
    for i, (name, values) in enumerate(curves.items()):
        axis.plot(x, values, color=COLOURS[i % len(COLOURS)], label=plain(name))
    axis.set_xlabel(labels[0])
    axis.set_ylabel(labels[1])
    axis.set_title(plain(title), fontsize=10)
    axis.legend(frameon=False, fontsize=8)
    return figure if path is None else save_figure(figure, Path(path))
