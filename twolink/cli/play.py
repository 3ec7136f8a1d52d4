"""The commands that show something in a browser or as a film: what twolink does, and saved trajectories."""

from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from twolink.cli.common import (
    ROBOT_HELP,
    Html,
    Misuse,
    NoBrowser,
    RobotLoader,
    print_not_drawn,
    require_writable,
    scene_from,
    show_motion,
    with_robot_options,
)
from twolink.dynamics.arguments import positive
from twolink.errors import QueryError
from twolink.io.progress import progress_bar
from twolink.robots.catalogue import catalogue_names
from twolink.scenes import bundled_scenes
from twolink.simulation.trajectory import Trajectory

ACCURACIES = (1e-3, 1e-6, 1e-9, 1e-12)
SavedRobot = Annotated[str | None, Option(help=f"Of a file that does not name it; or the run's scene. {ROBOT_HELP}")]


def demo(html: Html = None, no_browser: NoBrowser = False) -> None:
    """Show in half a minute what twolink does.

    It ends with the paper's arm moving in the browser.

    \b
    twolink demo
    twolink demo --html demo.html        a page to keep instead of a browser
    """
    from twolink.lagrange.check import check
    from twolink.scenes import load_scene
    from twolink.simulation.scene_run import simulate

    require_writable([] if html is None else [html], (".html",))
    typer.echo("1/3  the paper's two-link arm: hand-derived equations against Pinocchio, 1,000 random arms")
    rows = {row.quantity: row for row in check(n=1000).rows}
    wrong = [name for name, row in rows.items() if row.misprinted]
    typer.echo(f"     accelerations agree to {rows['acceleration, ABA'].corrected:.0e} of their size; "
               f"the paper's print errs in {' and '.join(wrong)}")  # fmt: skip
    scene = load_scene("arm-swing")
    typer.echo(f"2/3  what accuracy costs: the arm swings for {scene.duration:g} s")
    for accuracy in ACCURACIES:
        times = list[float]()
        for _ in range(3):  # the first run warms up, and others may be disturbed
            run = simulate(scene, accuracy=accuracy)
            if run.cost is not None:
                times.append(run.cost.seconds + run.cost.verify_seconds)
        if run.error is not None:
            typer.echo(f"     asked for {accuracy:.0e} rad: error at most {run.error[-1]:.0e} rad, solved in "
                       f"{1e3 * min(times):.1f} ms")  # fmt: skip
    typer.echo("3/3  the motion in the browser" if html is None else "3/3  the motion as a page")
    show_motion(run, html, no_browser)


@with_robot_options
def play(
    file: Annotated[Path, Argument(metavar="FILE", help="A saved trajectory: .npz, .parquet or .csv.")],
    speed: Annotated[
        float | None, Option(help="Factor on true speed: 2 is twice as fast.", show_default="1; below 1 s, less")
    ] = None,
    html: Html = None,
    no_browser: NoBrowser = False,
    robot: SavedRobot = None,
    *,
    load: RobotLoader,
) -> None:
    """Play a saved trajectory in the browser.

    \b
    twolink play run.npz --speed 0.5
    twolink play run.npz --html run.html                a standalone page, which needs no twolink
    """
    require_writable([] if html is None else [html], (".html",))
    if speed is not None:
        positive(speed, "speed", QueryError, "1 is true speed")
    run = _saved(file, robot, load)
    show_motion(run, html, no_browser, speed)


@with_robot_options
def video(
    file: Annotated[Path, Argument(metavar="FILE", help="A saved trajectory: .npz or .parquet.")],
    out: Annotated[Path, Argument(metavar="OUT", help="The film (.mp4 .webm .gif), or a picture (.png).")],
    size: Annotated[str, Option(metavar="WxH", help="Pixels of the robot's picture, even numbers.")] = "960x720",
    rate: Annotated[float, Option(help="Pictures a second.")] = 30.0,
    speed: Annotated[
        float | None, Option(help="Factor on true speed: 2 is twice as fast.", show_default="1, less below 1 s")
    ] = None,
    at: Annotated[float | None, Option(help="The time of a picture, s.", show_default="the first")] = None,
    camera: Annotated[
        str | None, Option(metavar='"X Y Z"', help="Direction from the robot to the camera.", show_default="by itself")
    ] = None,
    forces: Annotated[bool, Option("--forces", help="Draw forces on links, not of contacts alone.")] = False,
    curves: Annotated[str | None, Option(help="Quantities to draw beside it, such as q.elbow,energy.")] = None,
    robot: SavedRobot = None,
    *,
    load: RobotLoader,
) -> None:
    """Make a film of a saved trajectory, or a picture of a moment.

    It needs no display and no browser.

    \b
    twolink run arm-swing --out run.npz
    twolink video run.npz run.mp4 --curves q.shoulder,q.elbow
    twolink video run.npz moment.png --at 2.5 --camera "0 -1 0.3"
    """
    from twolink.io.text import parse_numbers
    from twolink.show.video import FORMATS

    require_writable([out], FORMATS)
    towards = None if camera is None else parse_numbers("camera", camera)
    run = _saved(file, robot, load)
    with progress_bar() as report:
        written = run.video(
            out, size=_size(size), rate=rate, speed=speed, at=at, direction=towards, forces=forces,
            curves=[] if curves is None else [name.strip() for name in curves.split(",")],
            progress=report, on_skipped=print_not_drawn,
        )  # fmt: skip
    typer.echo(f"wrote {written}")


def _saved(file: Path, robot: str | None, load: RobotLoader) -> Trajectory:
    """The run in a file; the name of a scene is refused with the command that makes one. robot: its scene's, too."""
    if not file.suffix and not file.exists():
        remedy = f"make one: twolink run {file} --out {file.name}.npz"
        raise Misuse("expected the file of a saved run", where=str(file), remedy=remedy)
    if robot is None:
        return Trajectory.load(file)
    of_scene = robot.endswith(".toml") or (robot in bundled_scenes() and robot not in catalogue_names())
    return Trajectory.load(file, scene_from(robot, load).robot if of_scene else load(robot))


def _size(text: str) -> tuple[int, int]:
    parts = text.lower().split("x")
    if len(parts) != 2 or not all(part.isascii() and part.isdecimal() for part in parts):
        raise QueryError(f"expected WIDTHxHEIGHT, got {text!r:.60}", argument="size", remedy="such as 1280x720")
    return int(parts[0]), int(parts[1])
