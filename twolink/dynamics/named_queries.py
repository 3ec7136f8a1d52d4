"""Dynamics queries by name, on states that come as text: what the command line and the service share."""

import json
import re
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from twolink.algorithms.functions import Shape
from twolink.dynamics import Robot
from twolink.dynamics.pinocchio_queries import signature
from twolink.errors import QueryError, require_known
from twolink.io.csv_text import first_repeated, parse_csv
from twolink.io.text import decode, parse_number, read_bytes
from twolink.robots.joint_layout import JointLayout


@dataclass(frozen=True)
class NamedQuery:
    """A query of Robot that is asked by name.

    summary: what it answers. arguments: q must be there, the others are zero when they are left out.
    results: the names of the answers. shape: of the numbers for one state, "nv" standing for the robot's nv.
    options: further arguments by keyword.
    """

    summary: str
    arguments: tuple[str, ...]
    results: tuple[str, ...]
    shape: Shape
    options: tuple[str, ...] = ()


def _named(name: str, summary: str, results: str, options: str = "") -> tuple[str, NamedQuery]:
    """The query with the names of its results and options, and the arguments and the shape that Pinocchio's has."""
    method = name.replace("-", "_") + ("_aligned" if "axes" in options else "")
    arguments, shape = signature(method)
    return name, NamedQuery(summary, arguments, tuple(results.split()), shape, tuple(options.split()))


QUERIES: dict[str, NamedQuery] = dict((
    _named("forward-dynamics", "Accelerations a (..., nv) that torques tau give: M(q) a + h(q, v) = tau", "a",
           "f_ext method"),
    _named("inverse-dynamics", "Torques tau (..., nv) that accelerations a need", "tau", "f_ext"),
    _named("mass-matrix", "The joint-space inertia matrix M (..., nv, nv)", "M"),
    _named("bias", "h = C v + g (..., nv), the torques that keep all accelerations zero", "h"),
    _named("coriolis", "A Coriolis matrix C (..., nv, nv)", "C"),
    _named("gravity-torque", "g (..., nv), the torques that hold the robot at rest against gravity", "g"),
    _named("energy", "kinetic and potential energy (...,) [J]", "kinetic potential"),
    _named("centre-of-mass", "c (..., 3) of all bodies that can move, in the world [m]", "c"),
    _named("momentum", "Momentum (..., 6): linear, then angular about the centre of mass, along the world's axes",
           "momentum"),
    _named("frame-pose", "Rotation R (..., 3, 3) and origin p (..., 3) of a frame in the world", "R p", "frame"),
    _named("frame-velocity", "Velocity (..., 6) of a frame: linear, then angular", "velocity", "frame axes"),
    _named("frame-jacobian", "J (..., 6, nv) of a frame: J v is its velocity, linear then angular", "J", "frame axes"),
    _named("forward-dynamics-derivatives", "da_dq, da_dv, da_dtau (..., nv, nv), along tangent directions",
           "da_dq da_dv da_dtau"),
    _named("inverse-dynamics-derivatives", "dtau_dq, dtau_dv, dtau_da (..., nv, nv), along tangent directions",
           "dtau_dq dtau_dv dtau_da"),
))  # fmt: skip


def answer_query(
    robot: Robot, what: str, arguments: Mapping[str, Any], f_ext: Any = None, method: str | None = None, **options: Any
) -> dict[str, np.ndarray]:
    """The answer to a query by name, by the names of its results.

    Parameters
    ----------
    robot : Robot
        The robot that is asked.
    what : str
        One of QUERIES.
    arguments : mapping of str to array_like
        q, and others that are zero when they are left out.
    f_ext, method, **options
        Options of the query, such as frame="tip"; None stands for one that is left out.

    Raises
    ------
    QueryError
        For an unknown query, an argument or option that the query does not take, or one that is missing.
    """
    require_known(what, QUERIES, QueryError, where="query", argument="what")
    query = QUERIES[what]
    for name in arguments:
        if name not in query.arguments:
            remedy = f"it takes {', '.join(query.arguments)}"
            raise QueryError(f"{what} takes no {name}", argument=name, remedy=remedy)
    chosen = {"f_ext": f_ext, "method": method, **options}
    chosen = {name: value for name, value in chosen.items() if value is not None}
    for name in chosen:
        if name not in query.options:
            raise QueryError(f"{what} takes no {name}", argument=name, remedy="leave it out")
    if "q" not in arguments:
        raise QueryError("it is not given", argument="q", remedy=f"give the {robot.nq} numbers of a configuration")
    if "frame" in query.options and "frame" not in chosen:
        remedy = f"one of {', '.join(robot.frame_names[:12])}, ..."
        raise QueryError("it is not given", argument="frame", code="missing-option", remedy=remedy)
    zero = np.zeros(robot.nv)
    values = [arguments.get(name, zero) for name in query.arguments]
    answer = getattr(robot, what.replace("-", "_"))(*values, **chosen)
    parts = answer if len(query.results) > 1 else (answer,)
    return dict(zip(query.results, parts, strict=True))


