"""The command line: parse, call, print. Exit codes: 0 done, 1 failed, 2 misused."""

from __future__ import annotations

import contextlib
import os
import sys
from pathlib import Path
from typing import Annotated, Any, NoReturn

import numpy as np
import typer

from twolink._version import __version__
from twolink.cli import hard_cases, scenes, serve, throw
from twolink.cli.options import Misuse, misuse, takes_robot
from twolink.cli.printing import print_json, print_robot, print_robots, say_skipped
from twolink.dynamics import Robot, load_robot
from twolink.dynamics.named_queries import QUERIES, answer_query, parse_json, read_states
from twolink.dynamics.robot_record import robot_record
from twolink.errors import RobotError, TwolinkError

app = typer.Typer(
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    help="Rigid-body dynamics from a URDF: queries, experiments and playback.",
    epilog="ROBOT is a name (see `twolink robots`), or the path of a URDF. SI units and radians throughout.",
)

JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON for programs.")]
OutOption = Annotated[Path, typer.Option("--out", help="The folder to write into.")]
INTERRUPTED = 130  # what Typer makes of Ctrl-C


@app.callback(invoke_without_command=True)
def _main(
    context: typer.Context, version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False
) -> None:
    if version:
        typer.echo(f"twolink {__version__}")
        raise typer.Exit
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


@app.command()
def robots(as_json: JsonOption = False) -> None:
    """List the robots known by name, with nq, nv, mass and the root they are meant to have."""
    from twolink.robots.catalogue import catalogue_entry, catalogue_names

    rows: list[dict[str, Any]] = []
    for name in catalogue_names():
        entry = catalogue_entry(name)
        row: dict[str, Any] = {"name": name, "from": entry.origin, "root": entry.usual_root}
        try:
            robot = load_robot(name, root=entry.usual_root)
            row |= {"nq": robot.nq, "nv": robot.nv, "mass": robot.mass}
        except TwolinkError as error:
            row |= {"refused": str(error)}
        rows.append(row)
    if as_json:
        print_json(rows)
    else:
        print_robots(rows)


