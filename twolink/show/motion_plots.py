"""The figures of a trajectory and of its sensitivities."""

from __future__ import annotations

import fnmatch
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from twolink.dynamics.arguments import Names, texts
from twolink.errors import ShowError, nearest
from twolink.robots.joint_layout import JointLayout, angular_dofs, counted_on, unit_of
from twolink.robots.model import RobotModel
from twolink.show.figure import COLOURS, label_right, new_figure, plain
from twolink.show.figure import WIDTH as LETTER

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from twolink.dynamics import Robot

MAX_JOINTS, MAX_LABELS = 10, 13  # labels beside a panel
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
MAX_EVENTS = 60  # that are marked
NAME_SIZE, NAME_GAP = 7, 0.01  # of the names of events, in points; of the axis between two of them
AXIS_SHARE = 0.8  # of the figure's width, at least
NOISE = 1e-12  # of coordinates and velocities: a smaller range of a panel is not spread over it
UNSEEN = 1e-6  # rad, m, rad/s or m/s: no smaller change is taken for one, where the error bar is as large
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
    estimated: bool,
    events: Sequence[tuple[float, str]],
    note: str,
    asked: float | None,
    joints: Names,
) -> Figure:
    """Draw coordinates, velocities, energy and the error bar over time, one above the other.

    Angles, positions and quaternions have panels of their own. A joint has one colour in all of them, and its name
    beside its curves; a curve that covers an earlier one is dashed. Of many joints those are drawn that move the most,
    and the base of a free robot.
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
    asked : float or None
        The accuracy asked for, rad or m, which stands behind the note.
    joints : str or sequence of str
        Names of joints to draw, or patterns of them; all where none is given.

    Returns
    -------
    Figure

    Raises
    ------
    ShowError
        No joint has the name, or fits the pattern.
    """
    t, q, v = curves
    chosen = _chosen(robot, joints)
    drawn = [curve for curve in curves_of(robot, q, v, t) if curve.joint in chosen]
    most = those_that_move_most(drawn)
    panels, still = _panels([c for c in drawn if c.joint in most], *error)
    height = 2.2 if len(most) > 3 else 1.6
    figure, axes, _ = _with_panels(t, drawn, most, panels, [*[height] * len(panels), 1.4, 1.4])
    _draw_energy(axes[-2, 0], *energy)
    what = "estimated error" if estimated else "error bar"
    _draw_error(axes[-1, 0], *error, f"{what}\n({unit_of(robot.joints)})")
    moving, events = len({c.joint for c in drawn}), [event for event in events if t[0] <= event[0] <= t[-1]]
    few = [f"the {len(most)} of {moving} joints that move the most"] if len(most) < moving else []
    if still:
        few.append(f"constant, and left out: {', '.join(PANELS[name].partition(chr(10))[0] for name in still)}")
    if len(events) > MAX_EVENTS:
        few.append(f"the first {MAX_EVENTS} of {len(events)} events are marked")
    aim = "" if asked is None else f", asked for {asked:.0e}"
    figure.suptitle("\n".join(filter(None, [plain(title), "; ".join(few), note + aim])))
    _mark_events(list(axes[:, 0]), events)
    label_right(figure, axes[:-2, 0])
    return figure


def _with_panels(
    t: np.ndarray, curves: Sequence[JointCurve], joints: Sequence[str], panels: Sequence[str], heights: Sequence[float]
) -> tuple[Figure, np.ndarray, dict[str, str]]:
    """A figure with the curves of some joints in panels, and axes below them; its axes, and the joints' colours."""
    colours = dict(zip(joints, JOINT_COLOURS, strict=False))
    figure, axes = new_figure(len(heights), size=(9, 0.9 + sum(heights)), sharex=True, height_ratios=heights)
    for axis, name in zip(axes[:, 0], panels, strict=False):
        here = [c for c in curves if c.panel == name and c.joint in colours]
        axis.set_ylabel(_label(name, here))
        draw(axis, t, here, colours)
    figure.align_ylabels(axes[:, 0])
    axes[-1, 0].set_xlim(t[0], t[-1] if t[-1] > t[0] else None)
    return figure, axes, colours


def _panels(curves: Sequence[JointCurve], _: np.ndarray, bar: np.ndarray | None) -> tuple[list[str], list[str]]:
    """The panels to draw, and those in which nothing changes by more than the error bar: left out, unless all do so."""
    least = NOISE if bar is None else max(NOISE, min(float(bar.max(initial=0.0)), UNSEEN))
    found = {name: [c for c in curves if c.panel == name] for name in PANELS}
    moving = [name for name, own in found.items() if any(np.ptp(c.values) > least for c in own)]
    still = [name for name, own in found.items() if own and name not in moving]
    return (moving, still) if moving else (still, [])


