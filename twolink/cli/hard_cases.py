"""The command about hard cases: run them, print a table or JSON, write the page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from twolink.cli.options import misuse
from twolink.cli.printing import print_json
from twolink.cli.writing import require_formats


def register(app: typer.Typer) -> None:
    """Add the command to the command line."""
    app.command("hard-cases")(hard_cases)


def hard_cases(
    names: Annotated[
        list[str] | None, typer.Argument(help="Cases, groups, or parts of names; all when left out.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON for programs.")] = False,
    html: Annotated[Path | None, typer.Option(help="Write the report as one page (.html).")] = None,
    peers: Annotated[bool, typer.Option("--peers", help="Run SciPy, MuJoCo and Drake too, where installed.")] = False,
    quick: Annotated[bool, typer.Option("--quick", help="Leave out the slow cases.")] = False,
    listed: Annotated[
        bool, typer.Option("--list", help="List the cases and why each is hard, and run nothing.")
    ] = False,
) -> None:
    """Run cases that break simulators: why each is hard, the truth, what we get, what it costs.

    Exit code 1 when a case neither meets its bar nor says that it does not.

    \b
    twolink hard-cases --list
    twolink hard-cases chaos upright-balance
    twolink hard-cases --peers --html hard.html
    """
    from twolink.hard import chosen, run_case
    from twolink.hard.table import HEAD, lines, summary

    with misuse("hard_cases"):
        cases = chosen(names, quick=quick)
    if html is not None:
        require_formats([html], (".html",))
    if listed:
        for case in cases:
            typer.echo(f"{case.name:<24}{case.title}{' (slow)' if case.slow else ''}\n{'':<24}{case.why}")
        return
    results = []
    if not as_json:
        typer.echo(HEAD)
    for case in cases:
        result = run_case(case, peers=peers)
        results.append(result)
        for line in () if as_json else lines(result):
            typer.echo(line)
    if html is not None:
        from twolink.hard.page import write_page

        write_page(results, html)
    if as_json:
        print_json({"cases": [r.to_dict() for r in results], "written": [] if html is None else [html]})
    else:
        typer.echo(f"\n{summary(results)}" + ("" if html is None else f"\nwrote {html}"))
    if not all(r.passed for r in results):
        raise typer.Exit(1)
