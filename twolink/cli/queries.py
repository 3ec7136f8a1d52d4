"""The command that answers dynamics questions: about a state, a table of states, or a motion from rest to rest."""

import sys
from collections.abc import Iterator, Mapping
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from typer import Argument, Option

from twolink.cli.common import Json, Misuse, RobotLoader, RobotName, show, vector_of, with_robot_options
from twolink.dynamics import Robot
from twolink.dynamics.queries import ARGUMENTS, OPTIONS, QUERIES, answer_query
from twolink.dynamics.query_tables import beyond_effort, beyond_range, states_of, table_of
from twolink.dynamics.trapezoid import PlannedMotion, trapezoidal_motion
from twolink.errors import QueryError
from twolink.io.tables import SUFFIXES, Columns, parse_csv, require_format, write_table
from twolink.io.text import decode, parse_json, parse_numbers, read_bytes

WRITTEN = ("t", "energy", "error")  # by `run.save`, beside the states


@with_robot_options
def query(
    robot: RobotName,
    what: Annotated[str, Argument(metavar="QUERY", help=", ".join(QUERIES))],
    *,
    states: Annotated[Path | None, Option(help="Many states: a .json or .csv file, or - for stdin.")] = None,
    to: Annotated[str | None, Option(help="Move from --q to this configuration, from rest to rest.")] = None,
    speed: Annotated[str | None, Option(help="Of --to, rad/s or m/s.", show_default="the robot's limits")] = None,
    acceleration: Annotated[str | None, Option(help="Of --to, rad/s^2 or m/s^2.")] = None,
    samples_per_second: Annotated[float, Option(help="Of --to.")] = 100.0,
    out: Annotated[Path | None, Option(help=f"Write states and answers as a table: {', '.join(SUFFIXES)}.")] = None,
    load: RobotLoader,
    as_json: Json = False,
    **given: Any,
) -> None:
    """Ask a dynamics question about states or a motion.

    \b
    twolink query two_link forward-dynamics --q "0 0" --v "0 0" --tau "1 0"
    twolink query two_link energy --states states.csv --json
    twolink query panda gravity-torque --q "panda_joint4=-90deg panda_joint6=1.5"
    twolink query ur5 inverse-dynamics --q "0 -1 1 0 0 0" --to "1 -1 0 0 0 0" --acceleration 4 --out torques.csv

    \b
    JSON: {"q": [[...], ...], "v": [[...], ...], "tau": ...}, or a list of such objects.
    CSV:  a header with columns q0, q1, ..., v0, ..., tau0, ... or q.JOINT, v.JOINT, ...; one state a row. Others, such
          as t, are not read; --out keeps them.
    --to: the speed of all joints is one trapezoid in time; a number is for all of them, nv numbers one for each.
          Joints that turn without end take the shorter way.
    """
    if given["q"] is None and states is None and what in QUERIES:
        raise Misuse("it is not given", where="q", remedy="give --q with a configuration, or --states with many")
    if out is not None:
        require_format(out, SUFFIXES, QueryError)
    loaded = load(robot)
    options: dict[str, Any] = {name: text or None for name, text in given.items() if name in OPTIONS}
    if given["f_ext"] is not None:
        options["f_ext"] = parse_json(given["f_ext"], "f_ext", 'such as {"tip": [0, 0, -1, 0, 0, 0]}')
    arguments, others = read_states(loaded, {name: text for name, text in given.items() if name in ARGUMENTS}, states)
    motion = _motion(loaded, arguments, {"to": to, "speed": speed, "acceleration": acceleration}, samples_per_second)
    taken = QUERIES[what].signature.parameters if what in QUERIES else ()
    if motion is not None:
        others = {"t": motion.t}
        arguments |= {name: getattr(motion, name) for name in ("q", "v", "a") if name in taken}
    unused = {name: arguments.pop(name) for name in ("v", "tau")  # a saved run has them for all queries
              if given[name] is None and name not in taken and name in arguments}  # fmt: skip
    result = answer_query(loaded, what, arguments, **options)
    for note in (*beyond_range(loaded, arguments["q"]), *beyond_effort(loaded, result, others.get("t"))):
        typer.echo(f"note: {note}", err=True)
    if out is not None:
        table = table_of(loaded, QUERIES[what], arguments | unused, others, result)
        write_table(out, table, {})
        rows = f"{len(next(iter(table.values())))} states with {', '.join(result)}"
        show({"file": out, "columns": list(table)}, f"{out}: {rows}", as_json)
        return
    if unread := [name for name in others if name not in WRITTEN]:
        typer.echo(f"note: not read: {', '.join(unread)}", err=True)
    with np.printoptions(precision=17, threshold=1_000_000, linewidth=120):
        show(result, "\n".join(f"{name} =\n{np.asarray(value)}" for name, value in result.items()), as_json)


