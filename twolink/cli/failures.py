"""Failures of the command line and their exit codes: 1 failed, 2 misused, 130 interrupted."""

from pathlib import Path
from typing import Any

from typer.core import TyperCommand

from twolink.errors import TwolinkError

FAILED, MISUSED, INTERRUPTED = 1, 2, 130


class Misuse(TwolinkError):
    """The command was called wrongly."""

    exit_code = MISUSED


class Interrupted(TwolinkError):
    """Ctrl-C ended a command whose results so far were printed and written."""

    exit_code = INTERRUPTED

    def __init__(self) -> None:
        super().__init__("interrupted", remedy="what was done is kept")


class Command(TyperCommand):
    """A command. A failure becomes Misuse when its argument is missing, or is on the command line and no file."""

    def invoke(self, ctx: Any) -> Any:
        """Call the command's function."""
        try:
            return super().invoke(ctx)
        except TwolinkError as error:
            option = error.argument.partition("[")[0]  # the argument of "lock['elbow']" is lock
            source = ctx.get_parameter_source(option)
            wrong = source is not None and source.name == "COMMANDLINE" and not isinstance(ctx.params[option], Path)
            if wrong or error.code == "missing-option":
                raise Misuse(error.what, where=error.where, remedy=error.remedy) from None
            raise
