"""The command that turns a saved trajectory into a film or a picture."""

from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from twolink.cli.output import print_not_drawn, require_writable
from twolink.errors import QueryError
from twolink.show.progress import progress_bar


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
    from twolink.simulation.trajectory import Trajectory

    require_writable([out], FORMATS)
    towards = None if camera is None else parse_numbers("camera", camera)
    run = Trajectory.load(file)
    with progress_bar() as report:
        written = run.video(
            out, size=_size(size), rate=rate, speed=speed, at=at, direction=towards, forces=forces,
            curves=[] if curves is None else curves.split(","),
            progress=lambda done, total: report(done, total, f"picture {done} of {total}"), on_skipped=print_not_drawn,
        )  # fmt: skip
    typer.echo(f"wrote {written}")


def _size(text: str) -> tuple[int, int]:
    parts = text.lower().split("x")
    if len(parts) != 2 or not all(part.isascii() and part.isdecimal() for part in parts):
        raise QueryError(f"expected WIDTHxHEIGHT, got {text!r}", argument="size", remedy="such as 1280x720")
    return int(parts[0]), int(parts[1])
