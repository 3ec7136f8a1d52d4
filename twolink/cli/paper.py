"""The commands about the paper: its figures and claims, and the throws that it opens with."""

from __future__ import annotations

import dataclasses
import math
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from typer import Argument, Option

from twolink.cli.options import Json
from twolink.cli.output import finish, require_writable, show, write
from twolink.show.figure import FORMATS
from twolink.show.progress import progress_bar

if TYPE_CHECKING:
    from twolink.paper.throw import SearchResult


def paper(out: Annotated[Path, Option(help="Folder of the figures.")] = Path("out"), as_json: Json = False) -> None:
    """Draw the paper's figures 6 to 13 and answer its claims.

    Each claim is answered with a number.
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

    The arm of a bundled scene swings by its torques. The time of the release decides the ball's speed and elevation.
    Some 20 to 40 throws are simulated: arm, flight and landing. First the release time is scanned; then SciPy's bounded
    optimizer varies it, and for a pitch also the time at which the elbow begins to extend. The best throw is solved
    once more for its error bar.

    \b
    twolink throw pitch --out pitch.png
    twolink throw bowl --json
    twolink run pitch --out pitch.html                  the best throw, which the scene holds, in 3D
    """
    from twolink.paper.throw import search  # imports SciPy's optimizers
    from twolink.paper.throw_plot import plot_search

    paths = [] if out is None else [out]
    require_writable(paths, FORMATS)
    with progress_bar() as report:
        result = search(what, accuracy, report)
    written, failures = write(paths, partial(plot_search, result))
    record = _record(result) | {"written": written[0] if written else None}
    show(record, "\n".join([_text(result), *(f"wrote {path}" for path in written)]), as_json)
    finish(failures, result.interrupted)


def _record(search: SearchResult) -> dict[str, Any]:
    """A search as plain data."""
    best, shown = search.best, ("times", "speed", "elevation", "end")
    return {
        "scene": search.name,
        "aim": f"{search.aim.what} ({search.aim.unit})",
        "accuracy": search.accuracy,
        "times": best.times,
        "times_error": search.resolution,
        "best": {name: {"value": getattr(best, name), "error": error} for name, error in best.errors.items()},
        "error": None if best.run.error is None else float(best.run.error.max()),
        "throws": [{name: getattr(one, name) for name in shown} for one in search.tried],
        "seconds": search.seconds,
        "interrupted": search.interrupted,
    }


def _text(search: SearchResult) -> str:
    """A search for people: the best times, and what the best throw reaches."""
    best, aim, degree = search.best, search.aim, np.degrees(1.0)
    lines = [f"{search.name}: the best of {len(search.tried)} throws, each simulated to {search.accuracy:g} rad or m"]
    lines += [_line(f"{what} let go", 1e3 * at, 1e3 * search.resolution, "ms") for what, at in best.times.items()]
    labels = {"shoulder": "shoulder then", "elbow": "elbow then", "end": aim.what}
    for name, error in best.errors.items():
        factor, unit = {"speed": (1.0, "m/s"), "end": (1.0, aim.unit)}.get(name, (degree, "degrees"))
        lines.append(_line(labels.get(name, name), factor * getattr(best, name), factor * error, unit))
    note = "(± of times: resolution of the search; of the others: error bar of this throw)"
    return "\n".join([*lines, f"  {note}  {search.seconds:.1f} s"])


def _line(label: str, value: float, error: float, unit: str) -> str:
    """A value with as many digits as its error allows."""
    digits = max(0, 1 - math.floor(math.log10(error)))
    return f"  {label:<18}{value:>{7 + digits}.{digits}f} ± {error:.1e} {unit}"
