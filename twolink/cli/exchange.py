"""The commands about other files and programs: compare two models, judge a log, write a robot in another
format.
"""

from pathlib import Path
from typing import Annotated, Any

import typer
from typer import Argument, Option

from twolink.cli.common import (
    FAILED,
    ROBOT_HELP,
    Duration,
    Files,
    Foreign,
    Gravity,
    Json,
    Lock,
    Misuse,
    RobotName,
    Root,
    SceneName,
    completion,
    deliver,
    require_writable,
    robot_from,
    scene_from,
    show,
)
from twolink.exchange.urdf_scene import UrdfScene
from twolink.io.progress import progress_bar
from twolink.io.text import parse_numbers
from twolink.robots.catalogue import catalogue_names
from twolink.show.figure import FORMATS
from twolink.simulation.recording import SAVED

NOT_KNOWN = 3  # the exit code of a log that is neither right nor wrong
CauseSeconds = Annotated[float, Option(help="For how long causes are looked for, s of computing.")]


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
    from twolink.exchange.model_comparison import compare_models

    require_writable(out or [], (".json",))
    first, second = (robot_from(name, root, None, unphysical="report", foreign=foreign) for name in (a, b))
    found = compare_models(first, second, tolerance=tolerance)
    deliver(found.to_dict(), found, out, found.save, as_json)
    if not found.equal:
        raise typer.Exit(FAILED)


def judge(
    scene: SceneName,
    log: Annotated[
        Path, Argument(metavar="LOG", help="A .csv, .npz or .parquet (t, q.JOINT, v.JOINT), or a bag (.mcap, .db3).")
    ],
    start: Annotated[
        str | None,
        Option(
            help="Whether the solution starts from the state of the scene, or the first sample of the log.",
            show_default="scene; of a robot log",
        ),
    ] = None,
    tolerance: Annotated[float, Option(help="A distance that does not count, rad or m.")] = 1e-6,
    seconds: CauseSeconds = 10.0,
    out: Files = None,
    as_json: Json = False,
) -> None:
    """Judge a trajectory of any simulator against the solution.

    It says how far the log is from the solution, since when, how large its local errors are, and what explains them.
    --out writes a figure (.png .svg .pdf) or the verdict (.json). The exit code is 0 when the log is right, 1 when it
    is wrong, and 3 when that is not known: the solution is not known well enough.

    \b
    twolink judge scene.toml log.csv --out verdict.png
    twolink judge arm.xml log.csv                      from the first sample of the log, with all that the file says
    """
    from twolink.hard.referee import judge as judge_log

    require_writable(out or [], (".json", *FORMATS))
    asked = scene_from(scene)
    begin: Any = start or ("log" if isinstance(asked, UrdfScene) else "scene")
    with progress_bar() as report:
        verdict = judge_log(asked, log, start=begin, tolerance=tolerance, seconds=seconds, progress=report)
    deliver(verdict.to_dict(), verdict, out,
            lambda path: (verdict.plot if path.suffix in FORMATS else verdict.save)(path), as_json)  # fmt: skip
    if not verdict.right:
        raise typer.Exit(FAILED if verdict.answer == "wrong" else NOT_KNOWN)


def compare(
    scene: SceneName,
    peer: Annotated[str, Option("--with", help="mujoco, drake or scipy, where installed.")] = "mujoco",
    duration: Duration = None,
    seconds: CauseSeconds = 10.0,
    out: Files = None,
    as_json: Json = False,
) -> None:
    """Judge another simulator's run of a scene.

    MuJoCo runs it at its default setting, or that of the robot's own MJCF; or Drake or SciPy. What the other one does
    not simulate is refused by name. It prints until when the log is right, what is wrong with it, and both costs.
    --out writes a figure (.png .svg .pdf), the verdict (.json), or the log (.csv .mcap ...).

    \b
    twolink compare my.urdf --with mujoco --out compare.png
    """
    from twolink.hard.comparison import compare as compare_with

    require_writable(out or [], (".json", *FORMATS, *SAVED))
    with progress_bar() as report:
        found = compare_with(scene_from(scene), peer, duration, seconds=seconds, progress=report)

    def write_one(path: Path) -> Path:
        suffix = path.suffix.lower()
        return found.plot(path) if suffix in FORMATS else (found.log if suffix in SAVED else found).save(path)

    deliver(found.to_dict(), found, out, write_one, as_json)


def steps(
    model: SceneName,
    peer: Annotated[str, Option("--with", help="mujoco, where it is installed.")] = "mujoco",
    log: Annotated[Path | None, Option(metavar="FILE", help="Torques: t, tau.JOINT; and a start, q, v.")] = None,
    lengths: Annotated[
        str | None, Option("--steps", help="s, such as 0.005,0.001.", show_default="20 to 0.1 ms")
    ] = None,
    duration: Duration = None,
    ground: Annotated[bool, Option("--ground", help="Of a robot: its links touch each other and the ground.")] = False,
    seconds: Annotated[float, Option(help="Of computing; what would take long is left out.")] = 30.0,
    out: Files = None,
    as_json: Json = False,
) -> None:
    """Say which step and integrator of another simulator is enough.

    The truth is our verified run. The options of the model's own MJCF come first. Of soft contacts, stops and friction
    the difference of the models stands apart from the error of the steps. --out writes a figure (.png .svg .pdf) or the
    table (.json).

    \b
    twolink steps arm.xml --log torques.csv --out steps.png
    """
    from twolink.hard.step_table import STEPS, step_table

    require_writable(out or [], (".json", *FORMATS))
    with progress_bar() as report:
        found = step_table(scene_from(model, ground=ground), peer, duration=duration, log=log, seconds=seconds,
                           steps=STEPS if lengths is None else parse_numbers("steps", lengths),
                           progress=report)  # fmt: skip
    deliver(found.to_dict(), found, out,
            lambda path: (found.plot if path.suffix in FORMATS else found.save)(path), as_json)  # fmt: skip


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
        list[str] | None,
        Option("--platform", metavar="PLATFORM", help="Of an FMU: such as x86_64-windows."),
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
    from twolink.exchange.export import export as write

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
    loaded = robot_from(robot, root, lock, gravity)
    of_c = file.suffix.lower() == ".c"
    written = [write(loaded, file, **({"functions": _names(functions)} if of_c else {}))]
    written += [written[0].with_suffix(".h")] if of_c else []
    show({"robot": loaded.name, "written": written}, "\n".join(f"wrote {path}" for path in written), as_json)


def _names(text: str) -> list[str]:
    """Names with commas between them."""
    return [name.strip() for name in text.split(",") if name.strip()]
