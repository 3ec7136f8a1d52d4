"""The figure of a search for the best throw: the ball's paths, its speed on the way, and the aim over the elevation."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from twolink.show.direct_labels import label_ends
from twolink.show.figure import COLOURS, new_figure, save_figure

if TYPE_CHECKING:
    from twolink.paper.throw import Throw, Throws

BEST, OTHERS, ARM = COLOURS[5], COLOURS[4], "0.25"
BEST_LINE: dict[str, Any] = {"color": BEST, "linewidth": 2.4, "zorder": 3}
OTHER_LINE: dict[str, Any] = {"color": OTHERS, "linewidth": 1.2, "zorder": 2}
ALIKE = 1e-3  # s: a throw so near to the best is not shown beside it
MARGIN = 0.06  # of what is drawn
LANE = (-0.6, 4.5)  # m: what is shown of it, for the ball is low


def plot_throws(found: Throws, path: Path) -> Path:
    """Paths above; below, the speed along them, and what was aimed at over the elevation at the release."""
    figure, axes = new_figure(2, 2, size=(11, 6.8), height_ratios=[1.15, 1])
    for axis in axes[0]:
        axis.remove()
    above = figure.add_subplot(axes[0, 0].get_gridspec()[0, :])
    above.grid(True, color="0.9", linewidth=0.6)
    above.set_axisbelow(True)
    above.spines[["top", "right"]].set_visible(False)
    _draw_paths(figure, above, found)
    _draw_speeds(axes[1, 0], found)
    _draw_aim(axes[1, 1], found)
    best, aim = found.best, found.aim
    times = f"let go after {1e3 * best.times['ball']:.2f} ms"
    ended = ", interrupted" if found.interrupted else ""
    figure.suptitle(f"{found.name}: {aim.what} {best.end:.4g} {aim.unit}, {times} at {best.speed:.4g} m/s and "
                    f"{np.degrees(best.elevation):.1f}°{ended}")  # fmt: skip
    return save_figure(figure, path)


def _others(found: Throws) -> list[Throw]:
    """The scanned throws that can be told from the best one."""
    return [one for one in found.scanned if abs(one.times["ball"] - found.best.times["ball"]) > ALIKE]


def _draw_paths(figure: Any, axis: Any, found: Throws) -> None:
    """The scanned throws' paths, labelled by their release times, and the best one's; the arm at the release."""
    lines: dict[str, tuple[Any, Any]] = {}
    styles: dict[str, dict[str, Any]] = {}
    pitched = found.aim.unit == "m"
    top = 0.0
    for throw in (*_others(found), found.best):
        own = throw is found.best
        x, _, z = throw.flight[1].T
        top = max(top, float(z.max()))
        axis.plot(x, z, **(BEST_LINE if own else OTHER_LINE))
        name = f"best: {1e3 * throw.times['ball']:.1f} ms" if own else f" {1e3 * throw.times['ball']:.0f} "
        label = int(np.argmax(z))  # the top of the path, or the end of one that only falls to the ground
        if pitched and label < len(z) / 10:
            label = len(z) - 1
        lines[name] = np.append(x, x[:label:-1]), np.append(z, z[:label:-1])
        styles[name] = {"color": BEST if own else "0.35", "fontweight": "bold" if own else "normal"}
    lines["arm"], styles["arm"] = tuple(found.best.joints[::-1, [0, 2]].T), {"color": ARM}
    axis.plot(*lines["arm"], color=ARM, linewidth=3, marker="o", markersize=4, zorder=4)
    axis.set(xlabel="x (m)", ylabel="height of the ball (m)")
    if pitched:
        axis.set_aspect("equal")
    else:
        axis.set_xlim(LANE)
    axis.set_ylim(-MARGIN * top, (1 + 3 * MARGIN) * top)
    ground, ends = "ground" if pitched else "lane", axis.get_xlim()
    lines[ground], styles[ground] = (ends[::-1], np.zeros(2)), {"color": "0.4"}
    axis.plot(*lines[ground], color="0.4", linewidth=1)
    axis.set_xlim(ends)
    axis.set_title("paths of the ball, by release time in ms; the arm at the best release", loc="left", fontsize=10)
    label_ends(figure, axis, lines, styles, size=8)


def _draw_speeds(axis: Any, found: Throws) -> None:
    for throw in (*_others(found), found.best):
        _, places, velocities = throw.flight
        axis.plot(places[:, 0], velocities[:, 0], **(BEST_LINE if throw is found.best else OTHER_LINE))
    axis.set(xlabel="x (m)", ylabel="forward speed of the ball (m/s)")
    axis.set_ylim(bottom=0.0)


def _draw_aim(axis: Any, found: Throws) -> None:
    """What was aimed at over the elevation: of the scan, of the optimizer, and the best."""

    def points(throws: Sequence[Throw]) -> tuple[list[float], list[float]]:
        return [float(np.degrees(throw.elevation)) for throw in throws], [throw.end for throw in throws]

    axis.plot(*points(found.tried[len(found.scanned) :]), linestyle="none", marker="o", markersize=3, color="0.6")
    axis.plot(*points(_others(found)), linestyle="none", marker="o", markersize=5, color=OTHERS)
    for throw in _others(found):
        axis.annotate(f"{1e3 * throw.times['ball']:.0f}", (np.degrees(throw.elevation), throw.end), xytext=(0, 6),
                      textcoords="offset points", ha="center", fontsize=8, color="0.35")  # fmt: skip
    axis.plot(*points([found.best]), linestyle="none", marker="*", markersize=15, color=BEST, zorder=4)
    axis.set(xlabel="elevation of the ball's velocity at the release (degrees)",
             ylabel=f"{found.aim.what} ({found.aim.unit})")  # fmt: skip
    axis.set_ylim(bottom=0.0, top=found.best.end * 1.15)
    axis.set_title("by release time in ms; small dots: the optimizer's throws", loc="left", fontsize=10)
