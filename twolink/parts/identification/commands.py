"""The commands that find numbers: parameters of a robot or of a scene in measured motions, and the best values."""

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from twolink.cli.common import (
    Accuracy,
    Files,
    Json,
    RobotLoader,
    RobotName,
    SceneName,
    bounds_of,
    deliver,
    require_writable,
    scene_from,
    with_robot_options,
)
from twolink.io.progress import progress_bar
from twolink.io.tables import SUFFIXES
from twolink.show.figure import FORMATS

ENDINGS = (".toml", ".urdf", ".png", ".svg", ".pdf")


Names = Annotated[
    list[str] | None,
    Option(metavar="NAMES", help="Parameters, with commas; * stands for any text; repeatable.",
           show_default="all of the links"),
]  # fmt: skip
JointModel = Annotated[
    str | None,
    Option(
        metavar="WORDS",
        help="Of drives: viscous+coulomb+rotor+offset+stribeck:0.1, auto or none.",
        show_default="auto; none with --parameters",
    ),
]
Window = Annotated[
    int | None, Option(min=3, metavar="COUNT", help="Samples on each side of the filter.", show_default="by the data")
]
Written = Annotated[
    list[Path] | None,
    Option("--out", metavar="FILE", help="Write a .urdf with what was found, or a figure (.png .svg .pdf)."),
]


@with_robot_options
def identify(
    robot: RobotName,
    data: Annotated[list[Path], Argument(metavar="DATA...", help="Runs: .csv, .parquet, .npz, .mat, .mcap or .db3.")],
    parameters: Names = None,
    joint_model: JointModel = None,
    find: Annotated[
        str,
        Option(
            metavar="WORDS",
            help="Also delay, zero, gravity, motor_constant, with commas; none.",
            show_default="a delay that shows",
        ),
    ] = "",
    columns: Annotated[Path | None, Option(metavar="FILE", help="A map of columns (.toml).")] = None,
    units: Annotated[str, Option(help="Of the files, such as deg,ms,A.", show_default="SI units, radians")] = "",
    decimate: Annotated[int, Option(min=1, metavar="COUNT", help="Samples that become their mean.")] = 1,
    validate: Annotated[
        list[Path] | None, Option(metavar="FILE", help="A run kept out of the fit; repeatable.")
    ] = None,
    method: Annotated[str, Option(help="weighted, ordinary, robust (outliers), total (noisy positions).")] = "weighted",
    half_window: Window = None,
    cutoff: Annotated[float | None, Option(metavar="HZ", help="The filter's, in place of its window.")] = None,
    confidence: Annotated[float, Option(help="Probability of the intervals.")] = 0.95,
    html: Annotated[Path | None, Option(metavar="FILE", help="Write the report, one .html file.")] = None,
    out: Written = None,
    *,
    load: RobotLoader,
    as_json: Json = False,
) -> None:
    """Find masses, inertias and friction in measured motions.

    Joint torques are linear in the parameters: tau = Y(q, v, a) pi. Each value comes with an interval; what the
    motion cannot show is named, not fitted; the bodies found can exist. Friction, rotors and offsets, the filter and a
    delay are chosen by what predicts left-out torques best.

    \b
    twolink identify arm log.csv --parameters "forearm.*,*.damping,*.friction" --out found.urdf
    twolink identify panda log.parquet --lock panda_finger_joint1=0 --lock panda_finger_joint2=0 --json
    twolink identify arm.urdf runs/*.csv --columns map.toml --units deg,A --validate last.csv --html report.html

    \b
    DATA: columns t, q0, q1, ... (or q.JOINT), tau0, ...; v0, ... and a0, ... may be missing:
          positions are then filtered and differentiated. A column run tells the runs of a file apart.
    MAP:  t = "stamp", q.JOINT = "column", tau.JOINT = {column = "current", scale = 2.76, offset = 0}
          coupling = [[1, 0], [1, 1]] of v_joint = C v_motor, where the log is of motors
    UNITS: rad deg turn rpm; s ms us ns; Nm mNm A (looks for motor constants)
    NAMES, of a LINK that moves, about the frame of its joint:
          LINK.mass, LINK.first_moment.x|y|z (m c), LINK.origin_inertia.xx|xy|yy|xz|yz|zz
          of a JOINT: JOINT.damping (viscous), JOINT.friction (Coulomb), JOINT.armature (rotor)
    """  # fmt: skip
    from twolink.parts.identification.found_urdf import write_urdf
    from twolink.parts.identification.identify import identify as find_in
    from twolink.parts.identification.log_files import read_log

    files = [*(out or []), *([html] if html else [])]
    require_writable(files, (".urdf", *FORMATS, ".html"))
    loaded = load(robot)
    of_setup = [*(_words(find) if find != "none" else []), *(["motor_constant"] if "A" in _words(units) else [])]
    logs, held_out = ([read_log(loaded, path, columns, _words(units), decimate) for path in paths]
                  for paths in (data, validate or []))  # fmt: skip
    found = find_in(loaded, [log.table for log in logs], parameters=parameters and _words(*parameters),
                    joint_model=joint_model, find=of_setup or (() if find else None), method=method,
                    half_window=half_window, cutoff=cutoff, confidence=confidence,
                    validate=[log.table for log in held_out] or None)  # fmt: skip
    notes = [note for log in (*logs, *held_out) for note in log.notes]

    def write_one(path: Path) -> Path:
        if path.suffix.lower() == ".html":
            return found.report(path, notes)
        return write_urdf(found, robot, path) if path.suffix.lower() == ".urdf" else found.plot(path)

    text = "\n".join([str(found), *(f"note: {note}" for note in notes)])
    deliver(found.to_dict() | {"notes": notes}, text, files, write_one, as_json, listed="files")


