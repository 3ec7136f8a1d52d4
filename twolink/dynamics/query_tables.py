"""Tables of queries: the states in columns, and the answers beside them."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from twolink.dynamics.queries import ARGUMENTS, Query
from twolink.dynamics.robot import Robot
from twolink.errors import QueryError
from twolink.io.tables import Columns
from twolink.robots.joint_layout import columns_to_read, joint_columns, read_columns


def states_of(robot: Robot, table: Columns) -> tuple[dict[str, Any], Columns]:
    """The arguments of a query, and the columns of a table that are none.

    Columns q0, q1, ..., v0, ... by number, or q.JOINT, v.JOINT by name as `run.save` writes them. Raises QueryError
    where columns of an argument lack, or name what is no joint.
    """
    out, read = dict[str, Any](), set[str]()
    for name in ARGUMENTS:
        wanted = columns_to_read(table, robot.joints, name)
        if table.keys() & set(wanted):
            out[name], lacking = read_columns(table, robot.joints, name)
            if lacking:
                raise QueryError(f"column {lacking[0]!r} is missing", where="states", remedy="give all, or none")
            read.update(wanted)
    others = {column: values for column, values in table.items() if column not in read}
    if not out:
        raise QueryError(f"no column is of a state: {', '.join(others)}", where="states",
                         remedy="columns are q0, q1, ... or q.JOINT, and so on for v, tau, a")  # fmt: skip
    if unknown := [column for column in others if _is_of_state(column)]:
        raise QueryError(f"column {unknown[0]!r} is unknown", where="states",
                         remedy="columns are q0, q1, ... or q.JOINT, and so on for v, tau, a; give others other "
                                "names")  # fmt: skip
    return out, others


def _is_of_state(column: str) -> bool:
    """True if a column's name says that it is one of a state: a misspelt joint would be taken as 0 otherwise."""
    rests = [column.removeprefix(name) for name in ARGUMENTS if column.startswith(name)]
    return any(rest.startswith((".", "_")) or rest.isdigit() or not rest for rest in rests)


def table_of(
    robot: Robot, what: Query, arguments: Mapping[str, Any], others: Columns, result: Mapping[str, Any]
) -> Columns:
    """A table of other columns, states and answers: t, q.JOINT, tau.JOINT, M.0.1, ...

    A column of the states or the others that has the name of one of the answers gets "given." before it. Numbers of one
    state are the same in all rows.
    """
    answers = dict(_columns(robot, result, {name: shape for name, (shape, _) in what.results.items()}))
    given = {**others, **dict(_columns(robot, arguments, dict.fromkeys(arguments, ("nv",))))}
    columns = {f"given.{name}" if name in answers else name: values for name, values in given.items()} | answers
    count = max(len(values) for values in columns.values())
    return {name: np.broadcast_to(values, count) for name, values in columns.items()}


def _columns(
    robot: Robot, arrays: Mapping[str, Any], shapes: Mapping[str, tuple[Any, ...]]
) -> Iterator[tuple[str, np.ndarray]]:
    """Columns (n,) of arrays with these shapes for one state; by joint where those say so."""
    for name, values in arrays.items():
        array = np.asarray(values, dtype=float)
        array = array.reshape(-1, *array.shape[array.ndim - len(shapes[name]) :])
        names = [column for column, _ in joint_columns(robot.joints, name)]
        for place in np.ndindex(array.shape[1:]):
            column = names[place[0]] if shapes[name] == ("nv",) else ".".join([name, *map(str, place)])
            yield column, array[(slice(None), *place)]


def beyond_range(robot: Robot, q: Any) -> Iterator[str]:
    """Of each joint whose coordinate is beyond its limits: in how many states."""
    states = np.atleast_2d(np.asarray(q, dtype=float))
    for joint in (joint for joint in robot.joints if joint.kind == "vector" and joint.unit):
        low, high, values = joint.lower[0], joint.upper[0], states[:, joint.q.start]
        if count := int(((values < low) | (values > high)).sum()):
            yield (f"joint {joint.name!r} is beyond its limits of {low:.6g} to {high:.6g} {joint.unit} in {count} of "
                   f"{len(states)} states")  # fmt: skip


def beyond_effort(robot: Robot, result: Mapping[str, Any], t: np.ndarray | None) -> Iterator[str]:
    """Of each joint whose torque is beyond its limit of effort: by how much, and when. A limit of 0 is none."""
    if "tau" not in result:
        return
    tau = np.abs(np.atleast_2d(np.asarray(result["tau"], dtype=float)))
    for joint in robot.joints:
        for k, limit in zip(range(joint.v.start, joint.v.stop), joint.effort_limit, strict=True):
            most = int(tau[:, k].argmax())
            if tau[most, k] > limit > 0.0:
                when = f" at t = {t[most]:.6g} s" if t is not None else f" in state {most}" if len(tau) > 1 else ""
                unit = "N m" if joint.unit == "rad" else "N"
                yield (f"joint {joint.name!r} needs {tau[most, k]:.6g} {unit}{when}, beyond its limit of {limit:.6g}; "
                       f"so it is in {int((tau[:, k] > limit).sum())} of {len(tau)} states")  # fmt: skip