def _chosen(robot: RobotModel, joints: Names) -> set[str]:
    """The joints that names, or else patterns, mean. Raises ShowError where one means none."""
    wanted = texts(joints, "joints", ShowError, "such as 'elbow' or ['LF_*']")
    names, chosen = [joint.name for joint in robot.joints], set[str]()
    for name in wanted or ["*"]:
        fits = [name] if name in names else fnmatch.filter(names, name)
        if wanted and not fits:
            raise ShowError(f"no joint of {robot.name} fits {name!r}", argument="joints", remedy=nearest(name, names))
        chosen.update(fits)
    return chosen


def curves_of(robot: RobotModel, q: np.ndarray, v: np.ndarray, t: np.ndarray | None = None) -> Iterator[JointCurve]:
    """Every joint's coordinates and velocities; the angle, counted on (at times t), where q has its cosine and sine."""
    for joint in robot.joints:
        own = q[:, joint.q], v[:, joint.v]
        for panel, entry, values in (*_positions(joint, *own, t), *_velocities(joint, own[1])):
            yield JointCurve(panel, joint.name, entry, values)


def _positions(
    joint: JointLayout, q: np.ndarray, v: np.ndarray, t: np.ndarray | None
) -> list[tuple[str, str, np.ndarray]]:
    if joint.kind in ("cos-sin", "planar"):
        c, s = q.T[-2:]
        place = [("position", name, q[:, i]) for i, name in enumerate("xy"[: q.shape[1] - 2])]
        return [*place, ("angle", "", counted_on(np.arctan2(s, c), t, v[:, -1]))]
    if joint.kind == "vector":
        return [("angle" if joint.unit == "rad" else "position", "", q[:, 0])]
    place = [("position", name, q[:, i]) for i, name in enumerate("xyz")] if joint.kind == "free-flyer" else []
    return [*place, *(("orientation", name, q[:, i - 4]) for i, name in enumerate("xyzw"))] if q.shape[1] else []


def _velocities(joint: JointLayout, v: np.ndarray) -> list[tuple[str, str, np.ndarray]]:
    turning, names = angular_dofs(joint), "xyzxyz" if v.shape[1] > 1 else [""]
    return [("turn" if i in turning else "slide", names[i], column) for i, column in enumerate(v.T)]


def those_that_move_most(curves: Sequence[JointCurve]) -> list[str]:
    """At most MAX_JOINTS joints in their order, by the largest share that they have of the range of any panel.

    There are fewer where a panel has no room for the names of their curves.

    The base of a free robot is among them where it moves.
    """
    ranges = [float(np.ptp(curve.values)) for curve in curves]
    widest = {c.panel: max(r for d, r in zip(curves, ranges, strict=True) if d.panel == c.panel) for c in curves}
    share: dict[str, float] = {}
    for curve, extent in zip(curves, ranges, strict=True):
        share[curve.joint] = max(share.get(curve.joint, 0.0), extent / (widest[curve.panel] or 1.0))
    free = {c.joint for c in curves if c.panel == "orientation"} & {c.joint for c in curves if c.panel == "position"}
    ranked = sorted(share, key=lambda joint: (not (joint in free and share[joint] > 0.0), -share[joint]))[:MAX_JOINTS]
    while len(ranked) > 1 and max(Counter(c.panel for c in curves if c.joint in ranked).values()) > MAX_LABELS:
        ranked.pop()
    return [joint for joint in share if joint in ranked]


def _label(panel: str, curves: Sequence[JointCurve]) -> str:
    """The label of a panel; the velocities of a free body are along its own axes."""
    is_free = panel in ("turn", "slide") and any(curve.entry for curve in curves)
    return f"{PANELS[panel].removesuffix(')')}, own axes)" if is_free else PANELS[panel]