@with_robot_options
def excite(
    robot: RobotName,
    duration: Annotated[float, Option(help="The period of the motion, s.")] = 10.0,
    parameters: Names = None,
    rate: Annotated[float, Option(metavar="HZ", help="Samples per second.")] = 100.0,
    acceleration: Annotated[float | None, Option(help="Limit of all joints, rad/s^2 or m/s^2.")] = None,
    noise: Annotated[
        float | None, Option(help="Of the torques, N m or N.", show_default="1 % of each joint's largest")
    ] = None,
    steps: Annotated[int, Option(min=0, metavar="COUNT", help="Of the optimiser.")] = 10,
    seed: Annotated[int, Option(metavar="NUMBER", help="Of the first guesses.")] = 0,
    out: Files = None,
    *,
    load: RobotLoader,
    as_json: Json = False,
) -> None:
    """Make a motion that shows a robot's parameters.

    A Fourier series between ramps from and to rest, within the limits of positions, speeds, accelerations and torques,
    in which links do not touch each other. The surroundings are not known: watch the motion before it is made.

    \b
    twolink excite arm --out motion.csv
    twolink excite panda --duration 20 --acceleration 5 --rate 1000 --out motion.csv
    """
    from twolink.dynamics.arguments import positive
    from twolink.errors import QueryError
    from twolink.parts.identification.excitation import exciting_motion

    require_writable(out or [], SUFFIXES)
    samples = round(positive(duration, "duration", QueryError, "such as 10") *
                    positive(rate, "rate", QueryError, "such as 100")) + 1  # fmt: skip
    found = exciting_motion(load(robot), duration, parameters and _words(*parameters), samples=samples, steps=steps,
                            seed=seed, acceleration=acceleration, ramps=True)  # fmt: skip
    table = found.intervals(noise)
    more = f" (with more, {found.limit})" if found.limit else ""
    head = (f"{found.t[-1]:.4g} s with ramps, {found.share:.0%} of the range{more}, condition {found.condition:.3g}; "
            "95 % intervals to expect:")  # fmt: skip
    record = {"duration": found.t[-1], "share": found.share, "limit": found.limit, "condition": found.condition,
              "expected": table.to_records()}  # fmt: skip
    deliver(record, f"{head}\n\n{table}", out, found.save, as_json, listed="files")


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
    bounds: Annotated[list[str] | None, Option(metavar="NAME=LOW:HIGH", help="Of a value; repeatable.")] = None,
    patience: Annotated[float, Option(help="Seconds, after which the best so far is kept.")] = 600.0,
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
    from twolink.parts.identification.found_urdf import write_urdf
    from twolink.parts.identification.scene_fit import fit as find

    require_writable(out or [], ENDINGS)
    loaded = scene_from(scene)
    with progress_bar() as report:
        found = find(loaded, data, _words(*parameters), sigma=sigma, method=method, segments=segments,
                     accuracy=accuracy, bounds=dict(bounds_of(text, "bounds") for text in bounds or []),
                     patience=patience, confidence=confidence, progress=report)  # fmt: skip

    def write_one(path: Path) -> Path:
        if path.suffix.lower() == ".toml":
            return found.scene.save(path)
        if path.suffix.lower() == ".urdf":
            return write_urdf(found, loaded.base.visuals.text, path)
        return found.plot(path)

    record = found.to_dict() | {"scene": scene}
    deliver(record, found, out, write_one, as_json, interrupted=found.interrupted, listed="files")


def _words(*texts: str) -> list[str]:
    """The words of an option, which have commas between them."""
    return [word.strip() for text in texts for word in text.split(",") if word.strip()]


COMMANDS = identify, excite, fit
