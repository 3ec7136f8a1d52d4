"""Log files as robots write them: a map of columns, units, fewer samples; what is odd in them is named."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from twolink.dynamics import Robot
from twolink.dynamics.arguments import array
from twolink.errors import QueryError
from twolink.parts.identification.column_map import convert, map_of, mapped_columns
from twolink.parts.identification.measurements import GAP, measurements_of
from twolink.robots.log_columns import read_log_table

_JITTER = 0.02  # of the usual step, from which it is named
_SPIKE, _BEYOND, _COUNTS = 10.0, 3.0, 4.0  # times usual deviations, the range of the neighbours, the finest step


class Log(NamedTuple):
    """Arrays t, q, v, a and tau of a file, as `identify` takes them, and what was odd in it, in words."""

    table: dict[str, np.ndarray]
    notes: tuple[str, ...]


def read_log(
    robot: Robot, path: str | Path, columns: Mapping[str, Any] | str | Path | None = None,
    units: Sequence[str] = (), decimate: int = 1,
) -> Log:  # fmt: skip
    """Read a log.

    Parameters
    ----------
    robot : Robot
    path : str or path
        A .csv, .parquet, .npz or .mat file, or a bag of ROS 2 (.mcap, .db3).
    columns : mapping, str or path, optional
        The map of columns (`identification.column_map`), or a TOML file of it. What it names wins; what it does not
        name is read by its own name. No column is read twice, and `notes` has those that are not read.
    units : sequence of str
        Of `rad deg turn` (angles of q, v, a), `rpm` (v), `s ms us ns` (t), `Nm mNm A` (tau). "A": look for
        "motor_constant", or give it as the scale.
    decimate : int
        So many samples become their mean.

    Returns
    -------
    Log

    Raises
    ------
    QueryError
        A column is missing (code "column-missing") or read twice (code "column-twice"), a unit is unknown, `columns`
        is no such map.
    TwolinkError
        The file cannot be read.
    """
    where = Path(path)
    entries, coupling = map_of(columns)
    found, guessed, unread = mapped_columns(robot, read_log_table(where), entries, str(where))
    for unit in units:
        convert(robot, found, unit)
    read = measurements_of(robot, found, str(where))
    table = {name: np.array(x, dtype=float) for name, x in read.items() if x is not None}
    if coupling is not None:
        matrix = array("coupling", coupling, robot.nv)
        if robot.nq != robot.nv:
            raise QueryError("a joint of this robot has (cos, sin) or several coordinates, which do not add up",
                             argument="coupling", remedy="couple the columns of the log before")  # fmt: skip
        table |= {name: table[name] @ matrix.T for name in ("q", "v", "a") if name in table}
        table["tau"] = table["tau"] @ np.linalg.inv(matrix)
    if "run" in found:
        table["run"] = np.asarray(found["run"], dtype=float)
    notes = [f"read: {'; '.join(guessed)}"] if guessed else []
    notes += [f"columns that are not read: {', '.join(unread)}"] if unread else []
    notes += [*_clock(table["t"]), *_spikes(robot, table)]
    if decimate > 1:
        count = len(table["t"]) // decimate
        blocks = {k: x[: count * decimate].reshape(count, decimate, *x.shape[1:]) for k, x in table.items()}
        for joint in robot.joints:  # a quaternion and its negative are the same
            if joint.kind in ("quaternion", "free-flyer"):
                part = blocks["q"][..., joint.normalized]
                part *= np.where(np.sum(part * part[:, :1], axis=-1, keepdims=True) < 0.0, -1.0, 1.0)
        within = np.ptp(blocks.get("run", np.zeros((count, 1))), axis=1) == 0  # one run
        table = {k: x[within].mean(axis=1) for k, x in blocks.items()}
        table["q"] = np.asarray(robot.normalize(table["q"]))
        notes.append(f"{decimate} samples each became their mean")
    return Log(table, tuple(f"{where}: {note}" for note in notes))


def _clock(t: np.ndarray) -> list[str]:
    """Notes on irregular steps between the times."""
    steps = np.diff(t)
    steps = steps[(steps > 0) & (steps < GAP * np.median(steps))]
    usual = float(np.median(steps)) if len(steps) else 0.0
    spread = float(np.sqrt(np.mean((steps - usual) ** 2))) if usual > 0 else 0.0
    if spread <= _JITTER * usual:
        return []
    return [f"the clock's steps are {usual:.4g} s, with a jitter of {spread:.2g} s, {steps.min():.4g} to "
            f"{steps.max():.4g} s"]  # fmt: skip


def _spikes(robot: Robot, table: dict[str, np.ndarray]) -> list[str]:
    """Replace samples that lie far from their four neighbours by the neighbours' median, in place; name how many."""
    notes = []
    for name in ("q", "v", "tau"):
        for k, x in enumerate(table[name].T if name in table and len(table["t"]) > 20 else ()):
            near = np.stack([x[i : len(x) - 4 + i] for i in (0, 1, 3, 4)])
            middle, off = np.median(near, axis=0), np.abs(x[2:-2] - np.median(near, axis=0))
            counts = np.abs(np.diff(x))
            finest = counts[counts > 0].min(initial=np.inf)
            limit = np.maximum(_SPIKE * np.quantile(off, 0.9), _BEYOND * np.ptp(near, axis=0))
            odd = off > np.maximum(limit, _COUNTS * finest)
            if odd.any():
                x[2:-2][odd] = middle[odd]
                which = f"{odd.sum()} outliers of {name}{k} ({robot.name})"
                notes.append(f"{which} were replaced by their neighbours' median")
    return notes
