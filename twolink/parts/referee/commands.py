"""The commands of the referee: judge a log, another simulator's run, or its steps."""

from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer
from typer import Argument, Option

from twolink.cli.common import (
    FAILED,
    Duration,
    Files,
    Json,
    SceneName,
    deliver,
    require_writable,
    scene_from,
    write_by_ending,
)
from twolink.io.progress import progress_bar
from twolink.io.text import parse_numbers
from twolink.scenes.urdf_scene import UrdfScene
from twolink.show.figure import FORMATS
from twolink.simulation.recording import SAVED
from twolink.simulation.text import RESULT_FILES

NOT_KNOWN = 3  # the exit code of a log that is neither right nor wrong
CauseSeconds = Annotated[float, Option(help="For how long causes are looked for, s of computing.")]


def judge(
    scene: SceneName,
    logs: Annotated[
        list[Path],
        Argument(metavar="LOG...", help="A .csv, .csv.gz, .npz or .parquet, or a bag (.mcap, .db3), of any simulator."),
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
    """Judge trajectories of any simulator against the solution.

    It says how far a log is from the solution, since when, how large its local errors are, and what explains them; of
    several logs, which one is nearer. --out writes a figure (.png .svg .pdf), a page (.html) or the verdict (.json).
    The exit code is 0 when all logs are right, 1 when one is wrong, and 3 when that is not known: the solution is not
    known well enough.

    \b
    twolink judge scene.toml log.csv --out verdict.html
    twolink judge arm.xml mujoco.npz isaac.csv         from the first sample of each, with all that the file says
    """
    from twolink.parts.referee.referee import judge_many

    require_writable(out or [], (*RESULT_FILES, *FORMATS))
    asked = scene_from(scene)
    begin: Any = start or ("log" if isinstance(asked, UrdfScene) else "scene")
    with progress_bar() as report:
        many = judge_many(asked, {str(log): log for log in logs}, start=begin, tolerance=tolerance, seconds=seconds,
                          progress=report)  # fmt: skip
    first, *more = many.verdicts.values()
    found = many if more else first
    deliver(found.to_dict(), found, out, partial(write_by_ending, found), as_json)
    answers = {verdict.answer for verdict in many.verdicts.values()}
    if answers != {"right"}:
        raise typer.Exit(FAILED if "wrong" in answers else NOT_KNOWN)


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
    --out writes a figure (.png .svg .pdf), a page (.html), the verdict (.json), or the log (.csv .mcap ...).

    \b
    twolink compare my.urdf --with mujoco --out compare.png
    """
    from twolink.parts.referee.comparison import compare as compare_with

    require_writable(out or [], (*RESULT_FILES, *FORMATS, *SAVED))
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
    the difference of the models stands apart from the error of the steps. --out writes a figure (.png .svg .pdf),
    a page (.html) or the table (.json).

    \b
    twolink steps arm.xml --log torques.csv --out steps.png
    """
    from twolink.parts.referee.step_table import STEPS, step_table

    require_writable(out or [], (*RESULT_FILES, *FORMATS))
    with progress_bar() as report:
        found = step_table(scene_from(model, ground=ground), peer, duration=duration, log=log, seconds=seconds,
                           steps=STEPS if lengths is None else parse_numbers("steps", lengths),
                           progress=report)  # fmt: skip
    deliver(found.to_dict(), found, out, partial(write_by_ending, found), as_json)


COMMANDS = judge, compare, steps
