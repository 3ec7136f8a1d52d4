"""The commands that show something in a browser or as a film: a saved trajectory; and the service with its page."""

import os
from pathlib import Path
from typing import Annotated, Literal

import typer
from typer import Argument, Option

from twolink.cli.common import (
    ROBOT_HELP,
    Misuse,
    RobotLoader,
    print_address,
    print_not_drawn,
    require_writable,
    with_robot_options,
)
from twolink.dynamics import Robot
from twolink.dynamics.arguments import positive
from twolink.errors import QueryError, import_extra, require_extra
from twolink.io.progress import progress_bar
from twolink.simulation.trajectory import Trajectory


@with_robot_options
def play(
    file: Annotated[Path, Argument(metavar="FILE", help="A saved trajectory: .npz, .parquet or .csv.")],
    speed: Annotated[
        float | None, Option(help="Factor on true speed: 2 is twice as fast.", show_default="1; below 1 s, less")
    ] = None,
    html: Annotated[Path | None, Option(help="Write a standalone page instead of opening a browser.")] = None,
    no_browser: Annotated[bool, Option("--no-browser", help="Print the address; open no browser.")] = False,
    robot: Annotated[str | None, Option(help=f"Of a file that does not name it (.csv). {ROBOT_HELP}")] = None,
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
    run = _saved(file, None if robot is None else load(robot))
    if html is None:
        run.play(speed=speed, open_browser=not no_browser, on_url=print_address, on_skipped=print_not_drawn)
    else:
        typer.echo(f"wrote {run.playback(html, speed=speed, on_skipped=print_not_drawn)}")


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
    robot: Annotated[str | None, Option(help=f"Of a file that does not name it. {ROBOT_HELP}")] = None,
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
    run = _saved(file, None if robot is None else load(robot))
    with progress_bar() as report:
        written = run.video(
            out, size=_size(size), rate=rate, speed=speed, at=at, direction=towards, forces=forces,
            curves=[] if curves is None else curves.split(","),
            progress=report, on_skipped=print_not_drawn,
        )  # fmt: skip
    typer.echo(f"wrote {written}")


def _saved(file: Path, robot: Robot | None = None) -> Trajectory:
    """The run in a file; the name of a scene is refused with the command that makes one."""
    if not file.suffix and not file.exists():
        remedy = f"make one: twolink run {file} --out {file.name}.npz"
        raise Misuse("expected the file of a saved run", where=str(file), remedy=remedy)
    return Trajectory.load(file, robot)


def _size(text: str) -> tuple[int, int]:
    parts = text.lower().split("x")
    if len(parts) != 2 or not all(part.isascii() and part.isdecimal() for part in parts):
        raise QueryError(f"expected WIDTHxHEIGHT, got {text!r}", argument="size", remedy="such as 1280x720")
    return int(parts[0]), int(parts[1])


Token = Annotated[
    list[str] | None, Option(metavar="TEXT", help="Ask for this bearer token, NAME:TOKEN of an owner; repeatable.")
]
Admin = Annotated[list[str] | None, Option(metavar="NAME", help="Owner who manages what all have; repeatable.")]
Database = Annotated[
    str, Option(metavar="URL", help="PostgreSQL that several services share; needs --store.", show_default=False)
]
ObjectStore = Annotated[
    str, Option(metavar="URL", help="Object store that they share, such as s3://bucket.", show_default=False)
]


def serve(
    host: Annotated[str, Option(help="Address to listen on; 0.0.0.0 is all of this machine's.")] = "127.0.0.1",
    port: Annotated[int, Option(min=0, max=65535, metavar="PORT", help="0 takes a free one.")] = 8000,
    data: Annotated[
        str | None, Option(metavar="PATH", help="Folder of the results.", show_default="your user data folder")
    ] = None,
    token: Token = None,
    admin: Admin = None,
    quota: Annotated[list[str] | None, Option(metavar="NAME=NUMBER", help="A limit; --quota help lists them.")] = None,
    allow_host: Annotated[list[str] | None, Option(metavar="NAME", help="Another name of it; repeatable.")] = None,
    allow_origin: Annotated[list[str] | None, Option(metavar="URL", help="Site that may call it; repeatable.")] = None,
    log: Annotated[
        Literal["text", "json", "off"], Option(help="Form of the log; off: without a line a request.")
    ] = "text",
    delete_results: Annotated[
        bool, Option("--delete-results", help="Delete results that are beyond the quota.")
    ] = False,
    dask: Annotated[str, Option(metavar="ADDRESS", help="Dask scheduler for sweeps.", show_default=False)] = "",
    database: Database = "",
    store: ObjectStore = "",
    root_path: Annotated[str, Option(metavar="PATH", help="The path below which it is.", show_default=False)] = "",
) -> None:
    """Serve queries, simulations and the page over HTTP.

    Without --host only this machine reaches it. Addresses always name it; --allow-host adds names. --allow-origin is a
    site whose pages may call it, such as https://lab.example. TWOLINK_TOKEN holds tokens too, with commas between;
    other users of this machine cannot read it. TWOLINK_DATABASE and TWOLINK_STORE stand for --database and --store.
    --data is the folder of uploads, jobs and results.

    \b
    twolink serve                                       then open http://127.0.0.1:8000/
    curl -s 127.0.0.1:8000/v1/robots/two_link/forward-dynamics -d '{"q": [0, 0], "tau": [1, 0]}'
    TWOLINK_TOKEN=secret twolink serve --host 0.0.0.0   for others too; they send Authorization: Bearer secret
    twolink serve --quota jobs=4 --quota disk_mb=20000
    twolink serve --dask tcp://scheduler:8786           one service for a group with a cluster
    twolink serve --database postgresql://db/twolink --store s3://bucket    one of several; --data is its own

    The API is described at /docs and /openapi.json; `tl.connect("http://127.0.0.1:8000")` asks it from Python. Results
    survive a restart, and jobs that were not done are taken up by the next start. Ctrl-C ends the service.
    """
    from twolink.service.settings import Quotas, Settings, default_folder, is_loopback, read_quotas

    if quota and "help" in quota:
        for name, value in zip(Quotas.__struct_fields__, Quotas.__struct_defaults__, strict=True):
            typer.echo(f"{name}={value}")
        return
    of_environment = os.environ["TWOLINK_TOKEN"].split(",") if "TWOLINK_TOKEN" in os.environ else ()
    settings = Settings(
        data=str(default_folder()) if data is None else data,
        host=host,
        port=port,
        tokens=tuple(text.strip() for text in (*(token or ()), *of_environment)),
        admins=tuple(admin or []),
        hosts=tuple(allow_host or []),
        origins=tuple(allow_origin or []),
        quotas=read_quotas(quota or []),
        log=log,
        delete_results=delete_results,
        dask=dask,
        database=database or os.environ.get("TWOLINK_DATABASE", ""),
        store=store or os.environ.get("TWOLINK_STORE", ""),
        root_path=root_path,
    )
    if not is_loopback(host) and not settings.tokens:
        typer.echo(f"twolink: anybody who reaches {host} may use it; --token asks for one", err=True)
    server = import_extra("twolink.service.http.server", "service")
    data_note = f"(data in {settings.data}; Ctrl-C ends it)"
    server.run(settings, on_start=lambda url: typer.echo(f"twolink serves {url}  {data_note}"))


def mcp(
    folder: Annotated[
        Path, Option(metavar="PATH", help="Where files are read and written.", show_default="this folder")
    ] = Path(),
) -> None:
    """Serve tools for agents over stdin and stdout (MCP).

    Tools: catalogue, load_robot, query, explain, simulate, accuracy_study, linearize, judge, compare_models, export.
    They read and write in one folder only. Needs pip install 'twolink[mcp]'.

    \b
    {"mcpServers": {"twolink": {"command": "twolink", "args": ["mcp", "--folder", "robots"]}}}
    """
    require_extra("mcp", "mcp")
    from twolink.cli.agents import Tools

    Tools(folder).server().run("stdio")
