"""Options that several commands share, and the robot that they describe."""

from pathlib import Path
from typing import Annotated, Any, cast

from typer import Argument, Option

from twolink.cli.failures import Misuse
from twolink.dynamics import Robot, load_robot
from twolink.dynamics.named_queries import parse_numbers

Json = Annotated[bool, Option("--json", help="Print JSON for programs.")]
Files = Annotated[list[Path] | None, Option("--out", metavar="FILE", help="Write a file, by its ending; repeatable.")]

SceneName = Annotated[str, Argument(metavar="SCENE", help="A bundled scene, or the path of a scene file (.toml).")]
Duration = Annotated[float | None, Option(help="Simulated time, s.", show_default="the scene's")]
Accuracy = Annotated[float, Option(help="Bound on the global error of q, rad or m.")]
Method = Annotated[str, Option(help="auto (the cheapest), or one of `twolink methods`.")]

ROBOT_HELP = "A name (see `twolink robots`), or the path of a URDF."
RobotName = Annotated[str, Argument(metavar="ROBOT", help=ROBOT_HELP)]
Root = Annotated[str, Option(help="Root: fixed to the world, or free (a floating base).")]
Lock = Annotated[list[str] | None, Option(metavar="JOINT=VALUE", help="Lock a joint, rad or m; repeatable.")]
Gravity = Annotated[str, Option(help="Gravity along the world's axes, m/s^2.")]
Mimic = Annotated[bool, Option("--mimic", help="Couple mimic joints; else they move freely.")]
Unphysical = Annotated[str, Option(help="refuse or report physically impossible inertias.")]
Folders = Annotated[
    list[Path] | None, Option("--package-dir", metavar="FOLDER", help="Root of package://; repeatable.")
]


def robot_from(
    source: str, root: Root, lock: Lock, gravity: Gravity, mimic: Mimic, unphysical: Unphysical, package_dirs: Folders
) -> Robot:
    """The robot that the options describe."""
    locks: dict[str, list[float]] = {}
    for text in lock or []:
        name, _, value = (part.strip() for part in text.rpartition("="))
        if not name:
            raise Misuse(f"expected JOINT=VALUE, got {text!r}", where="lock", remedy='such as "elbow=0.5"')
        if name in locks:
            raise Misuse(f"joint {name!r} is given twice", where="lock", remedy="keep one")
        locks[name] = parse_numbers("lock", value)
    field = parse_numbers("gravity", gravity)
    choices = {"root": cast(Any, root), "unphysical": cast(Any, unphysical)}  # load_robot refuses other texts
    return load_robot(source, lock=locks, gravity=field, mimic=mimic, package_dirs=package_dirs or [], **choices)
