"""Figures of eigenvalues: in the complex plane, or beside the unit circle."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from twolink.show.figure import COLOURS, new_figure, plain, save_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_eigenvalues(
    path: Path | None, title: str, values: np.ndarray, errors: np.ndarray, *, unit_circle: bool = False
) -> "Path | Figure":
    """Draw eigenvalues (n,) with circles of their errors (n,). Returns the path; without one the figure.

    unit_circle: what is stable is inside it (multipliers), else left of the imaginary axis.
    """
    from matplotlib.patches import Circle

    figure, axes = new_figure(1, size=(5.0, 4.6))
    axis = axes[0, 0]
    for value, error in zip(values, errors, strict=True):
        axis.add_patch(Circle((value.real, value.imag), error, color=COLOURS[4], alpha=0.4, linewidth=0))
    axis.plot(values.real, values.imag, "x", color=COLOURS[0], markersize=7, markeredgewidth=1.8)
    if unit_circle:
        axis.add_patch(Circle((0.0, 0.0), 1.0, fill=False, color="0.45", linewidth=1.0))
    else:
        axis.axvline(0.0, color="0.45", linewidth=1.0)
    axis.axhline(0.0, color="0.8", linewidth=0.8, zorder=1)
    axis.set_aspect("equal", adjustable="datalim")
    axis.set_xlabel("real part" if unit_circle else "real part, 1/s")
    axis.set_ylabel("imaginary part" if unit_circle else "imaginary part, 1/s")
    axis.set_title(plain(title), fontsize=10)
    return figure if path is None else save_figure(figure, path)
