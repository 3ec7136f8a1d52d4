"""Figures in one style: colours, axes, names, files; labels at the ends of lines; bars, lines and eigenvalues."""

from __future__ import annotations

import base64
import contextlib
import functools
import io
import os
import re
import textwrap
from collections.abc import Collection, Iterable, Mapping, Sequence
from itertools import cycle, pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from twolink.errors import ShowError
from twolink.io.files import path_to_write, write_atomic
from twolink.io.tables import require_format

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FORMATS = (".png", ".svg", ".pdf")
STYLE = Path(__file__).with_name("twolink.mplstyle")
COLOURS = tuple(f"#{colour}" for colour in re.findall('"([0-9A-F]{6})"', STYLE.read_text("utf-8")))
TITLE_WIDTH = 70  # letters of a line of a title
HEIGHT, WIDTH = 1.25, 0.62  # of a letter, in font sizes
LABEL_SIZE = 8  # points, beside curves
# Places to try for a label's near end, in points from the line's end: near, right and above first.
OFFSETS = [(dx, dy) for dx in (7, 16, 28, -7) for dy in (0, 9, -9, 18, -18, 28, -28, 40, -40, 54, -54, 68)]
COVERED, OUTSIDE, FAR = 30.0, 1000.0, 0.5  # costs: of a covered label, of a label outside, per four points of distance
Box = tuple[float, float, float, float]


def new_figure(rows: int, columns: int = 1, *, size: tuple[float, float], **options: Any) -> tuple[Figure, np.ndarray]:
    """A figure and its axes (rows, columns) in the common style. It belongs to no window and no global state.

    `size` is in inches; `options` go to matplotlib's `Figure.subplots`.
    """
    with styled():
        figure = _shown_inline()(figsize=size)
        return figure, figure.subplots(rows, columns, squeeze=False, **options)


def styled() -> contextlib.AbstractContextManager[None]:
    """The common style, for what is drawn and saved within."""
    import matplotlib.style

    return matplotlib.style.context(STYLE)


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
    with styled():
        return write_atomic(path, lambda file: figure.savefig(file, format=kind), error=ShowError)


class Plotted:
    """A result with a figure."""

    @overload
    def plot(self) -> Figure: ...

    @overload
    def plot(self, path: str | os.PathLike[str]) -> Path: ...

    def plot(self, path: str | os.PathLike[str] | None = None) -> Path | Figure:
        """Draw the result.

        Parameters
        ----------
        path : str or path, optional
            A .png, .svg or .pdf file.

        Returns
        -------
        Path or matplotlib.figure.Figure
            The path; without one the figure, which notebooks show.

        Raises
        ------
        ShowError
            There is nothing to draw, the file's ending is another one, or it cannot be written.

        Notes
        -----
        What is drawn: of a trajectory, coordinates, velocities, energy and the error bar over time; of many worlds,
        coordinates over time, or without samples at the end, coloured by what differs, and error bars; of an
        explanation, the operations that each effect adds; of an energy balance, stored energy, works and losses over
        time; of an accuracy study, seconds over error, a line a method, with the front and its prices; of a
        linearization and of equilibria, the eigenvalues; of a periodic motion, the multipliers and the unit circle; of
        a gradient, the derivatives and their error bars; of an optimum, the objective by evaluation; of an
        identification and of a fit, residuals and the covariance of the two values that are correlated most, with all
        intervals, or with the measured and fitted motion and the singular values.
        """
        return self._drawn(path)

    def _drawn(self, path: str | os.PathLike[str] | None, **options: Any) -> Path | Figure:
        with styled():
            figure = self._figure(**options)
        return figure if path is None else save_figure(figure, path_to_write(path))

    def _figure(self, *_: Any, **__: Any) -> Figure:
        raise NotImplementedError


def figure_html(figure: Figure, alt: str = "") -> str:
    """A figure as a picture in HTML, for notebooks and pages. alt: what it shows, for those who do not see it."""
    picture = io.BytesIO()
    figure.savefig(picture, format="png", dpi=100)
    encoded = base64.b64encode(picture.getvalue()).decode("ascii")
    return f'<img src="data:image/png;base64,{encoded}" style="max-width: 100%" alt="{alt}">'


