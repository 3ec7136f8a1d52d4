"""judge: how far a trajectory of any simulator is from the solution of a scene, since when, and why."""

from __future__ import annotations

import contextlib
import functools
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from twolink.algorithms.mechanism import mechanism
from twolink.algorithms.motion import Motion
from twolink.algorithms.namespaces import Numbers
from twolink.dynamics import Robot
from twolink.effects.joint_switches import JointStops
from twolink.effects.loops import Loop
from twolink.errors import AccuracyError, SceneError, TwolinkError
from twolink.exchange.local_errors import Cause, Intervals, Log, causes_of, intervals_of
from twolink.io.tables import read_table
from twolink.robots.joint_layout import read_columns
from twolink.scenes import Scene
from twolink.show.figure import Plotted, plot_lines
from twolink.simulation.scene_run import simulate
from twolink.simulation.text import Result
from twolink.simulation.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DISTANCES = (1e-6, 1e-4, 1e-3, 1e-2, 0.1)  # rad or m
EXPLAINS = 0.5  # a cause leaves at most this share unexplained
SHOWN = 3  # causes
Given = Trajectory | Mapping[str, ArrayLike] | Sequence[ArrayLike] | str | os.PathLike[str]


@dataclass(frozen=True, repr=False)
class Verdict(Plotted, Result):
    """What a trajectory is worth.

    Attributes
    ----------
    right : bool
        Whether it is within the tolerance of the solution, error bar included, at every sample, its velocity within
        100 times as much a second.
    t : ndarray (n,)
        Its samples, s.
    distance : ndarray (n,)
        From the solution, max |difference(q, q_solution)|, rad or m.
    bar : ndarray (n,)
        How far the solution itself may be off, rad or m.
    beyond : mapping of str to float or None
        Since when it is farther off than some distances, s; None: never.
    velocity : float
        The largest distance of v from the solution's, rad/s or m/s.
    defect : float or None
        The largest local defect of v from a sample to the next, rad/s or m/s; None: no interval without events.
    energy : float
        The largest difference of its energy from the solution's, J.
    constraints : mapping of str to float
        How far loops are open, and joints beyond their stops, at most, m or rad.
    causes : tuple of Cause
        What would explain it, best first; empty for a right one.
    scene : str
        The scene's title.
    """

    right: bool
    t: np.ndarray
    distance: np.ndarray
    bar: np.ndarray
    beyond: Mapping[str, float | None]
    velocity: float
    defect: float | None
    energy: float
    constraints: Mapping[str, float]
    causes: tuple[Cause, ...]
    scene: str

    def _figure(self) -> Figure:
        curves = {"distance from the solution": self.distance, "error bar of the solution": self.bar}
        return plot_lines(self.summary, ("t (s)", "rad or m"), self.t, curves, log=True)

    def __str__(self) -> str:
        worst = int(np.argmax(self.distance))
        size = f"at most {self.distance[worst]:.2g} rad or m from the solution, at {self.t[worst]:.4g} s"
        lines = [f"{self.scene}: {'right' if self.right else 'WRONG'}, {size} (known to {self.bar.max():.1e})"]
        lines += [f"  within {name} until {since:.4g} s" for name, since in self.beyond.items() if since is not None]
        if self.defect is not None:
            step = float(np.median(np.diff(self.t)))
            lines.append(f"  local defect at most {self.defect:.2g} rad/s or m/s in a sample of {1e3 * step:.4g} ms")
        lines.append(f"  energy off by at most {self.energy:.2g} J")
        lines += [f"  {name} violated by {value:.2g}" for name, value in self.constraints.items()]
        return "\n".join([*lines, *(f"  cause: {cause}" for cause in self.causes)])

    __repr__ = __str__


def judge(scene: Scene, trajectory: Given, *, tolerance: float = 1e-6, accuracy: float = 1e-9) -> Verdict:
    """Hold a trajectory of any simulator against the solution of a scene.

    Parameters
    ----------
    scene : Scene
        What was to be simulated, from its start.
    trajectory : Trajectory, mapping, sequence, str or path
        t (n,), q (n, nq), v (n, nv), by name or in this order; or a .csv, .npz or .parquet file with columns t, and
        q.JOINT and v.JOINT or q0, q1, ..., v0, ...; or a bag of ROS 2 (.mcap, .db3 or a folder) with joint states. A
        continuous joint may have its angle in place of (cos, sin).
    tolerance : float
        A distance that does not count, rad or m.
    accuracy : float
        Of the solution; where it cannot be kept, the best one is taken.

    Returns
    -------
    Verdict

    Raises
    ------
    SceneError
        The trajectory is none of this robot (code "not-a-trajectory").
    QueryError
        It has one joint's columns twice, by name and by number (code "column-twice").
    AccuracyError
        The scene cannot be solved.
    """
    log, units = _si(_read(trajectory, scene.robot), scene)
    run = best_run(scene, log.t, accuracy)
    if not units:
        log, units = _radians(log, run)
    return verdict_of(scene, log, run, tolerance, units)


