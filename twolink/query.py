"""Dynamics queries by name, on states that come as text: what the command line and the service share."""

from __future__ import annotations

import csv
import io
import json
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from twolink.dynamics import Robot
from twolink.errors import QueryError, nearest

# name -> the arguments it takes; q must be given, the others are zero when left out
QUERIES: dict[str, tuple[str, ...]] = {
    "forward-dynamics": ("q", "v", "tau"),
    "inverse-dynamics": ("q", "v", "a"),
    "mass-matrix": ("q",),
    "bias": ("q", "v"),
    "coriolis": ("q", "v"),
    "gravity-torque": ("q",),
    "energy": ("q", "v"),
}
_RESULT = {
    "forward-dynamics": "a",
    "inverse-dynamics": "tau",
    "mass-matrix": "M",
    "bias": "h",
    "coriolis": "C",
    "gravity-torque": "g",
}


def answer_query(
    robot: Robot, what: str, arguments: Mapping[str, Any], f_ext: Any = None, method: str = "aba"
) -> dict[str, np.ndarray]:
    """The answer, by the name of its symbol. Raises QueryError for an unknown query or argument."""
    if what not in QUERIES:
        raise QueryError(f"{what!r} is unknown", where="query", remedy=nearest(what, QUERIES))
    takes = QUERIES[what]
    for name in arguments:
        if name not in takes:
            raise QueryError(f"{what} takes no {name}", where=name, remedy=f"it takes {', '.join(takes)}")
    if f_ext is not None and what not in ("forward-dynamics", "inverse-dynamics"):
        raise QueryError(f"{what} takes no f_ext", where="f_ext", remedy="leave it out")
    if "q" not in arguments:
        raise QueryError("it is not given", where="q", remedy=f"give the {robot.nq} numbers of a configuration")
    values = [arguments.get(name, np.zeros(robot.nv)) for name in takes]
    if what == "energy":
        kinetic, potential = robot.energy(*values)
        return {"kinetic": kinetic, "potential": potential}
    if what == "forward-dynamics":
        q, v, tau = values
        return {"a": robot.forward_dynamics(q, v, tau, f_ext, method)}  # type: ignore[arg-type]  # checked there
    if what == "inverse-dynamics":
        q, v, a = values
        return {"tau": robot.inverse_dynamics(q, v, a, f_ext)}
    return {_RESULT[what]: getattr(robot, what.replace("-", "_"))(*values)}


def read_states(robot: Robot, given: Mapping[str, str | None], path: Path | None) -> dict[str, Any]:
    """The arguments of a query: those given as text, and those from a JSON or CSV file ("-": stdin)."""
    arguments = {name: parse_numbers(name, text) for name, text in given.items() if text is not None}
    if path is None:
        return arguments
    text = sys.stdin.read() if str(path) == "-" else _read(path)
    from_file = _from_json(text) if text.lstrip().startswith(("{", "[")) else _from_csv(robot, text)
    twice = [name for name in from_file if name in arguments]
    if twice:
        raise QueryError("it is given twice, in the file and as an option", where=twice[0], remedy="keep one")
    return arguments | from_file


def parse_numbers(name: str, text: str) -> list[Any]:
    """Numbers from "0.1 0.2", "0.1,0.2" or JSON "[0.1, 0.2]"."""
    try:
        if text.lstrip().startswith("["):
            values = json.loads(text)
            return values if isinstance(values, list) else [values]
        return [float(part) for part in re.split(r"[\s,;]+", text.strip()) if part]
    except ValueError:
        raise QueryError(f"{text!r} is not a list of numbers", where=name, remedy='such as "0.1 0.2"') from None


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        detail = getattr(error, "strerror", None) or "it is not UTF-8 text"
        raise QueryError(f"cannot be read: {detail}", where=str(path), remedy="check the path") from None


def _from_json(text: str) -> dict[str, Any]:
    try:
        content = json.loads(text)
    except json.JSONDecodeError as error:
        raise QueryError(f"not JSON: {error}", where="states", remedy="check that place") from None
    if isinstance(content, list) and content and all(isinstance(c, dict) for c in content):
        names = list(content[0])
        odd = next((i for i, c in enumerate(content) if list(c) != names), None)
        if odd is not None:
            raise QueryError(
                f"state {odd} has {list(content[odd])}, the first has {names}",
                where="states",
                remedy="give every state the same entries",
            )
        return {name: [c[name] for c in content] for name in names}
    if isinstance(content, dict):
        return content
    raise QueryError(
        "expected an object, or a list of objects",
        where="states",
        remedy='such as {"q": [[0, 0]], "v": [[0, 0]]}',
    )


def _from_csv(robot: Robot, text: str) -> dict[str, Any]:
    """Columns q0, q1, ..., v0, ... by number, or q.JOINT, v.JOINT by name as `run.save` writes them."""
    rows = list(csv.reader(io.StringIO(text)))
    if len(rows) < 2:
        raise QueryError("expected a header and at least one row", where="states", remedy="such as q0,q1,v0,v1")
    header = [name.strip() for name in rows[0]]
    try:
        values = np.array([[float(x) for x in row] for row in rows[1:] if row])
    except ValueError as error:
        raise QueryError(f"not a table of numbers: {error}", where="states", remedy="check rows and decimals") from None
    out: dict[str, Any] = {}
    for name, size in (("q", robot.nq), ("v", robot.nv), ("tau", robot.nv), ("a", robot.nv)):
        numbered = [f"{name}{i}" for i in range(size)]
        named = _named(robot, name)
        wanted = numbered if numbered[0] in header else named
        present = [column for column in wanted if column in header]
        if not present:
            continue
        lacking = [column for column in wanted if column not in header]
        if lacking:
            raise QueryError(f"column {lacking[0]!r} is missing", where="states", remedy="give all of them, or none")
        out[name] = values[:, [header.index(column) for column in wanted]]
        header = [None if column in wanted else column for column in header]  # type: ignore[misc]
    unknown = [column for column in header if column not in (None, "t", "energy", "error")]
    if unknown:
        raise QueryError(
            f"column {unknown[0]!r} is unknown",
            where="states",
            remedy="columns are q0, q1, ... or q.JOINT, and so on for v, tau, a",
        )
    return out


def _named(robot: Robot, name: str) -> list[str]:
    columns = []
    for joint in robot.joints:
        part = joint.q if name == "q" else joint.v
        size = part.stop - part.start
        columns += [f"{name}.{joint.name}" + (f".{k}" if size > 1 else "") for k in range(size)]
    return columns
