"""A trajectory of any simulator: read from arrays and files, in SI units, and how exact its digits are."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from twolink.dynamics import Robot
from twolink.errors import SceneError
from twolink.robots.joint_layout import angular_dofs, read_columns
from twolink.robots.log_columns import in_our_names, read_log_table
from twolink.simulation.trajectory import Trajectory

Array = np.ndarray
Given = Trajectory | Mapping[str, ArrayLike] | Sequence[ArrayLike] | str | os.PathLike[str]
FULL = 15  # significant digits, from which on a number is as exact as a double
DEGREE = math.pi / 180
BOTH = "q and v are in degrees"
ENOUGH = 10  # different numbers, which show to how many digits a log was written


@dataclass(frozen=True, eq=False)
class TrajectoryLog:
    """A trajectory: t (n,), q (n, nq), v (n, nv), NaN where the log has no velocities.

    guessed: which columns were taken for t, q and v, where they have other names.
    """

    t: Array
    q: Array
    v: Array
    guessed: tuple[str, ...] = ()

    def part(self, rows: Array) -> TrajectoryLog:
        """Some of its samples."""
        return TrajectoryLog(self.t[rows], self.q[rows], self.v[rows])

    @property
    def has_velocities(self) -> bool:
        """True if the log has velocities."""
        return not np.isnan(self.v).any()

    def digits(self) -> tuple[Array, Array]:
        """Bounds on the errors of q and v from rounding when the log was written, (n,) each, rad or m, and a second.

        Rounded times count as well: the motion goes on between a time and its rounded one.
        """
        if not self.has_velocities:
            return np.asarray(rounding(self.q).max(axis=1)), np.zeros(len(self.t))
        late = _rounded_times(self.t)
        fastest, steepest = np.abs(self.v).max(axis=1), np.abs(np.gradient(self.v, self.t, axis=0)).max(axis=1)
        return rounding(self.q).max(axis=1) + late * fastest, rounding(self.v).max(axis=1) + late * steepest


def rounding(values: Array) -> Array:
    """Half a unit of the last digit that was written, of each number; 0 of numbers in full.

    The digits are those of the most exact number: so many after the point, and so many significant ones. Numbers in
    single precision have 24 bits.
    """
    different = np.unique(values[values != 0.0])
    if len(different) < ENOUGH:
        return np.zeros_like(values)
    with np.errstate(over="ignore"):
        if np.array_equal(different, different.astype(np.float32)):
            return np.asarray(np.abs(values) * 2.0**-24)
    some = np.abs(different[:: max(1, len(different) // 500)])
    written = [np.format_float_scientific(x, trim="-").split("e") for x in some]
    significant = max(len(mantissa.replace(".", "")) for mantissa, _ in written)
    if significant >= FULL:
        return np.zeros_like(values)
    after = max(len(mantissa.replace(".", "")) - 1 - int(exponent) for mantissa, exponent in written)
    with np.errstate(divide="ignore"):
        first = np.where(values == 0.0, -np.inf, np.floor(np.log10(np.abs(values))))
    return np.asarray(0.5 * np.maximum(10.0**-after, 10.0 ** (first + 1 - significant)))


def _rounded_times(t: Array) -> float:
    """By how much times may be rounded, s: of those that are equally spaced but for their digits."""
    gaps = np.diff(t)
    apart = float(np.abs(gaps - np.median(gaps)).max())
    unit = 2.0 * float(rounding(t).min())
    return 0.5 * unit if 1e-9 * float(np.median(gaps)) < apart <= 1.001 * unit else 0.0


def read_log(given: Given, robot: Robot) -> TrajectoryLog:
    """The trajectory as arrays. Raises SceneError (code "not-a-trajectory")."""
    label = "trajectory"
    if isinstance(given, Trajectory):
        if len(given.t) < 2:
            raise _no_trajectory(f"expected two samples or more, got {len(given.t)}", label)
        return TrajectoryLog(given.t, given.q, given.v)
    if isinstance(given, str | os.PathLike):
        label = os.fspath(given)
        table: Mapping[str, Any] = read_log_table(Path(given))
    elif isinstance(given, Mapping):
        table = given
    elif isinstance(given, Sequence | np.ndarray):
        table = dict(zip(("t", "q", "v"), given, strict=False))
    else:
        raise SceneError(f"expected a run, a file, arrays by name or (t, q, v), got {type(given).__name__}",
                         argument=label, remedy="such as (t, q, v)", code="not-a-trajectory")  # fmt: skip
    for name, column in table.items():
        try:
            np.asarray(column)
        except ValueError:
            raise _no_trajectory(f"column {name!r} has rows of different lengths", label) from None
    table, guessed = in_our_names(table, robot)
    t = np.asarray(table.get("t", []), dtype=float)
    arrays = {}
    for name, size in (("q", robot.nq), ("v", robot.nv)):
        values, lacking = read_columns({k: np.asarray(x) for k, x in table.items()}, robot.joints, name)
        if values is None and name == "q":
            columns = [table.get(f"q{i}") for i in range(robot.nv)]  # one a joint
            values = None if any(column is None for column in columns) else np.column_stack(columns)  # type: ignore[arg-type]
        if values is None and name == "v" and len(lacking) == size:
            arrays[name] = np.full((len(t), size), np.nan)
            continue
        values = np.atleast_2d(np.asarray(np.nan if values is None else values, dtype=float))
        if name == "q" and values.shape[1] == robot.nv < robot.nq:
            entries = [np.stack([j.entries("q", x) for x in values[:, j.v]]) for j in robot.joints]
            values = np.concatenate(entries, axis=1)
        arrays[name] = values
        if values.shape[1:] != (size,) or not np.isfinite(values).all():
            raise _no_trajectory(f"expected {name} (n, {size}), finite", label)
    if t.shape != (len(arrays["q"]),) or len(t) < 3 or not np.all(np.diff(t) > 0) or t[0] < 0:
        raise _no_trajectory("expected three increasing times or more, from 0 on", label)
    if len(arrays["v"]) != len(t):
        raise _no_trajectory("q and v are not equally long", label)
    return TrajectoryLog(t, robot.normalize(arrays["q"]), arrays["v"], guessed)


def _no_trajectory(what: str, label: str) -> SceneError:
    remedy = "give t, q.JOINT and v.JOINT in SI units, as run.save writes them"
    return SceneError(what, where=label, remedy=remedy, argument="trajectory", code="not-a-trajectory")


def in_si(log: TrajectoryLog, robot: Robot, start: Array) -> tuple[TrajectoryLog, str]:
    """The trajectory in seconds and radians, and which units it had, "" for those. start (nq,): of the scene."""
    unit_free = all(joint.normalized is None for joint in robot.joints)  # where entries of q are those of v
    turns = _angles(robot)
    if log.has_velocities:
        rates, means = robot.difference(log.q[:-1], log.q[1:]) / np.diff(log.t)[:, None], 0.5 * (log.v[1:] + log.v[:-1])
        if abs(_slope(rates, means) / 1e-3 - 1) < 0.1:
            return TrajectoryLog(log.t / 1e3, log.q, log.v), "t is in milliseconds"
        slope = _slope(rates[:, turns], means[:, turns])
        if unit_free and abs(slope * DEGREE - 1) < 0.1:
            return TrajectoryLog(log.t, _turned(log.q, turns), log.v), "q is in degrees"
        if abs(slope / DEGREE - 1) < 0.1:
            return TrajectoryLog(log.t, log.q, _turned(log.v, turns)), "v is in degrees per second"
    away = np.abs(robot.difference(start, log.q[0])).max()
    if unit_free and away > 1e-3 and np.abs(_turned(log.q[0], turns) - start).max() < 1e-2 * away:
        return in_radians(log, robot), BOTH
    return log, ""


def in_radians(log: TrajectoryLog, robot: Robot) -> TrajectoryLog:
    """The trajectory of a robot whose entries of q are those of v, in radians for degrees; lengths stay."""
    turns = _angles(robot)
    return TrajectoryLog(log.t, _turned(log.q, turns), _turned(log.v, turns))


def _angles(robot: Robot) -> Array:
    """Flags, true of the entries of v that are angles a second (nv,)."""
    return np.isin(np.arange(robot.nv), [joint.v.start + k for joint in robot.joints for k in angular_dofs(joint)])


def _turned(values: Array, turns: Array) -> Array:
    return np.where(turns, values * DEGREE, values)


def _slope(rates: Array, means: Array) -> float:
    """Rates of q as a multiple of v; 1 where they do not follow v at all."""
    moving = float(np.vdot(means, means))
    slope = float(np.vdot(rates, means)) / moving if moving > 0 else 1.0
    return slope if np.linalg.norm(rates - slope * means) < 0.2 * np.linalg.norm(rates) else 1.0