def _motion(
    robot: Robot, arguments: dict[str, Any], texts: Mapping[str, str | None], rate: float
) -> PlannedMotion | None:
    """The motion that options describe, from the configuration of the arguments, which it takes; None for none."""
    asked = {name: text for name, text in texts.items() if text is not None}
    if "to" not in asked:
        if asked:
            raise Misuse("it is of a motion", where=next(iter(asked)), remedy="give --to with its end")
        return None
    if arguments.keys() != {"q"}:
        raise Misuse("states are given already", where="to", remedy="give --q, and no other states")
    if "acceleration" not in asked:
        raise Misuse("it is not given", where="acceleration", remedy="give --acceleration, such as 4")
    start = arguments.pop("q")
    end = vector_of(robot, "to", asked.pop("to"), "q", start)
    limits = {name: parse_numbers(name, text) for name, text in asked.items()}
    return trapezoidal_motion(robot, start, end, samples_per_second=rate, **limits)


def _declared() -> Iterator[Parameter]:
    """The options of `query` for what the declared queries take."""
    for name in (*ARGUMENTS, *OPTIONS):
        takers = [each for each in QUERIES.values() if name in each.signature.parameters]
        if takers:
            taken = takers[0].signature.parameters[name]
            text = ARGUMENTS[name] if name in ARGUMENTS else OPTIONS[name][1]
            is_flag = OPTIONS.get(name, (str,))[0] is bool
            choices = () if is_flag else takers[0].options.get(name, ())
            text += f": {' or '.join(choices)}" if choices else ""
            text += ", or by joint with units: elbow=20deg" if name == "q" else ""
            text += f" ({', '.join(each.name for each in takers)})" if len(takers) < 5 else ""
            default = "0" if name in ARGUMENTS and name != "q" else taken.default
            shown, spelt = default if isinstance(default, str) else False, [f"--{name}"] if is_flag else []
            option = Option(*spelt, help=f"{text}.", show_default=shown)
            kind, left_out = (bool, False) if is_flag else (str | None, None)
            yield Parameter(name, Parameter.KEYWORD_ONLY, default=left_out, annotation=Annotated[kind, option])


_robot, _what, *_others = signature(query).parameters.values()
query.__signature__ = Signature([_robot, _what, *_declared(), *_others[:-1]])  # type: ignore[attr-defined]  # for Typer


def read_states(robot: Robot, texts: Mapping[str, str | None], path: Path | None) -> tuple[dict[str, Any], Columns]:
    """The arguments of a query, and columns that are none.

    Those that come as text, and those from a JSON or CSV file ("-": stdin).
    """
    arguments = {name: vector_of(robot, name, text) for name, text in texts.items() if text is not None}
    if path is None:
        return arguments, {}
    data = sys.stdin.buffer.read() if str(path) == "-" else read_bytes(path, QueryError)
    text, others = decode(data, path, QueryError), Columns()
    if text.lstrip().startswith(("{", "[")):
        from_file = _from_json(text)
    else:
        from_file, others = states_of(robot, parse_csv(text, "states", QueryError, rows=1))
    twice = [name for name in from_file if name in arguments]
    if twice:
        raise QueryError("it is given twice, in the file and as an option", argument=twice[0], remedy="keep one")
    return arguments | from_file, others


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
