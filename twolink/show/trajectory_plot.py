"""The figure of a trajectory."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from twolink.show.figure import COLOURS, new_figure, plain, save_figure

MAX_LINES = 14
LINE_STYLES = ("-",) * len(COLOURS) + ("--",) * len(COLOURS)


def plot_trajectory(
    path: Path,
    title: str,
    t: np.ndarray,
    q: Mapping[str, np.ndarray],
    v: Mapping[str, np.ndarray],
    energy: np.ndarray,
    error: np.ndarray | None,
) -> Path:
    """Draw q, v, energy and the error bar over time, one above the other.

    Parameters
    ----------
    path : Path
        A .png, .svg or .pdf file.
    title : str
        The title of the figure.
    t : array (n,)
        Times, s.
    q, v : mapping of names to arrays (n,)
        The coordinates (rad or m) and velocities (rad/s or m/s) to draw.
    energy : array (n,)
        Mechanical energy, J.
    error : array (n,) or None
        The error bar, rad or m; None when the run was not verified.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    ShowError
        When the file cannot be written.
    """
    tall = max(1.0, min(len(q), MAX_LINES) / 10)  # a long legend needs a high axis beside it
    figure, axes = new_figure(4, size=(8, 4.5 + 4.5 * tall), sharex=True, height_ratios=(tall, tall, 1, 1))
    q_axis, v_axis, energy_axis, error_axis = axes[:, 0]
    _plot_lines(q_axis, t, q, "configuration q\n(rad, m)")
    _plot_lines(v_axis, t, v, "velocity v\n(rad/s, m/s)")
    energy_axis.plot(t, energy - energy[0], color="0.2", linewidth=1.2)
    energy_axis.set_ylabel(f"energy (J)\nabove {energy[0]:.4g} J")
    error_axis.set(xlabel="time t (s)", ylabel="error bar\n(rad, m)")
    if error is None:
        place = {"transform": error_axis.transAxes, "ha": "center", "va": "center"}
        error_axis.text(0.5, 0.5, "not verified", color="0.4", **place)
        error_axis.set_yticks([])
    else:
        positive = error > 0
        error_axis.semilogy(t[positive], error[positive], color="#D55E00", linewidth=1.2)
    figure.suptitle(plain(title))
    return save_figure(figure, path)


def _plot_lines(axis: Any, t: np.ndarray, lines: Mapping[str, np.ndarray], label: str) -> None:
    """Draw the first lines over time, with a legend beside the axis."""
    drawn = list(lines.items())[:MAX_LINES]
    for (name, values), colour, style in zip(drawn, COLOURS * 2, LINE_STYLES, strict=False):
        axis.plot(t, values, style, color=colour, linewidth=1.2, label=plain(name))
    title = None if len(lines) <= MAX_LINES else f"the first {MAX_LINES} of {len(lines)}"
    axis.legend(loc="upper left", bbox_to_anchor=(1.01, 1), fontsize=8, frameon=False, title=title)
    axis.set_ylabel(label)
