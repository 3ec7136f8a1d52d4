"""Log files as robots write them: names of columns, units, gears, fewer samples; what is odd in them is named.

A map of columns is TOML: ours = theirs, theirs a name or a table with a factor (a gear, a constant) and an offset:

    t = "stamp"
    q.elbow = "enc_2"
    tau.elbow = { column = "current_2", scale = 2.76, offset = 0.0 }
    coupling = [[1, 0], [1, 1]]     # v_joint = C v_motor, where the log is of motors
"""

import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from twolink.dynamics import Robot
from twolink.dynamics.arguments import array
from twolink.errors import QueryError, require_known
from twolink.identification.measurements import GAP, measurements_of
from twolink.io.tables import read_table
from twolink.io.text import read_text

_TURN = 2 * np.pi
UNITS: dict[str, tuple[str, float]] = {
    "rad": ("qva", 1.0), "deg": ("qva", _TURN / 360), "turn": ("qva", _TURN), "rpm": ("v", _TURN / 60),
    "s": ("t", 1.0), "ms": ("t", 1e-3), "us": ("t", 1e-6), "ns": ("t", 1e-9),
    "Nm": ("tau", 1.0), "mNm": ("tau", 1e-3), "A": ("tau", 1.0),
}  # fmt: skip
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
        The map of columns, or a TOML file of it; what it does not name keeps its name.
    units : sequence of str
        Of `rad deg turn` (q, v, a), `rpm` (v), `s ms us ns` (t), `Nm mNm A` (tau). "A": look for "motor_constant", or
        give it as the scale.
    decimate : int
        So many samples become their mean.

    Returns
    -------
    Log

    Raises
    ------
    QueryError
        A column is missing (code "column-missing"), a unit is unknown, `columns` is no such map.
    TwolinkError
        The file cannot be read.
    """
    where = Path(path)
    found = dict(read_table(where)[0])
    mapped = _map_of(columns)
    coupling = mapped.pop("coupling", None)
    for ours, theirs in _flat(mapped):
        entry = theirs if isinstance(theirs, Mapping) else {"column": theirs}
        require_known(entry.get("column"), found, QueryError, f"{where}: there is no column {{!r}}", argument="columns",
                      code="column-missing")  # fmt: skip
        found[ours] = np.asarray(found[entry["column"]]) * entry.get("scale", 1.0) + entry.get("offset", 0.0)
    for unit in units:
        require_known(unit, UNITS, QueryError, "the unit {!r} is unknown", argument="units")
        letters, factor = UNITS[unit]
        for name in found:
            letter = name.partition(".")[0].rstrip("0123456789")
            if letter == letters or (letters == "qva" and letter in ("q", "v", "a")):
                found[name] = np.asarray(found[name]) * factor
    read = measurements_of(robot, found, str(where))
    table = {name: np.array(x, dtype=float) for name, x in read.items() if x is not None}
    if coupling is not None:
        matrix = array("coupling", coupling, robot.nv)
        table |= {name: table[name] @ matrix.T for name in ("q", "v", "a") if name in table}
        table["tau"] = table["tau"] @ np.linalg.inv(matrix)
    if "run" in found:
        table["run"] = np.asarray(found["run"], dtype=float)
    notes = [*_clock(table["t"]), *_spikes(robot, table)]
    if decimate > 1:
        count = len(table["t"]) // decimate
        blocks = {k: x[: count * decimate].reshape(count, decimate, *x.shape[1:]) for k, x in table.items()}
        within = np.ptp(blocks.get("run", np.zeros((count, 1))), axis=1) == 0  # one run
        table = {k: x[within].mean(axis=1) for k, x in blocks.items()}
        table["q"] = np.asarray(robot.normalize(table["q"]))
        notes.append(f"{decimate} samples each became their mean")
    return Log(table, tuple(f"{where}: {note}" for note in notes))


def _map_of(columns: Mapping[str, Any] | str | Path | None) -> dict[str, Any]:
    """The map of columns. Raises QueryError (code "not-toml")."""
    if columns is None or isinstance(columns, Mapping):
        return dict(columns or {})
    try:
        return tomllib.loads(read_text(Path(columns), QueryError, 2**20, "keep a map of columns"))
    except tomllib.TOMLDecodeError as error:
        raise QueryError(f"not TOML: {error}", where=str(columns), remedy="check that line", code="not-toml") from None


def _flat(mapped: Mapping[str, Any], before: str = "") -> list[tuple[str, Any]]:
    """Names with dots, and what each is: a name or a table with a column."""
    entries: list[tuple[str, Any]] = []
    for name, value in mapped.items():
        nested = isinstance(value, Mapping) and "column" not in value
        entries += _flat(value, f"{before}{name}.") if nested else [(before + name, value)]
    return entries


def _clock(t: np.ndarray) -> list[str]:
    """What is odd in the times."""
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
                notes.append(
                    f"{odd.sum()} outliers of {name}{k} ({robot.name}) were replaced by their neighbours' median"
                )
    return notes
