"""The commands about other programs' files: compare two models, write a robot in another format."""

from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from twolink.cli.common import (
    FAILED,
    ROBOT_HELP,
    Files,
    Foreign,
    Gravity,
    Json,
    Lock,
    Misuse,
    RobotName,
    Root,
    completion,
    deliver,
    require_writable,
    robot_from,
    scene_from,
    show,
)
from twolink.robots.catalogue import catalogue_names


def diff(
    a: Annotated[str, Argument(metavar="A", help=ROBOT_HELP, autocompletion=completion(catalogue_names))],
    b: Annotated[str, Argument(metavar="B", help="The other one.", autocompletion=completion(catalogue_names))],
    root: Root = "fixed",
    foreign: Foreign = "refuse",
    tolerance: Annotated[float, Option(help="Relative; of lengths, of the robot's reach.")] = 1e-6,
    out: Files = None,
    as_json: Json = False,
) -> None:
    """Say whether two robots are the same mechanism, or why not.

    Each difference has its place and cause. Names of links, the order of joints, fixed joints and the frames of
    inertias do not count. --out writes the comparison (.json). The exit code is 1 when they differ.

    \b
    twolink diff arm.urdf converted.urdf
    """
    from twolink.parts.exchange.model_comparison import compare_models

    require_writable(out or [], (".json",))
    first, second = (robot_from(name, root, None, unphysical="report", foreign=foreign) for name in (a, b))
    found = compare_models(first, second, tolerance=tolerance)
    deliver(found.to_dict(), found, out, found.save, as_json)
    if not found.equal:
        raise typer.Exit(FAILED)


def export(
    robot: RobotName,
    file: Annotated[
        Path | None, Argument(metavar="FILE", help="The file to write: .c (and its header), .urdf, .xml or .fmu.")
    ] = None,
    fmu: Annotated[
        Path | None, Option(help="The same as FILE.fmu: a scene, given in place of the robot.", metavar="FILE.fmu")
    ] = None,
    parameters: Annotated[
        str | None, Option(help="Of an FMU: numbers that can be set in it, such as forearm.mass,gravity.z.")
    ] = None,
    platforms: Annotated[
        list[str] | None, Option("--platform", metavar="PLATFORM", help="Of an FMU: such as x86_64-windows.")
    ] = None,
    functions: Annotated[
        str, Option(help="Of C: such as forward_dynamics,mass_matrix,frame_pose:tip,step:rk4.")
    ] = "forward_dynamics,step:rk4",
    root: Root = "fixed",
    lock: Lock = None,
    gravity: Gravity = None,
    as_json: Json = False,
) -> None:
    """Write a robot as C, URDF or MJCF, or a scene as an FMU.

    The C99 file needs nothing but libm and allocates nothing. It holds its certificate and a self test. The URDF has
    merged bodies, locked joints fixed, and inertias about centres of mass; so has the MJCF. The FMU
    is for Model Exchange and Co-Simulation.

    \b
    twolink export panda panda.c --functions forward_dynamics,mass_matrix
    twolink export panda arm.urdf --lock panda_finger_joint1=0 --lock panda_finger_joint2=0
    twolink export arm-swing arm.fmu
    """
    from twolink.parts.exchange.export import export as write

    if fmu is None and file is not None and file.suffix.lower() == ".fmu":
        file, fmu = None, file
    if (parameters or platforms) if fmu is None else (lock or gravity or root != "fixed"):
        raise Misuse("--parameters and --platform are of an FMU, --root, --lock and --gravity of a robot",
                     remedy="leave them out")  # fmt: skip
    if fmu is not None and file is None:
        require_writable([fmu], (".fmu",))
        fmu = write(scene_from(robot), fmu, parameters=parameters and _names(parameters), platforms=platforms)
        show({"scene": robot, "written": [fmu]}, f"wrote {fmu}", as_json)
        return
    if fmu is not None or file is None:
        raise Misuse("one file is written", remedy="give a FILE, of a scene FILE.fmu")
    require_writable([file], (".c", ".urdf", ".xml", ".fmu"))
    if gravity and file.suffix.lower() == ".urdf":
        raise Misuse("a URDF has no gravity", remedy="leave --gravity out, or write an .xml")
    loaded = robot_from(robot, root, lock, gravity)
    of_c = file.suffix.lower() == ".c"
    written = [write(loaded, file, **({"functions": _names(functions)} if of_c else {}))]
    written += [written[0].with_suffix(".h")] if of_c else []
    show({"robot": loaded.name, "written": written}, "\n".join(f"wrote {path}" for path in written), as_json)


def _names(text: str) -> list[str]:
    """Names with commas between them."""
    return [name.strip() for name in text.split(",") if name.strip()]


COMMANDS = diff, export
