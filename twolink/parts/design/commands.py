"""The commands that design motions: linear equations, the best numbers of a scene, the best time of a throw."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from typer import Argument, Option

from twolink.cli.common import (
    RUN_ENDINGS,
    Accuracy,
    Duration,
    Json,
    SceneName,
    bounds_of,
    deliver,
    finish,
    require_writable,
    scene_from,
    show,
    vector_of,
    write,
    write_by_ending,
)
from twolink.cli.declared import Declared
from twolink.io.progress import progress_bar
from twolink.show.figure import FORMATS
from twolink.simulation.text import as_data

if TYPE_CHECKING:
    from twolink.parts.design.throw import SearchResult


def linearize(
    scene: SceneName,
    q: Annotated[str | None, Option(help="Configuration.", show_default="the scene's")] = None,
    v: Annotated[str | None, Option(help="Velocity.", show_default="the scene's; 0 with --q")] = None,
    t: Annotated[float, Option("--time", help="Time, s, for effects that depend on it.")] = 0.0,
    inputs: Annotated[
        list[str] | None, Option("--input", metavar="JOINT", help="A motor; repeatable.", show_default="every joint")
    ] = None,
    out: Annotated[
        list[Path] | None, Option("--out", metavar="FILE", help="Draw the eigenvalues (.png .svg .pdf).")
    ] = None,
    as_json: Json = False,
) -> None:
    """Find the linear equations of small motions.

    x' = A x + B u, with x = (dq, dv) and torques u at the inputs: A, B, their error, eigenvalues, what kind of
    equilibrium it is, and whether the inputs can control it.

    \b
    twolink linearize arm-swing --q "shoulder=90deg" --input elbow
    twolink linearize panda-hold --out eigenvalues.png --json
    """
    from twolink.parts.design.linearization import linearize as linearize_scene

    require_writable(out or [], FORMATS)
    made = scene_from(scene)
    states = (None if text is None else vector_of(made.robot, name, text) for name, text in (("q", q), ("v", v)))
    found = linearize_scene(made, *states, t=t, inputs=inputs)
    text = f"{found}\nA =\n{found.A}\nB =\n{found.B}"
    deliver({"scene": scene, **found.to_dict()}, text, out, found.plot, as_json, listed="files")


def optimize(
    scene: SceneName,
    wrt: Annotated[list[str], Option(metavar="NAME=LOW:HIGH", help="A number to vary, SI units; repeatable.")],
    objective: Annotated[str, Option(metavar="NAME", help="What is to be least.")],
    maximize: Annotated[bool, Option("--maximize", help="Find the greatest instead.")] = False,
    at_least: Annotated[list[str] | None, Option(metavar="NAME=VALUE", help="A constraint; repeatable.")] = None,
    at_most: Annotated[list[str] | None, Option(metavar="NAME=VALUE", help="A constraint; repeatable.")] = None,
    starts: Annotated[int, Option(min=1, metavar="COUNT", help="Local searches, from different values.")] = 3,
    seed: Annotated[int, Option(metavar="NUMBER", help="Of the starts.")] = 0,
    evaluations: Annotated[int, Option(min=1, metavar="COUNT", help="At most, of all starts.")] = 200,
    duration: Duration = None,
    accuracy: Accuracy = 1e-6,
    keep: Annotated[
        Path | None, Option(metavar="FILE", help="Keep every evaluation; a search that is there goes on.")
    ] = None,
    out: Annotated[
        list[Path] | None,
        Option("--out", metavar="FILE", help="Write the best scene (.toml), or its run by the ending; repeatable."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Find the best values of numbers of a scene.

    Derivatives come from the sensitivities of each run, so that a run gives the slope by all variables at once. Each
    result has its numerical error, how flat the best place is, and whether it is on a bound. Ctrl-C keeps the best.

    \b
    twolink optimize pitch --wrt effects.4.at=0:0.09 --wrt effects.5.at=0.06:0.14 --objective x:ball --maximize
    twolink optimize arm-swing --wrt v.elbow=-3:3 --objective z:forearm --maximize --duration 1 --out best.toml

    \b
    NAME of a number: q.JOINT, v.JOINT, LINK.mass, ..., effects.PLACE.FIELD (its place in the scene, from 0)
    NAME of an objective, at the end of the run: x:LINK, y:LINK, z:LINK, speed:LINK, speed-x:LINK,
          "reach:LINK=X Y Z" (distance), rest:JOINT=VALUE,... (squared distance from rest), energy, time
          of the whole run: effort, smoothness, motion, jerk (integrals of squared torques, accelerations, velocities,
          rates of accelerations); max-q:JOINT, min-q:JOINT, also of v, a, tau (extremes, for limits)
    """  # fmt: skip
    from twolink.parts.design.objectives import named_limit, named_objective
    from twolink.parts.design.optimize import optimize as find

    require_writable(out or [], (".toml", *RUN_ENDINGS))
    loaded = scene_from(scene)
    function = named_objective(objective, loaded.robot)
    sides = ((at_least, 1.0, "at_least"), (at_most, -1.0, "at_most"))
    limits = {text: named_limit(text, loaded.robot, sign, name) for texts, sign, name in sides for text in texts or []}
    with progress_bar() as report:
        found = find(loaded, duration, objective=function, wrt=dict(map(bounds_of, wrt)), accuracy=accuracy,
                     maximize=maximize, constraints=limits, starts=starts, seed=seed, evaluations=evaluations,
                     out=keep, progress=report)  # fmt: skip

    def write_one(path: Path) -> None:
        if path.suffix.lower() == ".toml":
            found.scene.save(path)
        else:
            write_by_ending(found.run, path)

    deliver(found.to_dict(), found, out, write_one, as_json, interrupted=found.interrupted, listed="files")


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
    from twolink.parts.design.throw import plot_search, search  # imports SciPy's optimizer

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
    return {name: as_data(value) for name, value in record.items()}


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


def equilibria() -> Callable[..., Any]:
    """Find where a robot stays at rest, and if stably.

    \b
    twolink equilibria arm-swing --out equilibria.png
    """
    from twolink.parts.design.equilibria import equilibria as function

    return function


def periodic() -> Callable[..., Any]:
    """Find a motion that repeats itself exactly.

    \b
    twolink periodic arm-swing --period 2.5 --vary q.elbow
    """
    from twolink.parts.design.periodic import periodic_motion

    return periodic_motion


def gradient() -> Callable[..., Any]:
    """Differentiate one number of a run by numbers of its scene.

    \b
    twolink gradient arm-swing --duration 1 --objective z:forearm --wrt q --wrt forearm.mass
    """
    from twolink.parts.design.gradient import gradient as function

    return function


COMMANDS = linearize, optimize, throw, Declared(equilibria), Declared(periodic), Declared(gradient, ("slopes",))
