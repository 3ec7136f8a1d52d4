"""The figures of a trajectory, of its sensitivities and of many worlds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from twolink.robots.joint_layout import JointLayout, turns
from twolink.robots.model import RobotModel
from twolink.show.figure import COLOURS, label_right, new_figure, plain

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from twolink.dynamics import Robot

MAX_JOINTS = 10
JOINT_COLOURS = (*COLOURS, "#882255", "#999933", "#44AA99")  # the last three are of Tol's muted scheme
STYLES = ("-", "--", ":", "-.")  # of the coordinates of one joint
PANELS = {
    "angle": "angle\n(rad)",
    "position": "position\n(m)",
    "orientation": "orientation\n(quaternion)",
    "turn": "angular velocity\n(rad/s)",
    "slide": "velocity\n(m/s)",
}
MAX_NAMES = 6
STEP = 1e-6  # of differences of curves, rad or m
SMALLEST = 1e-9  # of the largest move: the lower end of the axis
MAX_CURVES = 300  # worlds that are drawn over time, at equal distances in their number
MAX_PANELS = 6
UNITS = {"angle": "rad", "position": "m"}
MAP = "viridis"
MAX_EVENTS = 60  # that are marked
EVENT_ROOM = 0.04  # of the axis, which the name of an event takes
COVERS = 0.004  # of a panel's range: a curve that is nearer to another one all the time is covered by it


class JointCurve(NamedTuple):
    """A coordinate or velocity over time: the panel it belongs to, its joint, the name of the entry in it."""

    panel: str
    joint: str
    entry: str
    values: np.ndarray


def plot_trajectory(
    robot: RobotModel,
    title: str,
    curves: tuple[np.ndarray, np.ndarray, np.ndarray],
    energy: tuple[np.ndarray, np.ndarray],
    error: tuple[np.ndarray, np.ndarray | None],
    *,
    estimated: bool = False,
    events: Sequence[tuple[float, str]] = (),
    note: str = "",
) -> Figure:
    """Draw coordinates, velocities, energy and the error bar over time, one above the other.

    Angles, positions and quaternions have panels of their own. A joint has one colour in all of them, and its name
    beside its curves; a curve that covers an earlier one is dashed. Of many joints those are drawn that move the most.
    Events are vertical lines, with their kinds above where there is room.

    Parameters
    ----------
    robot : RobotModel
        Whose joints the coordinates belong to.
    title : str
        The title of the figure.
    curves : (t, q, v)
        Times (m,), s, configurations (m, nq) and velocities (m, nv).
    energy : (t, E)
        Times (k,), s, and mechanical energy (k,), J.
    error : (t, bar)
        Times (n,), s, and the error bar (n,), rad or m; None when it was not verified.
    estimated : bool
        The error is an estimate and no bound.
    events : sequence of (t, kind)
        Times, s, and kinds of events.
    note : str
        Stands below the title.

    Returns
    -------
    Figure
    """
    t, q, v = curves
    drawn = list(curves_of(robot, q, v))
    joints = those_that_move_most(drawn)
    colours = dict(zip(joints, JOINT_COLOURS, strict=False))
    panels = [name for name in PANELS if any(c.panel == name and c.joint in colours for c in drawn)]
    heights = [2.2 if len(colours) > 3 else 1.6] * len(panels) + [1.2, 1.2]
    figure, axes = new_figure(len(heights), size=(9, 0.9 + sum(heights)), sharex=True, height_ratios=heights)
    for axis, name in zip(axes[:, 0], panels, strict=False):
        axis.set_ylabel(PANELS[name])
        draw(axis, t, [c for c in drawn if c.panel == name and c.joint in colours], colours)
    _draw_energy(axes[-2, 0], *energy)
    _draw_error(axes[-1, 0], *error)
    if estimated:
        axes[-1, 0].set_ylabel("estimated error\n(rad, m)")
    figure.align_ylabels(axes[:, 0])
    axes[-1, 0].set_xlim(t[0], t[-1] if t[-1] > t[0] else None)
    moving = len({c.joint for c in drawn})
    few = [f"the {len(joints)} of {moving} joints that move the most"] if len(joints) < moving else []
    figure.suptitle("\n".join([plain(title), *few, *([note] if note else [])]), fontsize=11)
    _mark_events(list(axes[:, 0]), events)
    label_right(figure, {axis: [(line, line.get_label()) for line in axis.get_lines() if line.get_label() != "_event"]
                         for axis in axes[:-2, 0]})  # fmt: skip
    return figure


def curves_of(robot: RobotModel, q: np.ndarray, v: np.ndarray) -> Iterator[JointCurve]:
    """Every joint's coordinates and velocities; the angle, counted on, where q has its cosine and sine."""
    for joint in robot.joints:
        for panel, entry, values in (
            *_positions(robot, joint, q[:, joint.q]),
            *_velocities(robot, joint, v[:, joint.v]),
        ):
            yield JointCurve(panel, joint.name, entry, values)