def plain(name: str) -> str:
    """A name as matplotlib draws it letter by letter: no formulas, and none that a legend leaves out."""
    text = name.replace("$", r"\$")
    return f" {text}" if text.startswith("_") else text


def label_ends(
    figure: Any,
    axis: Any,
    lines: Mapping[str, tuple[Sequence[float], Sequence[float]]],
    styles: Mapping[str, Any],
    size: float = 9,
) -> None:
    """Write each name at the last point of its line, with a thin leader where it is not close.

    Parameters
    ----------
    figure, axis : matplotlib Figure and Axes
        Where to write.
    lines : mapping of names to (x, y)
        The lines' points in data coordinates.
    styles : mapping of names to dict
        The options of each name's text, such as its colour.
    size : float
        Font size in points.
    """
    figure.draw_without_rendering()  # computes the layout
    scale = figure.dpi / 72
    drawn = {name: axis.transData.transform(np.column_stack(line)) / scale for name, line in lines.items()}
    points = np.concatenate([_dense(line) for line in drawn.values()])
    frame = axis.get_window_extent()
    inside = (frame.x0 / scale, frame.y0 / scale, frame.x1 / scale, frame.y1 / scale)
    placed: list[Box] = []
    for name in sorted(drawn, key=lambda n: -drawn[n][-1, 0]):  # from the right, where most lines end
        end = drawn[name][-1]
        boxes = [_box(end, offset, len(name) * WIDTH * size, HEIGHT * size) for offset in OFFSETS]
        costs = [_cost(box, offset, placed, points, inside) for box, offset in zip(boxes, OFFSETS, strict=True)]
        best = int(np.argmin(costs))
        placed.append(boxes[best])
        dx, dy = OFFSETS[best]
        leader = {"arrowstyle": "-", "linewidth": 0.5, "color": styles[name].get("color"), "alpha": 0.6, "shrinkB": 2}
        axis.annotate(name, (lines[name][0][-1], lines[name][1][-1]), xytext=(dx, dy), textcoords="offset points",
                      fontsize=size, va="center", ha="left" if dx > 0 else "right", zorder=5,
                      arrowprops=leader if abs(dx) + abs(dy) > 20 else None, **styles[name])  # fmt: skip


def label_right(figure: Any, axes: Iterable[Any]) -> None:
    """Write the label of each line beside its axis, at the height of the line's end, or as near as others leave room.

    Parameters
    ----------
    figure : matplotlib Figure
        Where to write.
    axes : iterable of Axes
        Labels that begin with _ are not written, as in legends.
    """
    figure.draw_without_rendering()  # computes the layout
    for axis in axes:
        lines = [line for line in axis.get_lines() if not line.get_label().startswith("_")]
        frame = axis.get_window_extent()
        gap = HEIGHT * LABEL_SIZE * figure.dpi / 72 / frame.height
        to_share = axis.transData + axis.transAxes.inverted()
        ends = [float(to_share.transform((line.get_xdata()[-1], line.get_ydata()[-1]))[1]) for line in lines]
        for line, end, height in zip(lines, ends, _spread(ends, gap), strict=True):
            style = {"color": line.get_color(), "transform": axis.transAxes, "clip_on": False}
            axis.plot([1.0, 1.012], [end, height], linewidth=0.6, alpha=0.7, **style)
            axis.text(1.016, height, line.get_label(), fontsize=LABEL_SIZE, va="center", **style)


def _spread(ends: Sequence[float], gap: float) -> list[float]:
    """Heights near the ends, in their order, with gaps between them, between 0 and 1 where there is room."""
    order = np.argsort(ends, kind="stable")
    heights = np.clip(np.asarray(ends, dtype=float)[order], 0.0, 1.0)
    for k in range(1, len(heights)):
        heights[k] = max(heights[k], heights[k - 1] + gap)
    ceiling = max(1.0, gap * (len(heights) - 1))
    for k in reversed(range(len(heights))):
        heights[k] = min(heights[k], ceiling - gap * (len(heights) - 1 - k))
    spread = np.empty(len(heights))
    spread[order] = heights
    return spread.tolist()


def _dense(line: np.ndarray) -> np.ndarray:
    """Points along a line (n, 2), some 4 points apart."""
    parts = [np.linspace(a, b, 2 + int(np.hypot(*(b - a)) / 4)) for a, b in pairwise(line)]
    return np.concatenate([line, *parts])


