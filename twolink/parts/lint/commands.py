"""The command that looks for defects in robot files."""

from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from twolink.cli.common import FAILED, Files, Folders, Misuse, XacroArguments, finish, require_writable, write, xacro_of
from twolink.cli.wording import REPORTED, spoken
from twolink.errors import RobotError, require_known

_FORMATS = ("text", "json", "sarif", "github")


def lint(
    files: Annotated[list[str], Argument(metavar="FILE...", help="URDF, xacro, MJCF or SRDF; or a robot's name.")],
    style: Annotated[str, Option("--format", help="text, json, sarif, or github: annotations of its checks.")] = "text",
    baseline: Annotated[Path | None, Option(metavar="FILE", help="Findings (.json): say only what is new.")] = None,
    fix: Annotated[bool, Option("--fix", help="Write what is certain into the files.")] = False,
    fail_on: Annotated[str, Option(help="error, warning or note: what makes the exit code 1.")] = "error",
    package_dirs: Folders = None,
    xacro_arguments: XacroArguments = None,
    out: Files = None,
) -> None:
    """Find every defect of robot files at once.

    Each has its rule, file and line, what the file says, what was expected, and the likely cause. docs/how/lint.md
    explains the rules. --out writes the findings (.json .sarif). The exit code is 0 without errors, 1 with errors, and
    2 when a file cannot be opened.

    \b
    twolink lint robot.urdf --format github
    twolink lint robot.urdf --out known.json           then, later
    twolink lint robot.urdf --baseline known.json
    """
    from twolink.parts.lint.findings import SEVERITIES, Findings
    from twolink.parts.lint.lint import fix as write_fixes
    from twolink.parts.lint.lint import lint as lint_file

    require_known(style, _FORMATS, Misuse, argument="style")
    require_known(fail_on, SEVERITIES, Misuse, argument="fail_on")
    require_writable(out or [], (".json", ".sarif"))
    arguments = xacro_of(xacro_arguments)

    def look() -> Findings:
        try:
            each = [lint_file(file, package_dirs=package_dirs or (), xacro_arguments=arguments) for file in files]
        except RobotError as error:
            raise Misuse(error.what, where=error.where, remedy=error.remedy, code=error.code) from error
        whole = sum(each, Findings((), ()))
        return whole if baseline is None else whole.since(baseline)

    found = look()
    if fix and (changed := write_fixes(found)):
        typer.echo(f"twolink: corrected {', '.join(map(str, changed))}", err=True)
        found = look()
    typer.echo(spoken(found.formatted(style), REPORTED) if style == "text" else found.formatted(style))
    _, failures = write(out or [], found.save)
    finish(failures, False)
    if any(found.of(level) for level in SEVERITIES[: SEVERITIES.index(fail_on) + 1]):
        raise typer.Exit(FAILED)


COMMANDS = (lint,)
