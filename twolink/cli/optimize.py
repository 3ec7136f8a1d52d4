"""The command that finds the best values of numbers of a scene."""

from functools import partial
from pathlib import Path
from typing import Annotated, Any

from typer import Option

from twolink.cli.failures import Misuse
from twolink.cli.options import Accuracy, Duration, Json, SceneName, scene_from
from twolink.cli.output import RUN_ENDINGS, finish, require_writable, show, write, write_by_ending
from twolink.show.progress import progress_bar


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
    from twolink.optimization.objectives import named_limit, named_objective
    from twolink.optimization.optimize import optimize as find

    require_writable(out or [], (".toml", *RUN_ENDINGS))
    loaded = scene_from(scene)
    function = named_objective(objective, loaded.robot)
    sides = ((at_least, 1.0, "at_least"), (at_most, -1.0, "at_most"))
    limits = {text: named_limit(text, loaded.robot, sign, name) for texts, sign, name in sides for text in texts or []}
    with progress_bar() as report:
        found = find(loaded, dict(map(_bounds, wrt)), function, maximize=maximize, constraints=limits, starts=starts,
                     seed=seed, duration=duration, accuracy=accuracy, evaluations=evaluations, out=keep,
                     progress=report)  # fmt: skip
    written, failures = write(out or [], partial(_write, found))
    files = "".join(f"\nwrote {path}" for path in written)
    show(found.to_dict() | {"files": written}, f"{found}{files}", as_json)
    finish(failures, found.interrupted)


def _bounds(text: str) -> tuple[str, tuple[float, float]]:
    """A variable's name and bounds from NAME=LOW:HIGH."""
    name, _, pair = text.partition("=")
    try:
        low, high = (float(number) for number in pair.split(":"))
    except ValueError:
        raise Misuse(f"expected NAME=LOW:HIGH, got {text!r}", where="wrt", remedy='such as "v.elbow=-1:1"') from None
    return name.strip(), (low, high)


def _write(found: Any, path: Path) -> None:
    if path.suffix == ".toml":
        found.scene.save(path)
    else:
        write_by_ending(found.run, path)
