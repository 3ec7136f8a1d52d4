"""The commands about robots: list and inspect them, and check the equations behind the answers to queries."""

import contextlib
import sys
from pathlib import Path
from textwrap import shorten
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Option

from twolink.cli.common import FAILED, Json, Misuse, RobotLoader, RobotName, chosen_of, show, with_robot_options
from twolink.cli.wording import REPORTED, spoken
from twolink.dynamics import Robot
from twolink.dynamics.robot_record import robot_record
from twolink.errors import QueryError, RobotError, TwolinkError
from twolink.io.text import Table, decode, parse_json, read_bytes
from twolink.robots import robots as robot_table

if TYPE_CHECKING:
    from twolink.lagrange.equation_check import EquationCheck


def robots(as_json: Json = False) -> None:
    """List the robots known by name, with their sizes and masses.

    Each line has nq, nv, the mass in kg, the root the robot is meant to have (fixed to the world, or a floating base)
    and where it comes from. A robot that is refused is listed with the reason.
    """
    table = robot_table()
    records = [{name: value for name, value in record.items() if value is not None} for record in table]
    refused = [f"{one['name']} is refused (`twolink inspect {one['name']}` says all): {shorten(one['refused'], 120)}"
               for one in records if "refused" in one]  # fmt: skip
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
    joints = Table(("joint", "kind", "q", "v", "kg of its body"), tuple(rows))
    sizes = f"{robot.name}: nq = {robot.nq}, nv = {robot.nv}, {robot.mass:.6g} kg moving"
    return f"{sizes}\n\n{joints}\n\n{spoken(str(robot.report), REPORTED)}\n\nbatches: {_engines()}"


def _entries(start: int, stop: int) -> str:
    """The entries of a joint in q or v: 3, 3:7, or - where there are none."""
    return "-" if start == stop else str(start) if stop == start + 1 else f"{start}:{stop}"


def _engines() -> str:
    """The engines that answer batches of queries on this machine, in words."""
    from twolink.native.library import library

    if library() is None:
        return "by Pinocchio alone; the native library, which runs them as programs, is not here"
    return "by programs of the native library where that is faster, certified against Pinocchio"


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