def verdict_of(scene: Scene, log: Log, run: Trajectory, tolerance: float, units: Sequence[Cause] = ()) -> Verdict:
    """What a log is worth beside a run at its samples. units: which ones it had, if not SI."""
    log = log.part(np.arange(len(log.t)) < len(run.t))
    bar = np.zeros(len(run.t)) if run.error is None else run.error
    offset = scene.robot.difference(run.q, log.q)
    distance = np.abs(offset).max(axis=1)
    off = distance - bar
    beyond = {f"{limit:g}": _since(run.t, off > limit) for limit in (*DISTANCES, tolerance) if off.max() > limit}
    intervals = intervals_of(scene, log)
    velocity = float(np.abs(log.v - run.v).max())
    right = bool(off.max() <= tolerance and velocity <= 100 * tolerance and not units)
    causes = () if right else (*units, *_causes(scene, log, run, offset, intervals))
    energy = np.abs(np.sum(scene.robot.energy(log.q, log.v), axis=0) - run.energy).max()
    defects = np.full(1, np.nan) if intervals is None else intervals.exact[:, scene.robot.nv :]
    defect = None if np.isnan(defects).all() else float(np.nanmax(np.abs(defects)))
    return Verdict(right, run.t, distance, bar, beyond, velocity, defect, float(energy), _violations(scene, log),
                   causes[:SHOWN], scene.title or scene.robot.name)  # fmt: skip


def _since(t: np.ndarray, beyond: np.ndarray) -> float:
    return float(t[np.argmax(beyond)])


def best_run(scene: Scene, t: np.ndarray, accuracy: float) -> Trajectory:
    """The solution at the samples, as accurate as can be kept."""
    try:
        return simulate(scene, float(t[-1]), accuracy=accuracy, t_eval=t)
    except AccuracyError as error:
        if error.run is None:
            raise
        best: Trajectory = error.run
        return best


def _read(given: Given, robot: Robot) -> Log:
    """The trajectory as arrays. Raises SceneError."""
    label = "trajectory"
    if isinstance(given, Trajectory):
        return Log(given.t, given.q, given.v)
    if isinstance(given, str | os.PathLike):
        label = os.fspath(given)
        table: Mapping[str, Any] = read_table(Path(given))[0]
    elif isinstance(given, Mapping):
        table = given
    else:
        table = dict(zip(("t", "q", "v"), given, strict=False))
    arrays = {}
    for name, size in (("q", robot.nq), ("v", robot.nv)):
        values, _ = read_columns({k: np.asarray(x) for k, x in table.items()}, robot.joints, name)
        if values is None and name == "q":
            values = _numbered(table, name, robot.nv)
        values = np.atleast_2d(np.asarray(np.nan if values is None else values, dtype=float))
        if name == "q" and values.shape[1] == robot.nv < robot.nq:
            values = np.concatenate(
                [np.stack([j.configuration(x) for x in values[:, j.v]]) for j in robot.joints], axis=1
            )
        arrays[name] = values
        if values.shape[1:] != (size,) or not np.isfinite(values).all():
            raise _no_trajectory(f"expected {name} (n, {size}), finite", label)
    t = np.asarray(table.get("t", table.get("time", [])), dtype=float)
    if t.shape != (len(arrays["q"]),) or len(t) < 3 or not np.all(np.diff(t) > 0) or t[0] < 0:
        raise _no_trajectory("expected three increasing times or more, from 0 on", label)
    if len(arrays["v"]) != len(t):
        raise _no_trajectory("q and v are not equally long", label)
    return Log(t, robot.normalize(arrays["q"]), arrays["v"])


def _numbered(table: Mapping[str, Any], name: str, size: int) -> np.ndarray | None:
    """The columns q0, q1, ..., one a joint."""
    columns = [table.get(f"{name}{i}") for i in range(size)]
    return None if any(column is None for column in columns) else np.column_stack(columns)  # type: ignore[arg-type]


def _no_trajectory(what: str, label: str) -> SceneError:
    remedy = "give t, q.JOINT and v.JOINT in SI units, as run.save writes them"
    return SceneError(what, where=label, remedy=remedy, argument="trajectory", code="not-a-trajectory")


def _si(log: Log, scene: Scene) -> tuple[Log, list[Cause]]:
    """The trajectory in seconds and radians, and which units it had."""
    robot, degrees = scene.robot, math.pi / 180
    rates, means = robot.difference(log.q[:-1], log.q[1:]) / np.diff(log.t)[:, None], 0.5 * (log.v[1:] + log.v[:-1])
    moving = float(np.vdot(means, means))
    slope = float(np.vdot(rates, means)) / moving if moving > 0 else 1.0
    follows = moving > 0 and np.linalg.norm(rates - slope * means) < 0.2 * np.linalg.norm(rates)
    unit_free = all(joint.unit is None for joint in robot.joints)
    if follows and abs(slope / 1e-3 - 1) < 0.1:
        return Log(log.t / 1e3, log.q, log.v), [Cause("t is in milliseconds", 0.0)]
    if follows and unit_free and abs(slope * degrees - 1) < 0.1:
        return Log(log.t, log.q * degrees, log.v), [Cause("q is in degrees", 0.0)]
    if follows and abs(slope / degrees - 1) < 0.1:
        return Log(log.t, log.q, log.v * degrees), [Cause("v is in degrees per second", 0.0)]
    start = np.abs(robot.difference(scene.q, log.q[0])).max()
    if unit_free and start > 1e-3 and np.abs(log.q[0] * degrees - scene.q).max() < 1e-2 * start:
        return Log(log.t, log.q * degrees, log.v * degrees), [Cause("q and v are in degrees", 0.0)]
    return log, []


