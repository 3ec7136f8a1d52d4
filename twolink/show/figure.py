"""Figures in one style: colours, axes, names, files."""

from __future__ import annotations

import base64
import functools
import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from twolink.errors import ShowError
from twolink.io.atomic import write_atomic
from twolink.io.tables import require_format

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FORMATS = (".png", ".svg", ".pdf")
# Okabe and Ito's colours, which people with colour blindness can tell apart (Okabe and Ito 2008, jfly.uni-koeln.de).
COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#000000")


def new_figure(rows: int, columns: int = 1, *, size: tuple[float, float], **options: Any) -> tuple[Figure, np.ndarray]:
    """A figure and its axes (rows, columns) in the common style. It belongs to no window and no global state.

    `size` is in inches; `options` go to matplotlib's `Figure.subplots`.
    """
    figure = _shown_inline()(figsize=size, dpi=150, layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, **options)
    for axis in axes.flat:
        axis.grid(True, color="0.9", linewidth=0.6)
        axis.set_axisbelow(True)
        axis.spines[["top", "right"]].set_visible(False)
    return figure, axes


@functools.cache
def _shown_inline() -> type[Figure]:
    """Figures that notebooks show, as those of pyplot."""
    from matplotlib.figure import Figure

    class InlineFigure(Figure):
        def _repr_png_(self) -> bytes:
            picture = io.BytesIO()
            self.savefig(picture, format="png")
            return picture.getvalue()

    return InlineFigure


def save_figure(figure: Figure, path: Path) -> Path:
    """Save a figure as .png, .svg or .pdf. Returns the path. Raises ShowError."""
    kind = require_format(path, FORMATS, ShowError)[1:]
    return write_atomic(path, lambda file: figure.savefig(file, format=kind), error=ShowError)


def figure_html(figure: Figure) -> str:
    """A figure as a picture in HTML, for notebooks."""
    picture = io.BytesIO()
    figure.savefig(picture, format="png", dpi=100)
    encoded = base64.b64encode(picture.getvalue()).decode("ascii")
    return f'<img src="data:image/png;base64,{encoded}" style="max-width: 100%" alt="">'


def plain(name: str) -> str:
    """A name as matplotlib draws it letter by letter: no formulas, and none that a legend leaves out."""
    text = name.replace("$", r"\$")
    return f" {text}" if text.startswith("_") else text
