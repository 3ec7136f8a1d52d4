"""The commands about robots: list and inspect them, answer dynamics questions, and check the equations behind the
answers.
"""

import contextlib
import sys
from collections.abc import Iterator, Mapping
from inspect import Parameter, Signature, signature
from pathlib import Path
from textwrap import shorten
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer
from typer import Argument, Option

from twolink.cli.common import (
    FAILED,
    REPORTED,
    Json,
    Misuse,
    RobotLoader,
    RobotName,
    chosen_of,
    show,
    spoken,
    with_robot_options,
)
from twolink.dynamics import Robot
from twolink.dynamics.queries import ARGUMENTS, OPTIONS, QUERIES, answer_query
from twolink.dynamics.robot_record import robot_record
from twolink.errors import QueryError, RobotError, TwolinkError
from twolink.io.tables import parse_csv
from twolink.io.text import Table, decode, parse_json, parse_numbers, read_bytes
from twolink.robots import robots as robot_table
from twolink.robots.joint_layout import columns_to_read, read_columns

if TYPE_CHECKING:
    from twolink.lagrange.equation_check import EquationCheck


def robots(as_json: Json = False) -> None:
    """List the robots known by name, with their sizes and masses.

    Each line has nq, nv, the mass in kg, the root the robot is meant to have (fixed to the world, or a floating base)
    and where it comes from. A robot that is refused is listed with the reason.
    """
    table = robot_table()
    records = [{name: value for name, value in record.items() if value is not None} for record in table]
    refused = [
        f"{record['name']} is refused (`twolink inspect {record['name']}` says all): {shorten(record['refused'], 120)}"
        for record in records
        if "refused" in record
    ]
    text = table.select("name", "nq", "nv", "mass", "root", "from")
    show(records, "\n".join([str(text), *refused]), as_json)


@with_robot_options
def inspect(
    robot: RobotName,
    *,
    load: RobotLoader,
    cross_check: Annotated[bool, Option("--cross-check", help="Compare with yourdfpy's reading.")] = False,
    as_json: Json = False,
) -> None:
    """Say what a URDF holds: joints, masses, the load report.

    The load report lists what is suspicious, and what was read, ignored, repaired and assumed. The exit code is 1
    when --cross-check finds another robot.
    """
    loaded = load(robot)
    record = robot_record(loaded)
    text = _text(loaded, record)
    if cross_check:
        from twolink.robots.checks import compare

        record["second_reading"] = compare(loaded)
        text += f"\n\nsecond reading (yourdfpy): {record['second_reading']['text']}"
    show(record, text, as_json)
    if cross_check and not record["second_reading"]["agree"]:
        remedy = "trust neither, and report it with the URDF"
        raise RobotError("Pinocchio and yourdfpy read it differently", where=f"robot {loaded.name!r}", remedy=remedy)


def _text(robot: Robot, record: dict[str, Any]) -> str:
    """Joints, the load report, and how batches are answered."""
    rows = [(j["name"], j["kind"], _entries(*j["q"]), _entries(*j["v"]), j["mass"]) for j in record["joints"]]
    joints = Table(("joint", "kind", "q", "v", "kg moved with it"), tuple(rows))
    sizes = f"{robot.name}: nq = {robot.nq}, nv = {robot.nv}, {robot.mass:.6g} kg moving"
    return f"{sizes}\n\n{joints}\n\n{spoken(str(robot.report), REPORTED)}\n\nbatches: {_engines(robot)}"


def _entries(start: int, stop: int) -> str:
    """The entries of a joint in q or v: 3, 3:7, or - where there are none."""
    return "-" if start == stop else str(start) if stop == start + 1 else f"{start}:{stop}"


def _engines(robot: Robot) -> str:
    """The engines that answer batches of queries on this machine, in words."""
    from twolink.native.library import library

    if library() is None:
        return "by Pinocchio alone; the native library, which runs them as programs, is not here"
    if robot.has_mimic:
        return "by Pinocchio alone; there are no programs for mimic joints"
    return "by programs of the native library where that is faster, certified against Pinocchio"


