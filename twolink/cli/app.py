"""The command line: its commands, and the exit codes 0 done, 1 failed, 2 misused, 130 interrupted."""

import contextlib
import importlib
import os
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer

from twolink._version import __version__
from twolink.cli.common import FAILED, INTERRUPTED, MISUSED, Command
from twolink.cli.declared import DECLARED, Commands, Declared
from twolink.cli.evidence import hard_cases, paper
from twolink.cli.play import demo, play, video
from twolink.cli.queries import query
from twolink.cli.robots import check, inspect, robots
from twolink.cli.scenes import accuracy, energy, explain, methods, new, run, scenes
from twolink.errors import TwolinkError


def commands_of_parts() -> Iterator[Any]:
    """The commands of the parts that there are."""
    parts = Path(__file__).parents[1] / "parts"
    for file in sorted(parts.glob("*/commands.py")):
        yield from importlib.import_module(f"twolink.parts.{file.parent.name}.commands").COMMANDS


app = typer.Typer(
    cls=Commands,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"], "auto_envvar_prefix": "TWOLINK"},
    help="Rigid-body dynamics from a URDF: queries, experiments and playback.",
    epilog="ROBOT is a name (see `twolink robots`), or the path of a URDF. SI units and radians throughout. "
    "Exit codes: 0 done, 1 failed, 2 misused, 130 interrupted.",
)
_OWN = (demo, robots, inspect, query, check, scenes, new, explain, run, accuracy, methods,
        Declared(energy, ("run",)), play, video, hard_cases, paper)  # fmt: skip
for _command in (*_OWN, *commands_of_parts()):
    if isinstance(_command, Declared):
        DECLARED[_command.name] = _command
    else:
        app.command(cls=Command)(_command)


@app.callback(invoke_without_command=True)
def _main(
    context: typer.Context, version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False
) -> None:
    if version:
        typer.echo(f"twolink {__version__}")
        raise typer.Exit
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


def main() -> None:
    """Run the command line. A failure ends in one line on stderr, without a traceback; a warning is one, too."""
    warnings.showwarning = lambda message, *_, **__: typer.echo(f"twolink: warning: {message}", err=True)
    try:
        code = app(prog_name="twolink", standalone_mode=False)
    except TwolinkError as error:
        _fail(str(error), getattr(error, "exit_code", FAILED))
    except (KeyboardInterrupt, typer.Abort):
        _fail("interrupted", INTERRUPTED)
    except OSError as error:
        _drop_output()
        _fail(f"{error.filename or 'output'}: cannot be written: {error.strerror or error}; check the disk", FAILED)
    except Exception as error:
        if hasattr(error, "exit_code") and hasattr(error, "format_message"):  # an error of Typer: misuse
            context = getattr(error, "ctx", None)
            path = context.command_path if context else "twolink"
            _fail(f"{error.format_message().rstrip('.')}; see `{path} --help`", MISUSED)
        raise
    if code == INTERRUPTED:  # Typer returns this code after Ctrl-C
        _fail("interrupted", INTERRUPTED)
    sys.exit(code if isinstance(code, int) else 0)  # without its standalone mode, Typer returns the code of Exit


def _drop_output() -> None:
    """Discard output that could not be printed; Python would try again at its end, and complain."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _fail(message: str, code: int) -> NoReturn:
    """One line on stderr, and the exit code."""
    sys.stderr.write(f"twolink: {' '.join(message.split())}\n")
    sys.exit(code)
