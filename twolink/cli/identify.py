"""The command that finds parameters of a robot in measured motions."""

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from twolink.cli.options import Folders, Gravity, Json, Lock, Mimic, RobotName, Root, Unphysical, robot_from
from twolink.cli.output import finish, require_writable, show, write
from twolink.show.figure import FORMATS


def identify(
    robot: RobotName,
    data: Annotated[Path, Argument(metavar="DATA", help="Measurements: a .csv, .parquet or .npz file.")],
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
    half: Annotated[
        int | None, Option(min=3, metavar="COUNT", help="Samples on each side of the filter.", show_default="by noise")
    ] = None,
    confidence: Annotated[float, Option(help="Probability of the intervals.")] = 0.95,
    out: Annotated[
        list[Path] | None,
        Option("--out", metavar="FILE", help="Write a .urdf with what was found, or a figure (.png .svg .pdf)."),
    ] = None,
    root: Root = "fixed",
    lock: Lock = None,
    gravity: Gravity = "0 0 -9.81",
    mimic: Mimic = False,
    unphysical: Unphysical = "refuse",
    package_dirs: Folders = None,
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
    loaded = robot_from(robot, root, lock, gravity, mimic, unphysical, package_dirs)
    wanted = None if parameters is None else [name.strip() for text in parameters for name in text.split(",")]
    found = find(loaded, **read_measurements(loaded, data), parameters=wanted, method=method, half=half,
                 confidence=confidence)  # fmt: skip

    def write_one(path: Path) -> Path:
        return write_urdf(found, robot, path) if path.suffix.lower() == ".urdf" else found.plot(path)

    written, failures = write(out or [], write_one)
    files = "".join(f"\nwrote {path}" for path in written)
    show(found.to_dict() | {"files": written}, f"{found}{files}", as_json)
    finish(failures, interrupted=False)
