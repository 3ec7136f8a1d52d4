"""The figure of a search for the best throw: the ball's paths, its speed along them, and the aim over the elevation."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from twolink.paper.throw import SearchResult, Throw
from twolink.show.direct_labels import label_ends
from twolink.show.figure import COLOURS, new_figure, save_figure

BEST, OTHERS, ARM, GROUND = COLOURS[5], COLOURS[4], "0.25", "0.4"
BEST_LINE: dict[str, Any] = {"color": BEST, "linewidth": 2.4, "zorder": 3}
OTHER_LINE: dict[str, Any] = {"color": OTHERS, "linewidth": 1.2, "zorder": 2}
SAME_RELEASE = 1e-3  # s: a throw released so near to the best one is not drawn beside it
MARGIN = 0.06  # of the height
LANE = (-0.6, 4.5)  # m: the part of the lane that is drawn, because the ball is low


def plot_search(result: SearchResult, path: Path) -> Path:
    """Draw the paths above; below, the speed along them, and the aim over the elevation at the release."""
    figure, axes = new_figure(2, 2, size=(11, 6.8), height_ratios=[1.15, 1])
    axes[0, 1].remove()
    axes[0, 0].set_subplotspec(axes[0, 0].get_gridspec()[0, :])  # the paths take the whole row
    release = result.best.times["ball"]
    others = [one for one in result.others() if abs(one.times["ball"] - release) > SAME_RELEASE]
    _draw_paths(figure, axes[0, 0], result, others)
    _draw_speeds(axes[1, 0], result, others)
    _draw_aim(axes[1, 1], result, others)
    best, aim = result.best, result.aim
    reached = f"{aim.what} {best.end:.4g} {aim.unit}, released after {1e3 * best.times['ball']:.2f} ms"
    ended = ", interrupted" if result.found.interrupted else ""
    figure.suptitle(f"{result.name}: {reached} at {best.speed:.4g} m/s and {np.degrees(best.elevation):.1f}°{ended}")
    return save_figure(figure, path)


def _draw_paths(figure: Any, axis: Any, result: SearchResult, others: Sequence[Throw]) -> None:
    """The paths, labelled by their release times, and the arm at the best release."""
    lines: dict[str, tuple[Any, Any]] = {}
    styles: dict[str, dict[str, Any]] = {}
    far = result.aim.unit == "m"
    top = 0.0
    for throw in (*others, result.best):
        is_best, milliseconds = throw is result.best, 1e3 * throw.times["ball"]
        x, _, z = throw.flight[1].T
        top = max(top, float(z.max()))
        axis.plot(x, z, **(BEST_LINE if is_best else OTHER_LINE))
        name = f"best: {milliseconds:.1f} ms" if is_best else f" {milliseconds:.0f} "
        label = int(np.argmax(z))  # the label is at the top of the path, or at the end of one that only falls
        if far and label < len(z) / 10:
            label = len(z) - 1
        lines[name] = np.append(x, x[:label:-1]), np.append(z, z[:label:-1])
        styles[name] = {"color": BEST, "fontweight": "bold"} if is_best else {"color": "0.35"}
    lines["arm"], styles["arm"] = tuple(result.best.joints[::-1, [0, 2]].T), {"color": ARM}
    axis.plot(*lines["arm"], color=ARM, linewidth=3, marker="o", markersize=4, zorder=4)
    axis.set(xlabel="x (m)", ylabel="height of the ball (m)")
    if far:
        axis.set_aspect("equal")
    else:
        axis.set_xlim(LANE)
    axis.set_ylim(-MARGIN * top, (1 + 3 * MARGIN) * top)
    ground, ends = "ground" if far else "lane", axis.get_xlim()
    lines[ground], styles[ground] = (ends[::-1], np.zeros(2)), {"color": GROUND}
    axis.plot(*lines[ground], color=GROUND, linewidth=1)
    axis.set_xlim(ends)
    axis.set_title("paths of the ball, by release time in ms; the arm at the best release", loc="left", fontsize=10)
    label_ends(figure, axis, lines, styles, size=8)


def _draw_speeds(axis: Any, result: SearchResult, others: Sequence[Throw]) -> None:
    for throw in (*others, result.best):
        _, positions, velocities = throw.flight
        axis.plot(positions[:, 0], velocities[:, 0], **(BEST_LINE if throw is result.best else OTHER_LINE))
    axis.set(xlabel="x (m)", ylabel="forward speed of the ball (m/s)")
    axis.set_ylim(bottom=0.0)


def _draw_aim(axis: Any, result: SearchResult, others: Sequence[Throw]) -> None:
    """The quantity aimed at over the elevation."""

    def points(throws: Sequence[Throw], **style: Any) -> None:
        elevations = [float(np.degrees(throw.elevation)) for throw in throws]
        axis.plot(elevations, [throw.end for throw in throws], linestyle="none", **style)

    points(others, marker="o", markersize=5, color=OTHERS)
    points([result.best], marker="*", markersize=15, color=BEST, zorder=4)
    above: dict[str, Any] = {"xytext": (0, 6), "textcoords": "offset points", "ha": "center"}
    for throw in others:
        at = np.degrees(throw.elevation), throw.end
        axis.annotate(f"{1e3 * throw.times['ball']:.0f}", at, fontsize=8, color="0.35", **above)
    axis.set_xlabel("elevation of the ball's velocity at the release (degrees)")
    axis.set_ylabel(f"{result.aim.what} ({result.aim.unit})")
    axis.set_ylim(bottom=0.0, top=result.best.end * 1.15)
    axis.set_title("by release time in ms", loc="left", fontsize=10)