def _positions(robot: RobotModel, joint: JointLayout, q: np.ndarray) -> list[tuple[str, str, np.ndarray]]:
    if joint.kind == "cos-sin":
        return [("angle", "", np.unwrap(np.arctan2(q[:, 1], q[:, 0])))]
    if joint.kind == "planar":
        place = [("position", name, q[:, i]) for i, name in enumerate("xy")]
        return [*place, ("angle", "", np.unwrap(np.arctan2(q[:, 3], q[:, 2])))]
    if joint.kind == "vector":
        return [("angle" if turns(robot.model, joint) else "position", "", q[:, 0])]
    place = [("position", name, q[:, i]) for i, name in enumerate("xyz")] if joint.kind == "free-flyer" else []
    return [*place, *(("orientation", name, q[:, i - 4]) for i, name in enumerate("xyzw"))] if q.shape[1] else []


def _velocities(robot: RobotModel, joint: JointLayout, v: np.ndarray) -> list[tuple[str, str, np.ndarray]]:
    if v.shape[1] == 1:
        slides = joint.kind == "vector" and not turns(robot.model, joint)
        return [("slide" if slides else "turn", "", v[:, 0])]
    turning = {"planar": ["z"], "quaternion": list("xyz"), "free-flyer": list("xyz")}.get(joint.kind, [])
    first = v.shape[1] - len(turning)
    slide = [("slide", name, v[:, i]) for i, name in enumerate("xyz"[:first])]
    return [*slide, *(("turn", name, v[:, first + i]) for i, name in enumerate(turning))]


def those_that_move_most(curves: Sequence[JointCurve]) -> list[str]:
    """At most MAX_JOINTS joints in their order, by the largest share that they have of the range of any panel."""
    ranges = [float(np.ptp(curve.values)) for curve in curves]
    widest = {c.panel: max(r for d, r in zip(curves, ranges, strict=True) if d.panel == c.panel) for c in curves}
    share: dict[str, float] = {}
    for curve, extent in zip(curves, ranges, strict=True):
        share[curve.joint] = max(share.get(curve.joint, 0.0), extent / (widest[curve.panel] or 1.0))
    most = sorted(share, key=lambda joint: -share[joint])[:MAX_JOINTS]
    return [joint for joint in share if joint in most]


def draw(axis: Any, t: np.ndarray, curves: Sequence[JointCurve], colours: dict[str, str]) -> None:
    """The curves of a panel; those of one joint differ by their line styles, as do those that an earlier one covers."""
    drawn: dict[str, int] = {}
    span = max((float(np.ptp(curve.values)) for curve in curves), default=0.0)
    for i, curve in enumerate(curves):
        style: Any = STYLES[drawn.setdefault(curve.joint, 0)]
        drawn[curve.joint] += 1
        if any(np.abs(curve.values - other.values).max() <= COVERS * span for other in curves[:i]):
            style = (0, (5, 5)) if style == "-" else style
        name = f"{curve.joint} {curve.entry}".rstrip()
        axis.plot(t, curve.values, linestyle=style, color=colours[curve.joint], linewidth=1.2, label=plain(name))


def _draw_energy(axis: Any, t: np.ndarray, energy: np.ndarray) -> None:
    axis.plot(t, energy - energy[0], color="0.2", linewidth=1.2)
    axis.set_ylabel("energy change\n(J)")
    axis.text(1.0, 1.0, f"from {energy[0]:.4g} J", transform=axis.transAxes, fontsize=7, color="0.4", ha="right",
              va="bottom")  # fmt: skip