def _box(end: np.ndarray, offset: tuple[float, float], width: float, height: float) -> Box:
    left = end[0] + offset[0] - (width if offset[0] < 0 else 0.0)
    return left, end[1] + offset[1] - height / 2, left + width, end[1] + offset[1] + height / 2


def _cost(box: Box, offset: tuple[float, float], placed: list[Box], points: np.ndarray, inside: Box) -> float:
    left, bottom, right, top = box
    x, y = points.T
    hidden = int(((x > left) & (x < right) & (y > bottom) & (y < top)).sum())
    covered = sum(left < b[2] and b[0] < right and bottom < b[3] and b[1] < top for b in placed)
    outside = left < inside[0] or right > inside[2] or bottom < inside[1] or top > inside[3]
    return hidden + COVERED * covered + OUTSIDE * outside + FAR * (abs(offset[0]) / 2 + abs(offset[1])) / 4


def plot_eigenvalues(
    title: str, sets: Mapping[str, tuple[np.ndarray, np.ndarray]], *, unit_circle: bool = False
) -> Figure:
    """Draw sets of eigenvalues (n,) with circles of their errors (n,), by name.

    unit_circle: what is stable is inside it (multipliers), else left of the imaginary axis.
    """
    from matplotlib.patches import Circle

    figure, axes = new_figure(1, size=(5.0, 4.6 + 0.2 * len(sets)))
    axis = axes[0, 0]
    for colour, (name, (values, errors)) in zip(cycle(COLOURS), sets.items(), strict=False):
        for value, error in zip(values, errors, strict=True):
            axis.add_patch(Circle((value.real, value.imag), error, color=colour, alpha=0.4, linewidth=0))
        axis.plot(values.real, values.imag, "x", color=colour, markersize=7, markeredgewidth=1.8, label=plain(name))
    if unit_circle:
        axis.add_patch(Circle((0.0, 0.0), 1.0, fill=False, color="0.45", linewidth=1.0))
    else:
        axis.axvline(0.0, color="0.45", linewidth=1.0)
    if len(sets) > 1:
        figure.legend(fontsize=8, loc="outside lower center")
    axis.axhline(0.0, color="0.8", linewidth=0.8, zorder=1)
    axis.set_aspect("equal", adjustable="datalim")
    axis.set_xlabel("real part" if unit_circle else "real part, 1/s")
    axis.set_ylabel("imaginary part" if unit_circle else "imaginary part, 1/s")
    axis.set_title(plain(title))
    return figure


def plot_bars(
    title: str, unit: str, names: Sequence[str], values: Sequence[float], errors: Sequence[float] | None = None
) -> Figure:
    """Draw numbers (n,) with their errors (n,) as bars by name."""
    figure, axes = new_figure(1, size=(6.0, 1.2 + 0.3 * len(names)))
    axis = axes[0, 0]
    axis.barh([plain(name) for name in names], values, xerr=errors, color=COLOURS[4], ecolor=COLOURS[6])
    axis.invert_yaxis()
    axis.set_xlabel(unit)
    axis.set_title(textwrap.fill(plain(title), TITLE_WIDTH * 2 // 3))
    return figure


def plot_lines(
    title: str, labels: tuple[str, str], x: np.ndarray, curves: Mapping[str, np.ndarray], *, log: bool = False,
    dashed: Collection[str] = (),
) -> Figure:  # fmt: skip
    """Draw curves (n,) by name over x (n,). labels: of the axes. log: on a logarithmic axis, which leaves out zeros."""
    figure, axes = new_figure(1, size=(6.4, 4.0))
    axis = axes[0, 0]
    for i, (name, values) in enumerate(curves.items()):
        shown = np.where(values > 0.0, values, np.nan) if log else values
        axis.plot(x, shown, "--" if name in dashed else "-", color=COLOURS[i % len(COLOURS)], label=plain(name))
    if log:
        axis.set_yscale("log")
    axis.set_xlabel(labels[0])
    axis.set_ylabel(labels[1])
    axis.set_title(textwrap.fill(plain(title), TITLE_WIDTH))
    axis.legend()
    return figure