def read_states(robot: Robot, texts: Mapping[str, str | None], path: Path | None) -> dict[str, Any]:
    """The arguments of a query: those that come as text, and those from a JSON or CSV file ("-": stdin)."""
    arguments = {name: parse_numbers(name, text) for name, text in texts.items() if text is not None}
    if path is None:
        return arguments
    data = sys.stdin.buffer.read() if str(path) == "-" else read_bytes(path, QueryError)
    text = decode(data, path, QueryError)
    from_file = _from_json(text) if text.lstrip().startswith(("{", "[")) else _from_csv(robot, text)
    twice = [name for name in from_file if name in arguments]
    if twice:
        raise QueryError("it is given twice, in the file and as an option", argument=twice[0], remedy="keep one")
    return arguments | from_file


def parse_numbers(name: str, text: str) -> list[Any]:
    """Numbers from "0.1 0.2", "0.1,0.2" or JSON "[0.1, 0.2]"."""
    try:
        if text.lstrip().startswith("["):
            values = parse_json(text, name)
            return values if isinstance(values, list) else [values]
        return [parse_number(part) for part in re.split(r"[\s,;]+", text.strip()) if part]
    except ValueError:
        raise QueryError(f"{text!r} is not a list of numbers", argument=name, remedy='such as "0.1 0.2"') from None


def parse_json(text: str, argument: str, remedy: str = "check that place") -> Any:
    """JSON as Python data; all numbers are floats. Raises QueryError for what is not JSON, or repeats a key."""

    def unrepeated(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        repeated = first_repeated(key for key, _ in pairs)
        if repeated is not None:
            raise QueryError(f"{repeated!r} is there twice", argument=argument, remedy="keep one")
        return dict(pairs)

    try:
        # As a float, an integer of any length is a number or infinite: Python's own refuses long ones.
        return json.loads(text, parse_int=float, object_pairs_hook=unrepeated)
    except json.JSONDecodeError as error:
        raise QueryError(f"not JSON: {error}", argument=argument, remedy=remedy) from None
    except RecursionError:
        raise QueryError("not our JSON: it is nested too deep", argument=argument, remedy=remedy) from None


def _from_json(text: str) -> dict[str, Any]:
    content = parse_json(text, "states")
    if isinstance(content, list) and content and all(isinstance(c, dict) for c in content):
        names = list(content[0])
        odd = next((i for i, c in enumerate(content) if set(c) != set(names)), None)
        if odd is not None:
            what = f"state {odd} has {list(content[odd])}, the first has {names}"
            raise QueryError(what, where="states", remedy="give every state the same entries")
        return {name: [c[name] for c in content] for name in names}
    if isinstance(content, dict):
        return content
    remedy = 'such as {"q": [[0, 0]], "v": [[0, 0]]}'
    raise QueryError("expected an object, or a list of objects", where="states", remedy=remedy)


def _from_csv(robot: Robot, text: str) -> dict[str, Any]:
    """Columns q0, q1, ..., v0, ... by number, or q.JOINT, v.JOINT by name as `run.save` writes them."""
    table = parse_csv(text, "states", QueryError, rows=1)
    out: dict[str, Any] = {}
    left = set(table)
    for name, size in (("q", robot.nq), ("v", robot.nv), ("tau", robot.nv), ("a", robot.nv)):
        numbered = [f"{name}{i}" for i in range(size)]
        wanted = numbered if left & set(numbered) else [column for column, _ in joint_columns(robot.joints, name)]
        if not left & set(wanted):
            continue
        lacking = [column for column in wanted if column not in left]
        if lacking:
            raise QueryError(f"column {lacking[0]!r} is missing", where="states", remedy="give all of them, or none")
        out[name] = np.column_stack([table[column] for column in wanted])
        left -= set(wanted)
    unknown = [column for column in table if column in left - {"t", "energy", "error"}]
    if unknown:
        remedy = "columns are q0, q1, ... or q.JOINT, and so on for v, tau, a"
        raise QueryError(f"column {unknown[0]!r} is unknown", where="states", remedy=remedy)
    return out


def joint_columns(joints: Iterable[JointLayout], name: str) -> list[tuple[str, str]]:
    """The columns of "q", "v", "tau" or "a" in their order, each with its joint: q.JOINT, q.JOINT.0, q.JOINT.1, ..."""
    columns = []
    for joint in joints:
        part = joint.q if name == "q" else joint.v
        size = part.stop - part.start
        columns += [(f"{name}.{joint.name}" + (f".{k}" if size > 1 else ""), joint.name) for k in range(size)]
    return columns
