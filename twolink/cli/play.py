"""The command that plays a saved trajectory."""

from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from twolink.cli.options import ROBOT_HELP, Folders, Gravity, Lock, Mimic, Root, Unphysical, robot_from
from twolink.cli.output import print_address, print_not_drawn, require_writable
from twolink.dynamics.arguments import positive
from twolink.errors import QueryError


def play(
    file: Annotated[Path, Argument(metavar="FILE", help="A saved trajectory: .npz, .parquet or .csv.")],
    speed: Annotated[
        float | None, Option(help="Factor on true speed: 2 is twice as fast.", show_default="1; below 1 s, less")
    ] = None,
    html: Annotated[Path | None, Option(help="Write a standalone page instead of opening a browser.")] = None,
    no_browser: Annotated[bool, Option("--no-browser", help="Print the address; open no browser.")] = False,
    robot: Annotated[str | None, Option(help=f"Of a file that does not name it (.csv). {ROBOT_HELP}")] = None,
    root: Root = "fixed",
    lock: Lock = None,
    gravity: Gravity = "0 0 -9.81",
    mimic: Mimic = False,
    unphysical: Unphysical = "refuse",
    package_dirs: Folders = None,
) -> None:
    """Play a saved trajectory in the browser.

    \b
    twolink play run.npz --speed 0.5
    twolink play run.npz --html run.html                a standalone page, which needs no twolink
    """
    from twolink.simulation.trajectory import Trajectory

    require_writable([] if html is None else [html], (".html",))
    if speed is not None:
        positive(speed, "speed", QueryError, "1 is true speed")
    loaded = None if robot is None else robot_from(robot, root, lock, gravity, mimic, unphysical, package_dirs)
    run = Trajectory.load(file, loaded)
    if html is None:
        run.play(speed=speed, open_browser=not no_browser, on_url=print_address, on_skipped=print_not_drawn)
    else:
        typer.echo(f"wrote {run.playback(html, speed=speed, on_skipped=print_not_drawn)}")
