"""The commands that show evidence: the hard cases, the paper's figures and claims, and its throws."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer
from typer import Argument, Option

from twolink.cli.common import FAILED, Json, finish, require_writable, show, write
from twolink.io.progress import progress_bar
from twolink.show.figure import FORMATS

if TYPE_CHECKING:
    from twolink.hard import Case, CaseResult
    from twolink.paper.throw import SearchResult


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


def throw(
    what: Annotated[str, Argument(help="pitch: the farthest throw. bowl: the fastest ball at the pins.")],
    accuracy: Annotated[float, Option(help="Bound on the global error of q of each throw, rad or m.")] = 1e-6,
    out: Annotated[Path | None, Option(help="Draw a figure (.png .svg .pdf).")] = None,
    as_json: Json = False,
) -> None:
    """Find the best time to release a ball.

    The arm of a bundled scene swings by its torques. The time of the release decides the ball's speed and elevation;
    for a pitch, the time at which the elbow begins to extend is found too. Each of some ten runs of arm, flight and
    landing gives the slopes by all times. The answer says what a millisecond costs.

    \b
    twolink throw pitch --out pitch.png
    twolink throw bowl --json
    twolink run pitch --out pitch.html                  the best throw, which the scene holds, in 3D
    """
    from twolink.paper.throw import plot_search, search  # imports SciPy's optimizer

    paths = [] if out is None else [out]
    require_writable(paths, FORMATS)
    with progress_bar() as report:
        result = search(what, accuracy, report)
    written, failures = write(paths, partial(plot_search, result))
    record = _record(result) | {"written": written[0] if written else None}
    show(record, "\n".join([_text(result), *(f"wrote {path}" for path in written)]), as_json)
    finish(failures, result.found.interrupted)


def _record(search: SearchResult) -> dict[str, Any]:
    """A search as plain data."""
    best, found = search.best, search.found
    by_time = {what: {"slope": slope, "error": error, "curvature": curvature} | {"unit": f"{search.aim.unit}/s"}
               for what, (slope, error, curvature) in search.by_time.items()}  # fmt: skip
    record = {
        "scene": search.name,
        "aim": f"{search.aim.what} ({search.aim.unit})",
        "accuracy": search.accuracy,
        "times": best.times,
        "times_error": search.resolution,
        "by_time": by_time,
        "best": {name: {"value": getattr(best, name), "error": error} for name, error in best.errors.items()},
        "error": None if best.run.error is None else float(best.run.error.max()),
        "history": found.history.to_records(),
        "simulations": found.simulations,
        "seconds": search.seconds,
        "interrupted": found.interrupted,
    }
    return {name: _without_nan(value) for name, value in record.items()}


def _without_nan(value: Any) -> Any:
    """Plain data with None in place of numbers that are not known."""
    if isinstance(value, Mapping):
        return {key: _without_nan(item) for key, item in value.items()}
    return None if isinstance(value, float) and math.isnan(value) else value


def _text(search: SearchResult) -> str:
    """A search for people: the best times, what the best throw reaches, and what a millisecond costs."""
    best, aim, found, degree = search.best, search.aim, search.found, np.degrees(1.0)
    lines = [f"{search.name}: the best throw, after {len(found.history)} throws with derivatives "
             f"({found.simulations} runs), each to {search.accuracy:g} rad or m"]  # fmt: skip
    lines += [_line(f"{what} let go", 1e3 * at, 1e3 * search.resolution[what], "ms") for what, at in best.times.items()]
    labels = {"shoulder": "shoulder then", "elbow": "elbow then", "end": aim.what}
    for name, error in best.errors.items():
        factor, unit = {"speed": (1.0, "m/s"), "end": (1.0, aim.unit)}.get(name, (degree, "degrees"))
        lines.append(_line(labels.get(name, name), factor * getattr(best, name), factor * error, unit))
    for what, (slope, error, curvature) in search.by_time.items():
        lines.append(_line(f"by {what}'s time", 1e-3 * slope, 1e-3 * error, f"{aim.unit} per ms"))
        if not math.isnan(curvature):
            lines.append(f"    1 ms early or late: {0.5e-6 * curvature:+.2g} {aim.unit}")
    note = "(± of times: what the error of the aim leaves open; of the others: error bars)"
    return "\n".join([*lines, f"  {note}  {search.seconds:.1f} s"])


def _line(label: str, value: float, error: float, unit: str) -> str:
    """A value with as many digits as its error allows."""
    if math.isnan(error):
        return f"  {label:<18}{value:>10.3f} (error not known) {unit}"
    digits = max(0, 1 - math.floor(math.log10(error)))
    return f"  {label:<18}{value:>{7 + digits}.{digits}f} ± {error:.1e} {unit}"
