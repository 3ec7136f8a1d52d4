"""The commands that show evidence: the hard cases, the paper's figures and claims, and its throws."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer import Argument, Option

from twolink.cli.common import FAILED, Json, finish, require_writable, show

if TYPE_CHECKING:
    from twolink.hard import Case, CaseResult


def hard_cases(
    names: Annotated[list[str] | None, Argument(metavar="NAME", help="Cases, groups, or parts of names.")] = None,
    as_json: Json = False,
    html: Annotated[Path | None, Option(help="Write the report as a page (.html).")] = None,
    peers: Annotated[bool, Option("--peers", help="Run SciPy, MuJoCo and Drake too, where installed.")] = False,
    quick: Annotated[bool, Option("--quick", help="Leave out the slow cases, and name them.")] = False,
    listed: Annotated[bool, Option("--list", help="List the cases and why each is hard; run none.")] = False,
) -> None:
    """Run cases that break simulators.

    For each case it prints why the case is hard, its true answer, and what accuracy twolink reaches at what cost. The
    exit code is 1 when a case neither meets its error bar nor says that it does not.

    \b
    twolink hard-cases --list
    twolink hard-cases chaos upright-balance
    twolink hard-cases --peers --html hard.html
    """
    from twolink.hard import select_cases
    from twolink.hard.page import summary, write_page

    cases = select_cases(names, quick=quick)
    paths = [] if html is None else [html]
    require_writable(paths, (".html",))
    if listed:
        for case in cases:
            typer.echo(f"{case.name:<24}{case.title}{' (slow)' if case.slow else ''}\n{'':<24}{case.why}")
        return
    results = _run(cases, peers=peers, silent=as_json)
    for path in paths:
        write_page(results, path)
    slow = [case.name for case in select_cases(names) if case.slow] if quick else []
    text = "\n".join(["", summary(results, slow), *(f"wrote {path}" for path in paths)])
    record = {"cases": [result.to_dict() for result in results], "left_out": slow, "written": paths}
    show(record, text, as_json)
    finish([], len(results) < len(cases) or any(result.interrupted for result in results))
    if not all(result.passed for result in results):
        raise typer.Exit(FAILED)


def _run(cases: tuple[Case, ...], *, peers: bool, silent: bool) -> list[CaseResult]:
    """The results, each printed when its case is done; after Ctrl-C those so far, the last one interrupted."""
    from twolink.hard import run_case
    from twolink.hard.page import HEAD, lines

    results: list[CaseResult] = []
    if not silent:
        typer.echo(HEAD)
    try:
        for case in cases:
            results.append(run_case(case, peers=peers))
            if not silent:
                typer.echo("\n".join(lines(results[-1])))
            if results[-1].interrupted:
                break
    except KeyboardInterrupt:
        if not results:
            raise
    return results


def paper(out: Annotated[Path, Option(help="Folder of the figures.")] = Path("out"), as_json: Json = False) -> None:
    """Draw the paper's figures 6 to 13 and answer its claims.

    Each claim is answered with a number, or is an opinion. Two more figures show link one beyond -pi, as in Fig. 6, and
    what ode45 at its default tolerances makes of the release.
    """
    from twolink.paper.figures import study

    result = study(out)
    show(dataclasses.asdict(result), result.text(), as_json)
