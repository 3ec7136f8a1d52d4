"""Options that several commands share, and the robot that they describe."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Annotated, Any, cast

from typer import Argument, Option

from twolink.cli.failures import Misuse
from twolink.dynamics import Robot, load_robot
from twolink.effects.constants import Gravity as GravityEffect
from twolink.integrate.methods import METHODS
from twolink.io.text import parse_numbers
from twolink.robots.catalogue import catalogue_names
from twolink.scenes import Scene, bundled_scenes, load_scene


def completion(known: Callable[[], Iterable[str]]) -> Callable[[str], list[str]]:
    """Completion by the shell: the known names that begin as the incomplete one does."""
    return lambda incomplete: [name for name in known() if name.startswith(incomplete)]


Json = Annotated[bool, Option("--json", help="Print JSON for programs.")]
Files = Annotated[list[Path] | None, Option("--out", metavar="FILE", help="Write a file, by its ending; repeatable.")]

SceneName = Annotated[
    str,
    Argument(
        metavar="SCENE",
        help="A bundled scene, a scene file (.toml), or a URDF: the robot alone under gravity.",
        autocompletion=completion(bundled_scenes),
    ),
]
Duration = Annotated[float | None, Option(help="Simulated time, s.", show_default="the scene's")]
Accuracy = Annotated[float, Option(help="Bound on the global error of q, rad or m.")]
ContactWay = Annotated[
    str | None,
    Option("--contact", metavar="WAY", help="located (verified) or stepped (estimated).", show_default="by the scene"),
]
Method = Annotated[
    str,
    Option(help="auto (the cheapest), or one of `twolink methods`.", autocompletion=completion(lambda: METHODS)),
]

ROBOT_HELP = "A name (see `twolink robots`), or the path of a URDF."
RobotName = Annotated[str, Argument(metavar="ROBOT", help=ROBOT_HELP, autocompletion=completion(catalogue_names))]
Root = Annotated[str, Option(help="Root: fixed to the world, or free (a floating base).")]
Lock = Annotated[list[str] | None, Option(metavar="JOINT=VALUE", help="Lock a joint, rad or m; repeatable.")]
Gravity = Annotated[str, Option(help="Gravity along the world's axes, m/s^2.")]
Mimic = Annotated[bool, Option("--mimic", help="Couple mimic joints; else they move freely.")]
Unphysical = Annotated[str, Option(help="refuse or report physically impossible inertias.")]
Folders = Annotated[
    list[Path] | None, Option("--package-dir", metavar="FOLDER", help="Root of package://; repeatable.")
]


def robot_from(
    source: str,
    root: Root,
    lock: Lock,
    gravity: Gravity = "0 0 -9.81",
    mimic: Mimic = False,
    unphysical: Unphysical = "refuse",
    package_dirs: Folders = None,
) -> Robot:
    """The robot that the options describe."""
    locks, field = locks_of(lock), parse_numbers("gravity", gravity)
    choices = {"root": cast(Any, root), "unphysical": cast(Any, unphysical)}  # load_robot refuses other texts
    return load_robot(source, lock=locks, gravity=field, mimic=mimic, package_dirs=package_dirs or [], **choices)


def locks_of(lock: Lock) -> dict[str, list[float]]:
    """The locked joints' configurations."""
    locks: dict[str, list[float]] = {}
    for text in lock or []:
        name, _, value = (part.strip() for part in text.rpartition("="))
        if not name:
            raise Misuse(f"expected JOINT=VALUE, got {text!r}", where="lock", remedy='such as "elbow=0.5"')
        if name in locks:
            raise Misuse(f"joint {name!r} is given twice", where="lock", remedy="keep one")
        locks[name] = parse_numbers("lock", value)
    return locks


def scene_from(source: str) -> Scene:
    """A bundled scene, or that of a file; of a URDF the robot alone, released at rest under gravity."""
    if not source.endswith(".urdf"):
        return load_scene(source)
    robot = load_robot(source)
    return Scene(robot, effects=[GravityEffect()], title=f"{robot.name}, released at rest under gravity")
