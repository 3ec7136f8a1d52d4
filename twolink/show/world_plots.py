"""The figure of many worlds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from twolink.robots.joint_layout import counted_on, unit_of
from twolink.robots.model import RobotModel
from twolink.show.figure import COLOURS, new_figure, plain
from twolink.show.motion_plots import curves_of, those_that_move_most

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MAX_CURVES = 300  # worlds that are drawn over time, at equal distances in their number
MAX_PANELS = 6
UNITS = {"angle": "rad", "position": "m"}
MAP = "viridis"


def plot_worlds(
    robot: RobotModel,
    title: str,
    t: np.ndarray,
    q: np.ndarray,
    v: np.ndarray,
    varied: Mapping[str, np.ndarray],
    error: np.ndarray | None,
) -> Figure:
    """Draw the coordinates of n worlds, and their error bars.

    Parameters
    ----------
    robot : RobotModel
        Whose joints the coordinates belong to.
    title : str
        The title of the figure.
    t : (m,)
        Times, s.
    q, v : (m, n, nq), (m, n, nv)
        Configurations, drawn over time; of one time over the first quantity that differs, or the world's number. And
        velocities.
    varied : mapping of str to (n,)
        What differs between the worlds; the first one gives the colours.
    error : (n,) or None
        Their error bars, rad or m.

    Returns
    -------
    Path or Figure
    """
    count = q.shape[1]
    name, values = next(iter(varied.items()), ("number of the world", np.arange(count, dtype=float)))
    some = np.unique(np.linspace(0, count - 1, MAX_CURVES).astype(int)) if len(q) > 1 else np.arange(count)
    panels = _panels(robot, t, q[:, some], v[:, some])
    figure, axes = new_figure(len(panels) + (error is not None) or 1, size=(9, 1.2 + 1.7 * len(panels)))
    shades: Any = None
    for axis, (label, curves) in zip(axes[:, 0], panels.items(), strict=False):
        axis.set_ylabel(plain(label))
        if len(q) > 1:
            shades = _lines(axis, t, curves, values[some])
        else:
            axis.plot(values[some], curves[0], ".", color=COLOURS[0], markersize=3)
    if len(q) > 1 and panels:
        axes[len(panels) - 1, 0].set_xlabel("time t (s)")
        figure.colorbar(shades, ax=list(axes[: len(panels), 0]), label=plain(name))
    if error is not None:
        bars = np.where(error > 0, error, np.nan)
        axes[-1, 0].semilogy(values, bars, ".", color=COLOURS[5], markersize=3)
        axes[-1, 0].set_ylabel(f"error bar\n({unit_of(robot.joints)})")
    if error is not None or len(q) == 1:
        axes[-1, 0].set_xlabel(plain(name))
    few = f", {len(some)} of them drawn" if len(some) < count else ""
    figure.suptitle(plain(f"{title}: {count} worlds{few}"))
    return figure


def _panels(robot: RobotModel, t: np.ndarray, q: np.ndarray, v: np.ndarray) -> dict[str, np.ndarray]:
    """The coordinates (m, n) that move the most, by name and unit; angles where q has cosine and sine."""
    m, n, _ = q.shape
    flat = np.nan_to_num(q.transpose(1, 0, 2).reshape(n * m, -1))
    found = [c for c in curves_of(robot, flat, np.zeros((n * m, robot.model.nv))) if c.panel in UNITS]
    joints = those_that_move_most(found)[:MAX_PANELS]
    lost = ~np.isfinite(q).all(axis=2)
    turning = {joint.name: joint.v.stop - 1 for joint in robot.joints if joint.kind in ("cos-sin", "planar")}
    panels = {}
    for curve in [c for c in found if c.joint in joints][:MAX_PANELS]:
        values = curve.values.reshape(n, m).T.copy()
        if curve.joint in turning and curve.panel == "angle":  # counted on in each world by itself
            speeds = np.nan_to_num(v[:, :, turning[curve.joint]])
            values = counted_on((values + np.pi) % (2.0 * np.pi) - np.pi, t, speeds)
        values[lost] = np.nan
        panels[f"{curve.joint} {curve.entry}".rstrip() + f"\n({UNITS[curve.panel]})"] = values
    return panels


def _lines(axis: Any, t: np.ndarray, curves: np.ndarray, values: np.ndarray) -> Any:
    """Curves (m, n) over time, coloured by values (n,)."""
    from matplotlib.collections import LineCollection

    lines = LineCollection([np.column_stack([t, curve]) for curve in curves.T], cmap=MAP, linewidths=0.8, alpha=0.7)
    lines.set_array(values)
    axis.add_collection(lines)
    axis.autoscale_view()
    axis.set_xlim(t[0], t[-1])
    return lines
