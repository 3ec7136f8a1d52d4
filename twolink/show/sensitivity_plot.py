"""The figure of sensitivities: the motion in a tube, and how far each parameter moves it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from twolink.show.direct_labels import label_right
from twolink.show.figure import COLOURS, new_figure, plain, save_figure
from twolink.show.trajectory_plot import JOINT_COLOURS, PANELS, curves_of, draw, those_that_move_most

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from twolink.dynamics import Robot

MAX_NAMES = 6
STEP = 1e-6  # of differences of curves, rad or m
SMALLEST = 1e-9  # of the largest move: the lower end of the axis


def plot_sensitivities(
    robot: Robot,
    title: str,
    motion: tuple[np.ndarray, np.ndarray, np.ndarray],
    along: tuple[np.ndarray, np.ndarray],
    moves: Mapping[str, np.ndarray],
    path: Path | None,
) -> Path | Figure:
    """Draw a motion in a tube, and below it how far each parameter moves it, on a logarithmic axis.

    Parameters
    ----------
    robot : Robot
    title : str
    motion : (t, q, v)
        Times (n,), s, configurations (n, nq) and velocities (n, nv).
    along : (dq, dv)
        The changes (n, nv, k) that make the tube; those of q in the tangent space.
    moves : mapping of names to ndarray (n,)
        How far each parameter moves q, rad or m.
    path : Path or None
        A .png, .svg or .pdf file; None to keep the figure.

    Returns
    -------
    Path or Figure

    Raises
    ------
    ShowError
        When the file cannot be written.
    """
    t, q, v = motion
    drawn, widths = list(curves_of(robot, q, v)), tube(robot, q, v, *along)
    joints = those_that_move_most(drawn)
    colours = dict(zip(joints, JOINT_COLOURS, strict=False))
    panels = [name for name in PANELS if any(c.panel == name and c.joint in colours for c in drawn)]
    heights = [2.0] * len(panels) + [1.8]
    figure, axes = new_figure(len(heights), size=(9, 0.9 + sum(heights)), sharex=True, height_ratios=heights)
    for axis, name in zip(axes[:, 0], panels, strict=False):
        axis.set_ylabel(PANELS[name])
        shown = [(c, w) for c, w in zip(drawn, widths, strict=True) if c.panel == name and c.joint in colours]
        draw(axis, t, [curve for curve, _ in shown], colours)
        for curve, width in shown:
            axis.fill_between(t, curve.values - width, curve.values + width, color=colours[curve.joint], alpha=0.25,
                              linewidth=0)  # fmt: skip
    _draw_moves(axes[-1, 0], t, moves)
    figure.align_ylabels(axes[:, 0])
    axes[-1, 0].set_xlim(t[0], t[-1] if t[-1] > t[0] else None)
    figure.suptitle(plain(title))
    label_right(figure, {axis: [(line, line.get_label()) for line in axis.get_lines()] for axis in axes[:, 0]})
    return figure if path is None else save_figure(figure, path)


def tube(robot: Robot, q: np.ndarray, v: np.ndarray, dq: np.ndarray, dv: np.ndarray) -> list[np.ndarray]:
    """Half the width (n,) of each curve's tube: the sum of its first-order moves along the changes (n, nv, k)."""
    own = list(curves_of(robot, q, v))
    widths = [np.zeros(len(q)) for _ in own]
    for k in range(dq.shape[2]):
        step = STEP / max(1.0, float(np.abs(dq[:, :, k]).max(initial=0.0)))
        moved = curves_of(robot, robot.integrate(q, step * dq[:, :, k]), v + step * dv[:, :, k])
        for width, curve, other in zip(widths, own, moved, strict=True):
            off = other.values - curve.values
            if curve.panel == "angle":  # which may be counted on from the other side of a turn
                off -= 2 * np.pi * np.round(off / (2 * np.pi))
            width += np.abs(off) / step
    return widths


def _draw_moves(axis: Any, t: np.ndarray, moves: Mapping[str, np.ndarray]) -> None:
    """How far each parameter moves the motion, those that move it the most."""
    largest = {name: float(move.max(initial=0.0)) for name, move in moves.items()}
    names = sorted(moves, key=lambda name: -largest[name])[:MAX_NAMES]
    for name, colour in zip(names, COLOURS, strict=False):
        positive = moves[name] > SMALLEST * max(largest.values())
        if positive.any():
            axis.semilogy(t[positive], moves[name][positive], color=colour, linewidth=1.2, label=plain(name))
    axis.set(xlabel="time t (s)", ylabel="motion moved by\n(rad, m)")
