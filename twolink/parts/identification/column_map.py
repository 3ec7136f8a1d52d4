"""The map of columns of a log, and its units: from the columns of a file to those that are read.

A map is TOML: ours = theirs, theirs a name or a table with a factor (a gear, a constant) and an offset:

    t = "stamp"
    q.elbow = "enc_2"
    tau.elbow = { column = "current_2", scale = 2.76, offset = 0.0 }
    coupling = [[1, 0], [1, 1]]     # v_joint = C v_motor, where the log is of motors
"""

import tomllib
from collections.abc import Iterable, Mapping
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from twolink.dynamics import Robot
from twolink.errors import QueryError, require_known
from twolink.io.text import read_text
from twolink.robots.joint_layout import JointLayout, angular_dofs, column_forms, columns_to_read, joint_columns
from twolink.robots.log_columns import in_our_names

LETTERS = ("q", "v", "a", "tau")
_TURN = 2 * np.pi
UNITS: dict[str, tuple[str, float]] = {
    "rad": ("qva", 1.0), "deg": ("qva", _TURN / 360), "turn": ("qva", _TURN), "rpm": ("v", _TURN / 60),
    "s": ("t", 1.0), "ms": ("t", 1e-3), "us": ("t", 1e-6), "ns": ("t", 1e-9),
    "Nm": ("tau", 1.0), "mNm": ("tau", 1e-3), "A": ("tau", 1.0),
}  # fmt: skip
_KEYS = ("column", "scale", "offset")


def map_of(columns: Mapping[str, Any] | str | Path | None) -> tuple[list[tuple[str, dict[str, Any]]], Any]:
    """A map of columns as (ours, {column, scale, offset}) in its order, and its coupling. Raises QueryError."""
    if columns is None or isinstance(columns, Mapping):
        mapped = dict(columns or {})
    else:
        try:
            mapped = tomllib.loads(read_text(Path(columns), QueryError, 2**20, "keep a map of columns"))
        except tomllib.TOMLDecodeError as error:
            raise QueryError(f"not TOML: {error}", where=str(columns), remedy="check that line",
                             code="not-toml") from None  # fmt: skip
    coupling = mapped.pop("coupling", None)
    return list(_flat(mapped)), coupling


def _flat(mapped: Mapping[str, Any], before: str = "") -> Iterable[tuple[str, dict[str, Any]]]:
    """Names with dots, and what each is read from. Raises QueryError."""
    for name, value in mapped.items():
        if isinstance(value, Mapping) and "column" not in value:
            yield from _flat(value, f"{before}{name}.")
            continue
        entry = dict(value) if isinstance(value, Mapping) else {"column": value}
        for key, number in entry.items():
            require_known(key, _KEYS, QueryError, f"{before}{name} has an entry {{!r}}", argument="columns")
            if key != "column" and (isinstance(number, bool) or not isinstance(number, int | float)):
                raise QueryError(f"{before}{name}: expected a number, got {number!r:.60}", argument="columns",
                                 remedy=f"such as {key} = 2.76")  # fmt: skip
        yield before + name, entry


def mapped_columns(
    robot: Robot, log: Mapping[str, np.ndarray], entries: Iterable[tuple[str, Mapping[str, Any]]], where: str
) -> tuple[dict[str, np.ndarray], tuple[str, ...], list[str]]:
    """The columns by our names, what was guessed of others, and the names of the log's columns that are not read.

    What the map names wins over the log's own columns of the same joint and quantity. A column that the map reads is
    not read under its own name too. Columns with names of other programs are taken where none has ours.

    Raises
    ------
    QueryError
        The map names what no log has, or a column that is not there (code "column-missing"), or reads one twice (code
        "column-twice").
    """
    forms = {letter: [[*chain(*column_forms(joint, letter))] for joint in robot.joints] for letter in LETTERS}
    known = ("t", "run", *LETTERS, *chain(*chain(*forms.values())))
    given: dict[str, np.ndarray] = {}
    taken: dict[str, str] = {}
    for ours, entry in entries:
        require_known(ours, known, QueryError, "the map names {!r}, which is nothing of this robot", argument="columns")
        column = entry["column"]
        require_known(column, log, QueryError, f"{where}: there is no column {{!r}}", argument="columns",
                      code="column-missing")  # fmt: skip
        if column in taken:
            raise QueryError(f"column {column!r} is read twice, as {taken[column]} and as {ours}", argument="columns",
                             remedy="name another column, or lock one of the joints", code="column-twice")  # fmt: skip
        taken[column] = ours
        given[ours] = np.asarray(log[column]) * entry.get("scale", 1.0) + entry.get("offset", 0.0)
    replaced = taken.keys() | given.keys()
    for letter, joints in forms.items():
        for names in joints:
            if letter in given or not given.keys().isdisjoint(names):
                replaced |= {letter, *names}
    found, guessed = in_our_names({name: x for name, x in log.items() if name not in replaced} | given, robot)
    read = {"t", "run", *chain(*(columns_to_read(found, robot.joints, letter) for letter in LETTERS))}
    left = [name for name in log if name not in taken and (name in replaced or name in found.keys() - read)]
    return found, guessed, left


def convert(robot: Robot, found: dict[str, np.ndarray], unit: str) -> None:
    """Take columns from a unit to SI and radians, in place; of q, v and a those that are angles and their rates.

    Raises QueryError for an unknown unit.
    """
    require_known(unit, UNITS, QueryError, "the unit {!r} is unknown", argument="units")
    letters, factor = UNITS[unit]
    for letter in letters if letters == "qva" else (letters,):
        if letter in ("t", "tau"):
            names = ["t"] if letter == "t" else columns_to_read(found, robot.joints, letter)
        else:
            values, own = np.asarray(found.get(letter, 0.0)), [name for name, _ in joint_columns(robot.joints, letter)]
            if values.shape[1:] == (len(own),) or values.ndim == len(own) == 1:  # others are refused later
                found |= dict(zip(own, values.reshape(-1, len(own)).T, strict=True))
                del found[letter]
            names = [name for joint in robot.joints for name in _angles(joint, letter)]
        found |= {name: np.asarray(found[name]) * factor for name in names if name in found}


def _angles(joint: JointLayout, letter: str) -> list[str]:
    """The names of a joint's columns that are angles, or their rates; not cos, sin and quaternions."""
    forms, dofs = column_forms(joint, letter), angular_dofs(joint)
    if letter == "q" and joint.kind != "vector":
        return forms[2] if joint.kind == "cos-sin" else []
    return [form[k] for form in forms for k in dofs]
