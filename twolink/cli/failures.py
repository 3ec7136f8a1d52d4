"""Failures of the command line in its own words, and their exit codes: 1 failed, 2 misused, 130 interrupted."""

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from typer.core import TyperCommand

from twolink.errors import TwolinkError

FAILED, MISUSED, INTERRUPTED = 1, 2, 130
_CALLS = ("load_robot", "load_scene")  # places in Python, which mean nothing on a command line


class Failure(TwolinkError):
    """A failure in the words of the command line, with its exit code."""

    def __init__(self, error: TwolinkError, options: dict[str, str], exit_code: int) -> None:
        where = "" if error.where in _CALLS else error.where
        name, rest = re.fullmatch(r"(\w*)(.*)", where, re.DOTALL).groups()  # type: ignore[union-attr]
        where = options[name] + rest if error.argument in ("", name) and name in options else where
        super().__init__(_spoken(error.what, options), where=where, remedy=_spoken(error.remedy, options))
        self.exit_code = exit_code


class Misuse(TwolinkError):
    """The command was called wrongly."""

    exit_code = MISUSED


class Interrupted(TwolinkError):
    """Ctrl-C ended a command whose results so far were printed and written."""

    exit_code = INTERRUPTED

    def __init__(self) -> None:
        super().__init__("interrupted", remedy="what was done is kept")


class Command(TyperCommand):
    """A command. Its failures name its options; one is misuse when its argument is missing or was given wrongly."""

    def invoke(self, ctx: Any) -> Any:
        """Call the command's function."""
        try:
            return super().invoke(ctx)
        except TwolinkError as error:
            option = error.argument.partition("[")[0]  # the argument of "lock['elbow']" is lock
            source = ctx.get_parameter_source(option)
            wrong = source is not None and source.name == "COMMANDLINE" and not isinstance(ctx.params[option], Path)
            misused = wrong or error.code == "missing-option"
            code = getattr(error, "exit_code", MISUSED if misused else FAILED)
            raise Failure(error, _options(ctx.command.params), code) from error


def _options(parameters: Iterable[Any]) -> dict[str, str]:
    """The options of a command by the names of their arguments in Python."""
    options = {p.name: p.opts[0] for p in parameters if p.param_type_name == "option"}
    return options | ({"verify": "--no-verify"} if "no_verify" in options else {})


def _spoken(text: str, options: dict[str, str]) -> str:
    """A text in which arguments of Python, such as duration=2, are options, such as --duration 2."""

    def option(found: re.Match[str]) -> str:
        name, value = found.groups()
        if name not in options:
            return found[0]
        return options[name] if value == "False" else f"{options[name]} {value.strip(chr(34) + chr(39))}".rstrip()

    return re.sub(r"\b(\w+)=([^\s,;)]*)", option, text)