def draw(axis: Any, t: np.ndarray, curves: Sequence[JointCurve], colours: dict[str, str]) -> None:
    """The curves of a panel; those of one joint differ by their line styles, as do those that an earlier one covers.

    Where all are of one joint they differ by their colours.
    """
    drawn: dict[str, int] = {}
    span = max((float(np.ptp(curve.values)) for curve in curves), default=0.0)
    for i, curve in enumerate(curves):
        entry = drawn.setdefault(curve.joint, 0)
        drawn[curve.joint] += 1
        single = len(colours) == 1
        style: Any = STYLES[0 if single else entry]
        if any(np.abs(curve.values - other.values).max() <= COVERS * span for other in curves[:i]):
            style = (0, (5, 5)) if style == "-" else style
        name = f"{curve.joint} {curve.entry}".rstrip()
        axis.plot(t, curve.values, linestyle=style, color=COLOURS[entry] if single else colours[curve.joint],
                  label=plain(name))  # fmt: skip
    low, high = axis.get_ylim()
    if span < NOISE and low < high:
        middle = (low + high) / 2.0
        axis.set_ylim(min(low, middle - NOISE), max(high, middle + NOISE))


def _draw_energy(axis: Any, t: np.ndarray, energy: np.ndarray) -> None:
    axis.plot(t, energy - energy[0], color="0.2")
    axis.set_ylabel("energy change\n(J)")
    place = {"transform": axis.transAxes, "ha": "right", "va": "bottom"}
    axis.text(1.0, 1.0, f"from {energy[0]:.4g} J", fontsize=NAME_SIZE, color="0.4", **place)


def _mark_events(axes: Sequence[Any], events: Sequence[tuple[float, str]]) -> None:
    """A line at each of the first events in all panels, and above the first panel their kinds, where they have room."""
    first, last = axes[0].get_xlim()
    width = axes[0].get_figure().get_figwidth() * 72 * AXIS_SHARE
    free = -np.inf  # from where on there is room for a name
    for t, kind in events[:MAX_EVENTS]:
        for axis in axes:
            axis.axvline(t, color="0.6", linewidth=0.6, linestyle=(0, (1, 2)), zorder=0.5, label="_event")
        end = t + (len(kind) * LETTER * NAME_SIZE / width + NAME_GAP) * (last - first)
        if t >= free and end <= last:
            free = end
            axes[0].annotate(plain(kind), (t, 1.0), xycoords=("data", "axes fraction"), xytext=(0, 2), color="0.4",
                             fontsize=NAME_SIZE, textcoords="offset points")  # fmt: skip


def _draw_error(error_axis: Any, t: np.ndarray, error: np.ndarray | None, label: str) -> None:
    error_axis.set(xlabel="time t (s)", ylabel=label)
    if error is None or not error.any():
        place = {"transform": error_axis.transAxes, "ha": "center", "va": "center"}
        error_axis.text(0.5, 0.5, "not verified" if error is None else "none seen", color="0.4", **place)
        error_axis.set_yticks([])
    else:
        positive = error > 0
        error_axis.semilogy(t[positive], error[positive], color=COLOURS[5])
        low, high = np.floor(np.log10(error[positive].min())), np.ceil(np.log10(error.max()))
        error_axis.set_ylim(10.0**low, 10.0 ** max(high, low + 1))  # whole decades, and no names between them
        error_axis.tick_params(which="minor", left=True, labelleft=False)


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
    drawn, widths = list(curves_of(robot, q, v, t)), tube(robot, q, v, *along)
    joints = those_that_move_most(drawn)
    panels = [name for name in PANELS if any(c.panel == name and c.joint in joints for c in drawn)]
    figure, axes, colours = _with_panels(t, drawn, joints, panels, [*[2.0] * len(panels), 1.8])
    for curve, width in zip(drawn, widths, strict=True):
        if curve.joint in colours:
            axes[panels.index(curve.panel), 0].fill_between(
                t, curve.values - width, curve.values + width, color=colours[curve.joint], alpha=0.25, linewidth=0
            )
    _draw_moves(axes[-1, 0], t, moves, unit_of(robot.joints))
    figure.suptitle(plain(title))
    label_right(figure, axes[:, 0])
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


def _draw_moves(axis: Any, t: np.ndarray, moves: Mapping[str, np.ndarray], unit: str) -> None:
    """Draw the distance by which each parameter moves the motion, for those that move it the most."""
    largest = {name: float(move.max(initial=0.0)) for name, move in moves.items()}
    names = sorted(moves, key=lambda name: -largest[name])[:MAX_NAMES]
    for name, colour in zip(names, COLOURS, strict=False):
        positive = moves[name] > SMALLEST * max(largest.values())
        if positive.any():
            axis.semilogy(t[positive], moves[name][positive], color=colour, label=plain(name))
    axis.set(xlabel="time t (s)", ylabel=f"motion moved by\n({unit})")
