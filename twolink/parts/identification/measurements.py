"""Measurements of motions: checked arrays and data files of one run or several; filtered samples of them."""

from __future__ import annotations

import itertools
import string
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from twolink.dynamics import Robot
from twolink.dynamics.arguments import array, configuration, positive
from twolink.errors import QueryError
from twolink.io.tables import in_seconds, read_table
from twolink.parts.identification.base_parameters import Selection
from twolink.parts.identification.drift import spans
from twolink.parts.identification.filtering import Filter, Recording, states
from twolink.parts.identification.units import check_units
from twolink.robots.joint_layout import read_columns

_LARGEST = 1e100  # of torques and of the regressor: squares and their ratios stay within the range of doubles
_NARROWER = 0.7  # a window is compared with one wider by 1 / 0.7: errors of a grow with its fourth power
_STATES = 4  # of a block of samples
_NO_TORQUE = 1e-12  # of the torques of single parameters: rounding
_SLOW, _HIDDEN = 10, 3.0  # of so many samples the slowest; speeds within so many deviations have no sign
GAP = 20.0  # times the usual step of time, from which it is a jump


@dataclass(frozen=True)
class Measurements:
    """Samples t (n,), q (n, nq), v, a, tau (n, nv) of all runs.

    block: so many samples that follow each other are averaged, columns of the regressor and torques alike.
    ends: where each run ends. coarse: the same samples by a wider window, for the filter's error.
    """

    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    tau: np.ndarray
    ends: tuple[int, ...]
    block: int = 1
    coarse: Measurements | None = None

    def states(self, size: int = 2_000) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """(q, v, a) in parts of at most `size` samples."""
        for i in range(0, len(self.t), size):
            yield self.q[i : i + size], self.v[i : i + size], self.a[i : i + size]

    @property
    def width(self) -> np.ndarray:
        """The speeds (nv,) that cannot be told from rest: the filter's error, usual or where joints are slow."""
        if self.coarse is None:
            return np.zeros(self.v.shape[1])
        slow = np.argsort(np.abs(self.coarse.v), axis=0)[: -(-len(self.v) // _SLOW)]
        off = np.abs(self.v - self.coarse.v)
        of_slow = np.sqrt(np.mean(np.take_along_axis(off, slow, axis=0) ** 2, axis=0))
        return np.asarray(_HIDDEN * np.maximum(of_slow, np.median(off, axis=0)))  # encoders at rest have no noise

    def averaged(self, x: np.ndarray) -> np.ndarray:
        """Means of x (n, ...) over blocks of samples, within each run."""
        if self.block == 1:
            return x
        runs = (x[rows] for rows in spans(self.ends))
        counts = ((len(run) // self.block, run) for run in runs)
        parts = [run[: n * self.block].reshape(n, self.block, *x.shape[1:]) for n, run in counts]
        return np.concatenate([part.mean(axis=1) for part in parts])

    @property
    def block_ends(self) -> list[int]:
        """The blocks behind which the runs end, as `averaged` leaves them."""
        return [int(end) for end in np.cumsum(np.diff((0, *self.ends)) // self.block)]


def recordings(
    robot: Robot, t: Any, q: ArrayLike | None, v: ArrayLike | None, tau: ArrayLike | None, a: ArrayLike | None = None
) -> tuple[Recording, ...]:
    """Checked runs: arrays of one, or in place of t a run or several as tables or paths.

    Raises
    ------
    QueryError
        For wrong shapes or values that are not finite; codes "times", "constant-data", "column-missing" and "units".
    """
    if q is not None and tau is not None:
        return (_recording(robot, t, q, v, tau, a),)
    if q is not None or tau is not None or v is not None or a is not None:
        raise QueryError("expected t, q and tau, or runs alone", argument="t", remedy="give identify(robot, runs)")
    tables = list(t) if isinstance(t, list | tuple) else [t]
    if not tables:
        raise QueryError("there are no runs", argument="t", remedy="give some", code="too-few-samples")
    parts = [part for number, table in enumerate(tables) for part in _parts(table, number)]
    runs = tuple(_recording(robot, **measurements_of(robot, part, where)) for part, where in parts)
    if len({(run.v is None, run.a is None) for run in runs}) > 1:
        raise QueryError("some runs have v or a, and some have not", argument="t", code="column-missing",
                         remedy="give all runs the same columns")  # fmt: skip
    return runs


def _parts(table: Any, number: int) -> list[tuple[dict[str, np.ndarray], str]]:
    """The runs of a table by its column `run`, each with its name; the whole where there is none."""
    where = str(table) if isinstance(table, str | Path) else f"run {number}"
    columns = table_columns(table)
    if "run" not in columns:
        return [(columns, where)]
    numbers = columns.pop("run")
    cuts = np.flatnonzero(numbers[1:] != numbers[:-1]) + 1
    return [({name: np.asarray(x)[rows] for name, x in columns.items()}, f"{where}, run {numbers[rows[0]]:g}")
            for rows in np.split(np.arange(len(numbers)), cuts)]  # fmt: skip


def _recording(
    robot: Robot, t: ArrayLike, q: ArrayLike, v: ArrayLike | None, tau: ArrayLike, a: ArrayLike | None
) -> Recording:
    times = checked_times(t)
    given = {"q": configuration("q", q, robot.nq, robot.joints), "tau": array("tau", tau, robot.nv)}
    given |= {name: array(name, x, robot.nv) for name, x in (("v", v), ("a", a)) if x is not None}
    for name, x in given.items():
        if x.shape != (len(times), x.shape[-1]):
            raise QueryError(f"expected shape ({len(times)}, {x.shape[-1]}), got {x.shape}", argument=name,
                             remedy="give one row for each of the times t")  # fmt: skip
    if v is None and a is not None:
        raise QueryError("accelerations came without velocities", argument="v", remedy="give v, or leave a out too")
    if np.ptp(given["q"], axis=0).max() == 0.0 and not any(np.ptp(given[k]) for k in ("v", "a") if k in given):
        raise QueryError("the robot never moves: all samples are the same", argument="q", code="constant-data",
                         remedy="measure motions, or several poses")  # fmt: skip
    if a is None:
        _require_no_gap(times)
    if v is not None:
        check_units(robot, times, given["q"], given["v"])
    return Recording(times, given["q"], given.get("v"), given.get("a"), given["tau"])


def _require_no_gap(t: np.ndarray) -> None:
    """Refuse a jump in time: nothing is differentiated across it. Raises QueryError (code "times")."""
    steps = np.diff(t)
    if len(steps) and steps.max() > GAP * np.median(steps):
        row = int(np.argmax(steps))
        what = f"time jumps by {steps[row]:.4g} s at t[{row}] = {t[row]:.9g} s, "
        what += f"the usual step is {np.median(steps):.4g} s"
        raise QueryError(what, argument="t", code="times",
                         remedy="give the parts as several runs: a list of tables, or a column `run`")  # fmt: skip


def filtered(robot: Robot, runs: Sequence[Recording], by: Filter | None) -> Measurements:
    """The runs' samples; without measured accelerations filtered by a window, and by a wider one.

    Blocks of a quarter of the window are averaged, which its cut-off allows: the torques of all samples, the states at
    a few of each block.
    """
    if by is None:
        return _joined([(run.t, run.q, run.v, run.a, run.tau) for run in runs], 1)
    wide, block = wider(by.half_window), max(1, by.half_window // 2)
    step = max(1, (block // _STATES - 1) // 2 * 2 + 1)  # an odd number of samples, whose middle has the state
    at = [np.arange(wide + step // 2, len(run.t) - wide - step // 2, step) for run in runs]
    tau = [np.lib.stride_tricks.sliding_window_view(run.tau, step, axis=0)[rows - step // 2].mean(axis=-1)
           for run, rows in zip(runs, at, strict=True)]  # fmt: skip
    two = []
    for half in (by.half_window, wide):
        moved = [states(robot, run, half, by.source, rows) for run, rows in zip(runs, at, strict=True)]
        parts = [(run.t[rows], *state, y) for run, rows, state, y in zip(runs, at, moved, tau, strict=True)]
        two.append(_joined(parts, block // step))
    return replace(two[0], coarse=two[1])


def linear_system(robot: Robot, chosen: Selection, data: Measurements) -> tuple[np.ndarray, np.ndarray]:
    """G (n, nv, k) and y (n, nv) of y = G theta: y is without the torques of what is not looked for."""
    columns, known = zip(*(chosen.system(robot, *state) for state in data.states()), strict=True)
    both = data.averaged(np.concatenate(columns)), data.averaged(data.tau - np.concatenate(known))
    largest = max(float(np.abs(x).max(initial=0.0)) for x in both)
    if not largest <= _LARGEST:
        raise QueryError(f"numbers of the size {largest:.3g} cannot be used", where="identify", code="units",
                         remedy="give SI units and radians")  # fmt: skip
    return both


def require_enough(robot: Robot, parts: np.ndarray, y: np.ndarray, data: Measurements) -> None:
    """Require torques that tell r parameters.

    Parameters
    ----------
    robot : Robot
    parts : ndarray, (n, nv, r)
        The torques of each parameter, at its value in the robot.
    y : ndarray, (n, nv)
        What they are to add up to.
    data : Measurements

    Raises
    ------
    QueryError
        Codes "too-few-samples", "nothing-identifiable", and "no-torques": G theta = 0 tells theta up to a factor.
    """
    if y.size <= parts.shape[-1]:
        raise QueryError(f"{y.size} torques at {len(data.t)} samples are too few for {parts.shape[-1]} parameters",
                         argument="t", code="too-few-samples",
                         remedy="measure longer, or look for fewer parameters")  # fmt: skip
    if not parts.shape[-1]:
        raise QueryError("no torque in these data depends on the parameters, beyond the errors of the filter",
                         argument="q", code="nothing-identifiable",
                         remedy="measure a motion that moves those links more")  # fmt: skip
    if max(np.abs(data.tau).max(), np.abs(y).max()) <= _NO_TORQUE * np.abs(parts).max():
        what = "all torques are 0, and without torques only ratios of parameters are determined, not all of them"
        mass = next(name for name in reversed(robot.parameter_names) if name.endswith(".mass"))
        remedy = f'keep some as they are, such as by parameters=["{mass}"], or give a log with torques'
        raise QueryError(what, argument="tau", remedy=remedy, code="no-torques")


def _joined(parts: Sequence[tuple[Any, ...]], block: int) -> Measurements:
    """The samples (t, q, v, a, tau) of all runs."""
    t, q, v, a, tau = (np.concatenate(x) for x in zip(*parts, strict=True))
    return Measurements(t, q, v, a, tau, tuple(np.cumsum([len(part[0]) for part in parts]).tolist()), block)


def probability(confidence: Any) -> float:
    """A confidence as a float above 0 and below 1. Raises QueryError."""
    value = positive(confidence, "confidence", QueryError, "such as 0.95", expected="a probability")
    if value >= 1.0:
        raise QueryError(f"expected a probability, got {confidence!r}", argument="confidence", remedy="such as 0.95")
    return value


def wider(half: int) -> int:
    """The half window that shows the error of this one."""
    return max(half + 1, round(half / _NARROWER))


def checked_times(t: ArrayLike) -> np.ndarray:
    """Increasing times (n,), s. Raises QueryError, codes "times" and "too-few-samples"."""
    times = array("t", t, np.shape(t)[-1] if np.ndim(t) else 1)
    if times.ndim != 1:
        raise QueryError(f"expected shape (n,), got {times.shape}", argument="t",
                         remedy="give one time for each sample")  # fmt: skip
    if not len(times):
        raise QueryError("there are no samples", argument="t", remedy="give some", code="too-few-samples")
    steps = np.diff(times)
    if np.any(steps <= 0):
        row = int(np.argmax(steps <= 0)) + 1
        raise QueryError(f"t[{row}] = {times[row]:.9g} s does not come after t[{row - 1}] = {times[row - 1]:.9g} s",
                         argument="t", code="times",
                         remedy="sort the samples by time and drop repeated ones")  # fmt: skip
    if len(steps) and not 1e-12 < steps.min() <= steps.max() < 1e12:
        raise QueryError(f"steps are between {steps.min():.3g} s and {steps.max():.3g} s", argument="t", code="times",
                         remedy="give seconds")  # fmt: skip
    return times


def table_columns(measurements: Any) -> dict[str, np.ndarray]:
    """The columns by name."""
    if isinstance(measurements, str | Path):
        return dict(read_table(Path(measurements))[0])
    if isinstance(measurements, Mapping):
        return {str(name): in_seconds(np.asarray(values)) for name, values in measurements.items()}
    columns = getattr(measurements, "columns", None)  # of a DataFrame of any library
    if columns is not None and not callable(columns) and hasattr(measurements, "__getitem__"):
        return {str(name): in_seconds(np.asarray(measurements[name])) for name in columns}
    raise QueryError(f"expected a table, got {type(measurements).__name__}", argument="measurements",
                     remedy='give a DataFrame, a path, or {"t": ..., "q.elbow": ...}')  # fmt: skip


def measurements_of(robot: Robot, content: Mapping[str, np.ndarray], where: str) -> dict[str, Any]:
    """t, q, v, a and tau from columns by name, the arguments of `identify`; where: they are from, for messages.

    Columns are t, then q0, q1, ... or q.JOINT, and so on for v, a and tau, or whole arrays. v and a may be missing.
    Raises QueryError for a missing column (code "column-missing").
    """
    out: dict[str, Any] = {"t": content.get("t")}
    for name in ("q", "v", "a", "tau"):
        out[name], lacking = read_columns(content, robot.joints, name)
        if lacking and (name in ("q", "tau") or len(lacking) < robot.nv):
            raise _missing(where, lacking[0], list(content))
    if out["t"] is None:
        raise _missing(where, "t", list(content))
    for name, values in out.items():
        if np.ndim(values) and len(values) != np.size(out["t"]):
            raise QueryError(f"{name!r} has {len(values)} rows, 't' has {np.size(out['t'])}", where=where,
                             remedy="give a row for each sample", code="column-missing")  # fmt: skip
    return out


def _listed(names: Sequence[str], most: int = 12) -> str:
    """Names in words, those that are numbered as one: "t, q0 to q5"."""
    said = list[str]()
    for stem, group in itertools.groupby(map(str, names), lambda name: name.rstrip(string.digits)):
        members = list(group)
        said += [f"{members[0]} to {members[-1]}"] if len(members) > 2 and members[0] != stem else members
    return ", ".join(said[:most]) + (f" and {len(said) - most} more" if len(said) > most else "")


def _missing(where: str, column: str, there: list[str]) -> QueryError:
    what = f"column {column!r} is missing; there are {_listed(there)}"
    remedy = "name the columns t, q0, q1, ... or q.JOINT, and so on for tau, v and a; or map them (--columns)"
    return QueryError(what, where=where, remedy=remedy, code="column-missing")