def _mark_events(axes: Sequence[Any], events: Sequence[tuple[float, str]]) -> None:
    """A line at each of the first events in all panels, and above the first panel their kinds, where they have room."""
    first, last = axes[0].get_xlim()
    named = -np.inf
    for t, kind in events[:MAX_EVENTS]:
        for axis in axes:
            axis.axvline(t, color="0.6", linewidth=0.6, linestyle=(0, (1, 2)), zorder=0.5, label="_event")
        if t - named > EVENT_ROOM * (last - first):
            named = t
            axes[0].annotate(plain(kind), (t, 1.0), xycoords=("data", "axes fraction"), xytext=(0, 2), fontsize=7,
                             textcoords="offset points", rotation=30, color="0.4")  # fmt: skip


def _draw_error(error_axis: Any, t: np.ndarray, error: np.ndarray | None) -> None:
    error_axis.set(xlabel="time t (s)", ylabel="error bar\n(rad, m)")
    if error is None:
        place = {"transform": error_axis.transAxes, "ha": "center", "va": "center"}
        error_axis.text(0.5, 0.5, "not verified", color="0.4", **place)
        error_axis.set_yticks([])
    else:
        positive = error > 0
        error_axis.semilogy(t[positive], error[positive], color="#D55E00", linewidth=1.2)
        if positive.any() and error.max() < 10.0 * error[positive].min():  # ticks are powers of ten
            error_axis.set_ylim(error[positive].min() / 3.0, 3.0 * error.max())


def plot_sensitivities(
    robot: Robot,
    title: str,
    motion: tuple[np.ndarray, np.ndarray, np.ndarray],
    along: tuple[np.ndarray, np.ndarray],
    moves: Mapping[str, np.ndarray],
) -> Figure:
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

    Returns
    -------
    Path or Figure
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
    return figure


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


def plot_worlds(
    robot: RobotModel,
    title: str,
    t: np.ndarray,
    q: np.ndarray,
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
    q : (m, n, nq)
        Configurations, drawn over time; of one time over the first quantity that differs, or the world's number.
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
    panels = _panels(robot, q[:, some])
    figure, axes = new_figure(len(panels) + (error is not None), size=(9, 1.2 + 1.7 * len(panels)))
    shades: Any = None
    for axis, (label, curves) in zip(axes[:, 0], panels.items(), strict=False):
        axis.set_ylabel(plain(label))
        if len(q) > 1:
            shades = _lines(axis, t, curves, values[some])
        else:
            axis.plot(values[some], curves[0], ".", color=COLOURS[0], markersize=3)
    if len(q) > 1:
        axes[len(panels) - 1, 0].set_xlabel("time t (s)")
        figure.colorbar(shades, ax=list(axes[: len(panels), 0]), label=plain(name))
    if error is not None:
        bars = np.where(error > 0, error, np.nan)
        axes[-1, 0].semilogy(values, bars, ".", color=COLOURS[5], markersize=3)
        axes[-1, 0].set_ylabel("error bar\n(rad, m)")
    if error is not None or len(q) == 1:
        axes[-1, 0].set_xlabel(plain(name))
    few = f", {len(some)} of them drawn" if len(some) < count else ""
    figure.suptitle(plain(f"{title}: {count} worlds{few}"))
    return figure


def _panels(robot: RobotModel, q: np.ndarray) -> dict[str, np.ndarray]:
    """The coordinates (m, n) that move the most, by name and unit; angles where q has cosine and sine."""
    m, n, _ = q.shape
    flat = np.nan_to_num(q.transpose(1, 0, 2).reshape(n * m, -1))
    found = [c for c in curves_of(robot, flat, np.zeros((n * m, robot.model.nv))) if c.panel in UNITS]
    joints = those_that_move_most(found)[:MAX_PANELS]
    lost = ~np.isfinite(q).all(axis=2)
    turning = {joint.name for joint in robot.joints if joint.kind in ("cos-sin", "planar")}
    panels = {}
    for curve in [c for c in found if c.joint in joints][:MAX_PANELS]:
        values = curve.values.reshape(n, m).T.copy()
        if curve.joint in turning and curve.panel == "angle":  # counted on in each world by itself
            values = np.unwrap((values + np.pi) % (2.0 * np.pi) - np.pi, axis=0)
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
