"""The command `throw`: when to let go of a ball, by searching."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from twolink.cli.options import misuse
from twolink.cli.printing import print_json
from twolink.cli.scenes import KEPT, Bar
from twolink.cli.writing import require_formats
from twolink.errors import TwolinkError
from twolink.show.figure import FORMATS

if TYPE_CHECKING:
    from twolink.paper.throw import Throw, Throws


def register(app: typer.Typer) -> None:
    """Add the command to the command line."""
    app.command()(throw)


def throw(
    what: Annotated[str, typer.Argument(help="pitch: the farthest throw. bowl: the fastest ball at the pins.")],
    accuracy: Annotated[float, typer.Option(help="Bound on the global error of q of each throw, rad or m.")] = 1e-6,
    out: Annotated[Path | None, typer.Option(help="Draw a figure (.png .svg .pdf).")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON for programs.")] = False,
) -> None:
    """Find when to let go of a ball: which angles of the arm, and which elevation, throw best.

    The arm of a bundled scene swings by its torques; when it lets go decides the ball's speed and elevation. Some 20 to
    40 throws are simulated, arm, flight and landing: first the release time is scanned, then SciPy's bounded optimizers
    vary it, and for a pitch also the time at which the elbow begins to extend. The best is solved once more for its
    error bar.

    \b
    twolink throw pitch --out pitch.png
    twolink throw bowl --json
    twolink run pitch --out pitch.html                  the best throw, which the scene holds, in 3D
    """
    from twolink.paper.throw import search  # with it come SciPy's optimizers

    require_formats([] if out is None else [out], FORMATS)
    with misuse("what", "accuracy"), Bar(quiet=not sys.stderr.isatty()) as bar:
        found = search(what, accuracy, bar)
    failure = None
    if out is not None:
        from twolink.paper.throw_plot import plot_throws

        try:
            plot_throws(found, out)
        except TwolinkError as error:
            failure = error
    written = None if out is None or failure else out
    if as_json:
        print_json(_summary(found) | {"written": written})
    else:
        typer.echo(_text(found))
        if written:
            typer.echo(f"wrote {written}")
    if failure:
        raise failure
    if found.interrupted:
        raise TwolinkError("interrupted", remedy=KEPT)


def _plain(throw: Throw) -> dict[str, Any]:
    return {"times": dict(throw.times), "speed": throw.speed, "elevation": throw.elevation, "end": throw.end}


def _summary(found: Throws) -> dict[str, Any]:
    best, errors = found.best, found.best.errors or {}
    return {
        "scene": found.name,
        "aim": f"{found.aim.what} ({found.aim.unit})",
        "accuracy": found.accuracy,
        "times": dict(best.times),
        "times_error": found.sharp,
        "best": {name: {"value": value, "error": errors[name]} for name, value in best.quantities.items()},
        "error": None if best.run.error is None else float(best.run.error.max()),
        "throws": [_plain(one) for one in found.tried],
        "seconds": found.seconds,
        "interrupted": found.interrupted,
    }


def _text(found: Throws) -> str:
    best, aim = found.best, found.aim
    lines = [f"{found.name}: the best of {len(found.tried)} throws, each simulated to {found.accuracy:g} rad or m"]
    for what, at in best.times.items():
        lines.append(_line(f"{what} let go", 1e3 * at, 1e3 * found.sharp, "ms"))
    for name, value in best.quantities.items():
        turn = name not in ("speed", "end")
        factor, unit = (np.degrees(1.0), "degrees") if turn else (1.0, "m/s" if name == "speed" else aim.unit)
        label = aim.what if name == "end" else f"{name} then" if turn and name != "elevation" else name
        lines.append(_line(label, factor * value, factor * (best.errors or {})[name], unit))
    lines.append(f"  (times: to what the search resolves; the others: of this throw)  {found.seconds:.1f} s")
    return "\n".join(lines)


def _line(label: str, value: float, error: float, unit: str) -> str:
    digits = max(0, 1 - math.floor(math.log10(error)))
    return f"  {label:<18}{value:>{7 + digits}.{digits}f} ± {error:.1e} {unit}"