@app.command()
@takes_robot()
def inspect(
    robot: Robot,
    cross_check: Annotated[
        bool, typer.Option("--cross-check", help="Hold yourdfpy's reading against it; exit code 1 when they differ.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Say what a URDF holds: joints, masses, and what was read, ignored, repaired and assumed."""
    second = None
    if cross_check:
        from twolink.robots.cross_check import compare

        second = compare(robot)
    if as_json:
        print_json({**robot_record(robot), **({"second_reading": second} if second else {})})
    else:
        print_robot(robot)
        if second:
            typer.echo(f"\nsecond reading (yourdfpy): {second['text']}")
    if second and not second["agree"]:
        remedy = "trust neither, and report it with the URDF"
        raise RobotError("Pinocchio and yourdfpy read it differently", where=f"robot {robot.name!r}", remedy=remedy)


@app.command()
@takes_robot()
def query(
    robot: Robot,
    what: Annotated[str, typer.Argument(help=", ".join(QUERIES))],
    q: Annotated[str | None, typer.Option(help='Configuration: "0.1 0.2", "0.1,0.2" or "[0.1, 0.2]".')] = None,
    v: Annotated[str | None, typer.Option(help="Velocity; zero when left out.")] = None,
    tau: Annotated[str | None, typer.Option(help="Torques (forward-dynamics); zero when left out.")] = None,
    a: Annotated[str | None, typer.Option(help="Accelerations (inverse-dynamics); zero when left out.")] = None,
    states: Annotated[Path | None, typer.Option(help="Many states: a .json or .csv file, or - for stdin.")] = None,
    f_ext: Annotated[str | None, typer.Option("--f-ext", help='JSON: {"frame": [fx, fy, fz, tx, ty, tz]}.')] = None,
    method: Annotated[str | None, typer.Option(help="Of forward-dynamics: aba (the default) or crba.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Ask a dynamics question about one state, or about many from a file or stdin.

    \b
    JSON: {"q": [[...], ...], "v": [[...], ...], "tau": ...}, or a list of such objects.
    CSV:  a header with columns q0, q1, ..., v0, ..., tau0, ... or q.JOINT, v.JOINT, ...; a row a state.
    """
    given = {"q": q, "v": v, "tau": tau, "a": a}
    from_options = [name for name in given if given[name] is not None or states is None]
    with misuse("query", "method", "f_ext", *from_options):
        wrenches = None if f_ext is None else parse_json(f_ext, "f_ext", 'such as {"tip": [0, 0, -1, 0, 0, 0]}')
        result = answer_query(robot, what, read_states(robot, given, states), wrenches, method)
    if as_json:
        print_json(result)
        return
    for name, value in result.items():
        text = np.array2string(np.asarray(value), precision=17, threshold=1_000_000, max_line_width=120)
        typer.echo(f"{name} =\n{text}")


@app.command()
def check(
    n: Annotated[int, typer.Option(min=1, help="Random arms and states.")] = 10_000,
    seed: Annotated[int, typer.Option(min=0)] = 0,
    as_json: JsonOption = False,
) -> None:
    """Check Pinocchio, the hand-derived equations and a derivation by machine against each other."""
    from twolink.lagrange.check import check as run_check

    report = run_check(n=n, seed=seed)
    if as_json:
        print_json(report.to_dict())
    else:
        typer.echo(report.text())
    if not report.passed:
        raise typer.Exit(1)


for commands in (scenes, hard_cases, serve, throw):
    commands.register(app)


@app.command()
def paper(out: OutOption = Path("out"), as_json: JsonOption = False) -> None:
    """Draw the paper's figures 6 to 13 again, and answer each of its claims with a number."""
    from twolink.paper.figures import study

    result = study(out)
    if as_json:
        print_json(
            {
                "difference": result.difference,
                "claims": [vars(c) for c in result.claims],
                "pictures": list(result.pictures),
            }
        )
    else:
        typer.echo(result.text())


@app.command()
@takes_robot(optional=True)
def play(
    robot: Robot | None,
    file: Annotated[Path, typer.Argument(help="A saved trajectory: .npz, .parquet or .csv.")],
    speed: Annotated[float, typer.Option(help="2 is twice as fast.")] = 1.0,
    html: Annotated[Path | None, typer.Option(help="Write a standalone page instead of opening a browser.")] = None,
    no_browser: Annotated[bool, typer.Option("--no-browser", help="Print the address, open nothing.")] = False,
) -> None:
    """Play a saved trajectory in the browser, at true speed, or write it as a standalone page."""
    from twolink.simulation.trajectory import Trajectory

    if not 0 < speed < float("inf"):
        raise Misuse(f"expected a number above 0, got {speed}", where="speed", remedy="1 is true speed")
    loaded = Trajectory.load(file, robot)
    if html is not None:
        typer.echo(f"wrote {loaded.playback(html, speed=speed, on_skipped=say_skipped)}")
        return
    loaded.play(speed=speed, open_browser=not no_browser, on_skipped=say_skipped)


def main() -> None:
    """The entry point: failures end in one line on stderr, never in a traceback."""
    try:
        code = app(prog_name="twolink", standalone_mode=False)
    except TwolinkError as error:
        _fail(str(error), 2 if isinstance(error, Misuse) else 1)
    except (KeyboardInterrupt, typer.Abort):
        _fail("interrupted", 1)
    except OSError as error:
        _drop_output()
        _fail(f"{error.filename or 'output'}: cannot be written: {error.strerror or error}; check the disk", 1)
    except Exception as error:
        if hasattr(error, "exit_code") and hasattr(error, "format_message"):  # click's own: the call was misused
            _fail(error.format_message() or "see --help", 2)
        raise
    if code == INTERRUPTED:
        _fail("interrupted", 1)
    sys.exit(code if isinstance(code, int) else 0)  # without its standalone mode, Typer returns what Exit carries


def _drop_output() -> None:
    """Let what could not be printed go, or Python tries again when it ends, and complains."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _fail(message: str, code: int) -> NoReturn:
    line = " ".join(message.split())
    if line:
        sys.stderr.write(f"twolink: {line}\n")
    sys.exit(code)