@with_robot_options
def query(
    robot: RobotName,
    what: Annotated[str, Argument(metavar="QUERY", help=", ".join(QUERIES))],
    *,
    states: Annotated[Path | None, Option(help="Many states: a .json or .csv file, or - for stdin.")] = None,
    load: RobotLoader,
    as_json: Json = False,
    **given: Any,
) -> None:
    """Ask a dynamics question about one state or many.

    \b
    twolink query two_link forward-dynamics --q "0 0" --v "0 0" --tau "1 0"
    twolink query two_link energy --states states.csv --json

    \b
    JSON: {"q": [[...], ...], "v": [[...], ...], "tau": ...}, or a list of such objects.
    CSV:  a header with columns q0, q1, ..., v0, ..., tau0, ... or q.JOINT, v.JOINT, ...; one state a row.
    """
    if given["q"] is None and states is None and what in QUERIES:
        raise Misuse("it is not given", where="q", remedy="give --q with a configuration, or --states with many")
    loaded = load(robot)
    options: dict[str, Any] = {name: text or None for name, text in given.items() if name in OPTIONS}
    if given["f_ext"] is not None:
        options["f_ext"] = parse_json(given["f_ext"], "f_ext", 'such as {"tip": [0, 0, -1, 0, 0, 0]}')
    arguments = read_states(loaded, {name: text for name, text in given.items() if name in ARGUMENTS}, states)
    if given["tau"] is None and what in QUERIES and "tau" not in QUERIES[what].signature.parameters:
        arguments.pop("tau", None)  # a saved run has them for all queries
    result = answer_query(loaded, what, arguments, **options)
    with np.printoptions(precision=17, threshold=1_000_000, linewidth=120):
        show(result, "\n".join(f"{name} =\n{np.asarray(value)}" for name, value in result.items()), as_json)


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
            text += f" ({', '.join(each.name for each in takers)})" if len(takers) < 5 else ""
            default = "0" if name in ARGUMENTS and name != "q" else taken.default
            shown, spelt = default if isinstance(default, str) else False, [f"--{name}"] if is_flag else []
            option = Option(*spelt, help=f"{text}.", show_default=shown)
            kind, left_out = (bool, False) if is_flag else (str | None, None)
            yield Parameter(name, Parameter.KEYWORD_ONLY, default=left_out, annotation=Annotated[kind, option])


_robot, _what, *_others = signature(query).parameters.values()
query.__signature__ = Signature([_robot, _what, *_declared(), *_others[:-1]])  # type: ignore[attr-defined]  # for Typer


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
    known = {"t", "energy", "error"}
    for name in ("q", "v", "tau", "a"):
        wanted = columns_to_read(table, robot.joints, name)
        if table.keys() & set(wanted):
            out[name], lacking = read_columns(table, robot.joints, name)
            if lacking:
                raise QueryError(f"column {lacking[0]!r} is missing", where="states", remedy="give all, or none")
            known.update(wanted)
    unknown = [column for column in table if column not in known]
    if unknown:
        remedy = "columns are q0, q1, ... or q.JOINT, and so on for v, tau, a"
        raise QueryError(f"column {unknown[0]!r} is unknown", where="states", remedy=remedy)
    return out


@with_robot_options
def check(
    *,
    n: Annotated[int, Option(min=1, metavar="COUNT", help="Number of random arms and states.")] = 10_000,
    seed: Annotated[int, Option(min=0, metavar="SEED", help="Seed of the random numbers.")] = 0,
    module: Annotated[Path | None, Option(help="A Python file with your M(q) and h(q, v); it is run.")] = None,
    robot: Annotated[str | None, Option(help="Of --module: a name or a URDF.", show_default="two_link")] = None,
    to: Annotated[str | None, Option(help="Of --module: absolute, vertical, both, or a matrix in JSON.")] = None,
    load: RobotLoader,
    as_json: Json = False,
) -> None:
    """Check the paper's equations, or your own, against Pinocchio.

    Without --module three sources are compared: Pinocchio, the hand-derived equations, and a derivation by computer
    algebra. With it, your mass matrix and bias are compared with those of a robot, entry by entry, and the sign or
    factor is named that mends them, as by tl.check_equations. Exit codes: 0 right, 1 wrong, 2 bad input.
    """
    if module is not None:
        if (n, seed) != (10_000, 0):
            raise Misuse("they are of the paper's check", where="n and seed", remedy="leave them out")
        result = _check_module(module, load, robot or "two_link", to)
        show(result.to_dict(), result, as_json)
        passed = result.right
    else:
        from twolink.lagrange.check import check as run_check

        chosen = [name for name, value in (("robot", robot), ("to", to)) if value is not None] + chosen_of(load)
        if chosen:
            raise Misuse("it is of your own equations", where=chosen[0], remedy="give --module with their file")
        report = run_check(n=n, seed=seed)
        show(report.to_dict(), report.text(), as_json)
        passed = report.passed
    if not passed:
        raise typer.Exit(FAILED)


def _check_module(path: Path, load: RobotLoader, robot: str, to: str | None) -> "EquationCheck":
    """The check of the equations in a file. Raises Misuse for all that keeps it from being made."""
    from twolink.lagrange.equation_check import check_equations, raised

    names: dict[str, Any] = {"__name__": path.stem, "__file__": str(path)}
    try:
        code = decode(read_bytes(path, QueryError), path, QueryError)
        change = parse_json(to, "to", "such as [[1, 0], [-1, 1]]") if to and to.lstrip().startswith("[") else to
        with contextlib.redirect_stdout(sys.stderr):  # what the file prints is no part of the result
            try:
                exec(compile(code, str(path), "exec"), names)
            except (Exception, SystemExit) as error:  # of any type: it is not ours
                raise QueryError(raised(error), where=str(path), remedy="correct it: the file is run") from error
            lacking = [name for name in ("M", "h") if name not in names]
            if lacking:
                what, remedy = f"it defines no {lacking[0]}", "define M(q) -> (nv, nv) and h(q, v) -> (nv,)"
                raise QueryError(what, where=str(path), remedy=remedy)
            return check_equations(names["M"], names["h"], load(robot), change)
    except TwolinkError as error:
        where = f"{path}: {error.where}" if error.argument in ("M", "h") else error.where
        raise Misuse(error.what, where=where, remedy=error.remedy, code=error.code) from error
