"""The commands that find numbers: parameters of a robot or of a scene in measured motions, and the best values."""

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from twolink.cli.common import (
    RUN_ENDINGS,
    Accuracy,
    Duration,
    Json,
    Misuse,
    RobotLoader,
    RobotName,
    SceneName,
    deliver,
    require_writable,
    scene_from,
    with_robot_options,
    write_by_ending,
)
from twolink.io.progress import progress_bar
from twolink.show.figure import FORMATS

ENDINGS = (".toml", ".urdf", ".png", ".svg", ".pdf")


@with_robot_options
def identify(
    robot: RobotName,
    data: Annotated[Path, Argument(metavar="DATA", help="Measurements: a .csv, .parquet, .npz, .mcap or .db3 file.")],
    parameters: Annotated[
        list[str] | None,
        Option(
            metavar="NAMES",
            help="What to find, with commas; * stands for any text; repeatable.",
            show_default="all of the links",
        ),
    ] = None,
    method: Annotated[
        str, Option(help="weighted, ordinary, robust (outliers) or total (noisy positions).")
    ] = "weighted",
    half_window: Annotated[
        int | None, Option(min=3, metavar="COUNT", help="Samples on each side of the filter.", show_default="by noise")
    ] = None,
    confidence: Annotated[float, Option(help="Probability of the intervals.")] = 0.95,
    out: Annotated[
        list[Path] | None,
        Option("--out", metavar="FILE", help="Write a .urdf with what was found, or a figure (.png .svg .pdf)."),
    ] = None,
    *,
    load: RobotLoader,
    as_json: Json = False,
) -> None:
    """Find masses, inertias and friction in measured motions.

    Joint torques are linear in the parameters: tau = Y(q, v, a) pi. Each value comes with an interval; what the
    motion cannot show is named, not fitted; the bodies found can exist.

    \b
    twolink identify arm log.csv --parameters "forearm.*,*.damping,*.friction" --out found.urdf
    twolink identify panda log.parquet --lock panda_finger_joint1=0 --lock panda_finger_joint2=0 --json

    \b
    DATA: columns t, q0, q1, ... (or q.JOINT), tau0, ...; v0, ... and a0, ... may be missing:
          positions are then filtered and differentiated. SI units, radians.
    NAMES, of a LINK that moves, about the frame of its joint:
          LINK.mass, LINK.first_moment.x|y|z (m c), LINK.origin_inertia.xx|xy|yy|xz|yz|zz
          of a JOINT: JOINT.damping (viscous), JOINT.friction (Coulomb), JOINT.armature (rotor)
    """  # fmt: skip
    from twolink.identification.found_urdf import write_urdf
    from twolink.identification.identify import identify as find
    from twolink.identification.measurements import read_measurements

    require_writable(out or [], (".urdf", *FORMATS))
    loaded = load(robot)
    wanted = None if parameters is None else [name.strip() for text in parameters for name in text.split(",")]
    found = find(loaded, **read_measurements(loaded, data), parameters=wanted, method=method, half_window=half_window,
                 confidence=confidence)  # fmt: skip

    def write_one(path: Path) -> Path:
        return write_urdf(found, robot, path) if path.suffix.lower() == ".urdf" else found.plot(path)

    deliver(found.to_dict(), found, out, write_one, as_json, listed="files")


def fit(
    scene: SceneName,
    data: Annotated[Path, Argument(metavar="DATA", help="Measurements: a .csv, .parquet, .npz, .mcap or .db3 file.")],
    parameters: Annotated[
        list[str], Option(metavar="NAMES", help="What to find, with commas; * stands for any text; repeatable.")
    ],
    method: Annotated[str, Option(help="weighted, or robust (outliers).")] = "weighted",
    sigma: Annotated[
        float | None, Option(help="Standard deviation of the measurements.", show_default="from the residuals")
    ] = None,
    segments: Annotated[
        int | None, Option(min=1, metavar="COUNT", help="Of multiple shooting.", show_default="by the motion")
    ] = None,
    accuracy: Accuracy = 1e-6,
    confidence: Annotated[float, Option(help="Probability of the intervals.")] = 0.95,
    out: Annotated[
        list[Path] | None,
        Option("--out", metavar="FILE", help="Write the .toml scene or the .urdf found, or a figure (.png .svg .pdf)."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Find numbers of a scene that make its motion the measured one.

    The motion is simulated, with its sensitivities; no torques need to be measured. Each value comes with an interval;
    what the measurements cannot show is named, not fitted. Ctrl-C keeps the best so far.

    \b
    twolink fit arm-human log.csv --parameters "forearm.mass,effects.1.damping.*" --out fit.png
    twolink fit arm-human log.csv --parameters "forearm.*" --parameters q,v --json

    \b
    DATA: columns t, from the scene's start, and q.JOINT or v.JOINT of one joint or more. SI units, radians.
    NAMES: LINK.mass, LINK.com.x|y|z, LINK.inertia.xx|xy|xz|yy|yz|zz (about the centre of mass); or, about the frame
          of its joint, LINK.first_moment.x|y|z (m c), LINK.origin_inertia.xx|...; JOINT.armature,
          JOINT.origin.x|y|z; gravity.x|y|z; effects.1.damping.JOINT and other numbers of effects;
          q, v, q.JOINT, v.JOINT: the initial state
    """  # fmt: skip
    from twolink.identification.found_urdf import write_urdf
    from twolink.identification.scene_fit import fit as find

    require_writable(out or [], ENDINGS)
    loaded = scene_from(scene)
    names = [name.strip() for text in parameters for name in text.split(",")]
    with progress_bar() as report:
        found = find(loaded, data, names, sigma=sigma, method=method, segments=segments, accuracy=accuracy,
                     confidence=confidence, progress=report)  # fmt: skip

    def write_one(path: Path) -> Path:
        if path.suffix.lower() == ".toml":
            return found.scene.save(path)
        if path.suffix.lower() == ".urdf":
            return write_urdf(found, loaded.base.visuals.text, path)
        return found.plot(path)

    record = found.to_dict() | {"scene": scene}
    deliver(record, found, out, write_one, as_json, interrupted=found.interrupted, listed="files")


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
        found = find(loaded, duration, objective=function, wrt=dict(map(_bounds, wrt)), accuracy=accuracy,
                     maximize=maximize, constraints=limits, starts=starts, seed=seed, evaluations=evaluations,
                     out=keep, progress=report)  # fmt: skip

    def write_one(path: Path) -> None:
        if path.suffix == ".toml":
            found.scene.save(path)
        else:
            write_by_ending(found.run, path)

    deliver(found.to_dict(), found, out, write_one, as_json, interrupted=found.interrupted, listed="files")


def _bounds(text: str) -> tuple[str, tuple[float, float]]:
    """A variable's name and bounds from NAME=LOW:HIGH."""
    name, _, pair = text.partition("=")
    try:
        low, high = (float(number) for number in pair.split(":"))
    except ValueError:
        raise Misuse(f"expected NAME=LOW:HIGH, got {text!r}", where="wrt", remedy='such as "v.elbow=-1:1"') from None
    return name.strip(), (low, high)