def _radians(log: Log, run: Trajectory) -> tuple[Log, list[Cause]]:
    """The trajectory in radians, where it follows the solution in degrees from a start that is 0 in both."""
    robot, degrees, count = run.robot, math.pi / 180, len(run.t)
    if any(joint.unit is not None for joint in robot.joints):
        return log, []
    apart, converted = (np.linalg.norm(scale * log.q[:count] - run.q) for scale in (1.0, degrees))
    if converted < 1e-2 * apart and apart > 1e-3 * math.sqrt(count):
        return Log(log.t, log.q * degrees, log.v * degrees), [Cause("q and v are in degrees", 0.0)]
    return log, []


def _causes(scene: Scene, log: Log, run: Trajectory, offset: np.ndarray, intervals: Intervals | None) -> list[Cause]:
    """What would explain the distance: a shift in time, another start, or what the local defects show."""
    found = _shifted(log, run, offset)
    unexplained = min((cause.unexplained for cause in found), default=1.0)
    if log.t[0] == 0 and unexplained > 1e-3 and np.abs([*offset[0], *(log.v[0] - scene.v)]).max() > 1e-9:
        with contextlib.suppress(TwolinkError):  # that start may not fit the scene
            other = Scene(scene.base, log.q[0], log.v[0], scene.effects)
            left = scene.robot.difference(simulate(other, float(log.t[-1]), t_eval=log.t).q, log.q)
            apart = f"q by {np.abs(offset[0]).max():.3g}, v by {np.abs(log.v[0] - scene.v).max():.3g}"
            found.append(Cause(f"it starts elsewhere, {apart}", float(np.linalg.norm(left) / np.linalg.norm(offset))))
    if intervals is not None:
        found += causes_of(intervals)
    return sorted((c for c in found if c.unexplained <= EXPLAINS), key=lambda cause: cause.unexplained)


def _shifted(log: Log, run: Trajectory, offset: np.ndarray) -> list[Cause]:
    """A delay in time, by Gauss and Newton's method on the solution; and velocities of another sample."""
    causes, robot = [], run.robot
    rates = robot.difference(log.q[:-1], log.q[1:]) / np.diff(log.t)[:, None]
    means = 0.5 * (log.v[1:] + log.v[:-1])
    plain = np.linalg.norm(rates[1:-1] - means[1:-1])
    for name, other in (("before", means[2:]), ("after", means[:-2])):
        left = float(np.linalg.norm(rates[1:-1] - other) / plain) if plain > 0 else 1.0
        if left < 0.2:
            causes.append(Cause(f"v is that of the sample {name}", left))
    delay, before = 0.0, float(np.linalg.norm(offset))
    apart, inside = offset, np.ones(len(log.t), dtype=bool)
    for _ in range(8):
        inside = (log.t - delay >= run.t[0]) & (log.t - delay <= run.end)
        if inside.sum() < 3 or run.solution is None or before == 0:
            return causes
        q, v = run.at(log.t[inside] - delay)
        apart = robot.difference(q, log.q[inside])
        delay -= float(np.vdot(apart, v) / max(np.vdot(v, v), 1e-300))
    left = float(np.linalg.norm(apart) / np.linalg.norm(offset[inside]))
    words = f"it is {'late' if delay > 0 else 'early'} by {abs(delay):.4g} s"
    return [*causes, Cause(words, left)] if abs(delay) > 1e-9 and left <= EXPLAINS else causes


def _violations(scene: Scene, log: Log) -> dict[str, float]:
    """How far loops are open and joints beyond their stops, where they are."""
    found = {}
    motion = functools.partial(Motion, scene.robot.model, mechanism(scene.robot.model))
    for i, effect in enumerate(scene.effects):
        if isinstance(effect, Loop):
            rows = effect.rows(motion(list(log.q.T), list(log.v.T), log.t, Numbers))
            found[f"effects[{i}] {type(effect).__name__}"] = max(float(np.abs(row).max()) for row in rows)
        if isinstance(effect, JointStops):
            for stop in effect.modes(scene.base):
                beyond = float((-stop.side * (log.q[:, stop.entry] - stop.position)).max())
                if beyond > 0:
                    found[f"stop of {stop.name}"] = max(beyond, found.get(f"stop of {stop.name}", 0.0))
    return found
