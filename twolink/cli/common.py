"""The common parts of commands: their options and the robot that these describe, their output, and their failures
with exit codes: 1 failed, 2 misused, 130 interrupted.
"""

import functools
import json
import os
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from inspect import Signature, signature
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from typer import Argument, Option
from typer.core import TyperCommand

from twolink.cli.wording import spoken
from twolink.dynamics import Robot, load_robot
from twolink.dynamics.arguments import by_joint
from twolink.errors import TwolinkError, require_extra
from twolink.integrate.steps.methods import METHODS
from twolink.io.tables import SUFFIXES, require_format
from twolink.io.text import parse_numbers
from twolink.robots.catalogue import catalogue_entry, catalogue_names
from twolink.scenes import Scene, bundled_scenes
from twolink.scenes.urdf_scene import is_robot, named_scene, scene_of
from twolink.show.figure import FORMATS
from twolink.simulation.recording import SAVED, SHOWN
from twolink.simulation.trajectory import Trajectory

FAILED, MISUSED, INTERRUPTED = 1, 2, 130
_CALLS = ("load_robot", "load_scene")  # places in Python, which mean nothing on a command line
RUN_ENDINGS = (*SAVED, *FORMATS, *SHOWN)
STUDY_ENDINGS = (*FORMATS, ".json", *SUFFIXES)


class CommandFailure(TwolinkError):
    """A failure in the words of the command line, with its exit code."""

    def __init__(self, error: TwolinkError, options: dict[str, str], exit_code: int) -> None:
        where = "" if error.where in _CALLS else error.where
        name, rest = re.fullmatch(r"(\w*)(.*)", where, re.DOTALL).groups()  # type: ignore[union-attr]
        where = options[name] + rest if error.argument in ("", name) and name in options else where
        super().__init__(spoken(error.what, options), where=where, remedy=spoken(error.remedy, options))
        self.exit_code = exit_code


LIBRARIES = {".parquet": ("pyarrow", "sweeps"), ".mcap": ("rosbags", "mcap"), ".db3": ("rosbags", "mcap"),
             ".rrd": ("rerun", "rerun"), ".mp4": ("imageio_ffmpeg", "video"),
             ".webm": ("imageio_ffmpeg", "video")}  # fmt: skip
"""Of files by their ending: the library that writes them, and the extra of twolink that installs it."""


class Misuse(TwolinkError):
    """The command was called wrongly."""

    exit_code = MISUSED


class Interrupted(TwolinkError):
    """Ctrl-C ended a command whose results so far were printed and written."""

    exit_code = INTERRUPTED

    def __init__(self) -> None:
        super().__init__("interrupted", remedy="what was done is kept")


class Command(TyperCommand):
    """A command. Its failures name its options; one is misuse when its argument is missing or was given wrongly."""

    def invoke(self, ctx: Any) -> Any:
        """Call the command's function."""
        try:
            return super().invoke(ctx)
        except TwolinkError as error:
            option = error.argument.partition("[")[0]  # the argument of "lock['elbow']" is lock
            source = ctx.get_parameter_source(option)
            wrong = source is not None and source.name == "COMMANDLINE" and not isinstance(ctx.params[option], Path)
            misused = wrong or error.code == "missing-option"
            code = getattr(error, "exit_code", MISUSED if misused else FAILED)
            raise CommandFailure(error, _options(ctx.command.params), code) from error


def _options(parameters: Iterable[Any]) -> dict[str, str]:
    """The options of a command by the names of their arguments in Python."""
    options = {p.name: p.opts[0] for p in parameters if p.param_type_name == "option"}
    return options | ({"verify": "--no-verify"} if "no_verify" in options else {})


def show(record: Any, text: object, as_json: bool) -> None:
    """Print the record as one line of JSON, or the text.

    Arrays are lists and paths are texts. Numbers that are not finite are refused, because JSON has none.
    """
    typer.echo(json.dumps(record, default=_plain, allow_nan=False) if as_json else text)


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else os.fspath(value)


def show_motion(run: Trajectory, html: Path | None, no_browser: bool, speed: float | None = None) -> None:
    """Play a run in the browser, or write the page `html`."""
    if html is None:
        run.play(speed=speed, open_browser=not no_browser, on_skipped=print_not_drawn,
                 on_url=lambda url: typer.echo(f"playing at {url} (Ctrl-C ends it)"))  # fmt: skip
    else:
        typer.echo(f"wrote {run.playback(html, speed=speed, on_skipped=print_not_drawn)}")


def print_not_drawn(names: Sequence[str]) -> None:
    """Name the shapes that cannot be drawn, on stderr."""
    typer.echo(f"twolink: not drawn: {', '.join(names)}", err=True)


def require_writable(paths: Sequence[Path], endings: Sequence[str]) -> None:
    """Refuse files with other endings, or that cannot be written, before the work begins.

    Raises Misuse; MissingExtraError where the library that writes the format is not installed.

    The folder of a file may be new, but not the folder that it is in.
    """
    for path in paths:
        suffix = require_format(path, endings, Misuse)
        if suffix in LIBRARIES:
            require_extra(*LIBRARIES[suffix])
        folder = path.absolute().parent
        folder = folder if folder.exists() else folder.parent
        if not folder.is_dir():
            raise Misuse(f"cannot be written: there is no folder {folder}", where=str(path), remedy="make it first")
        if not os.access(folder, os.W_OK):
            raise Misuse("cannot be written", where=str(path), remedy="give a file in a folder of yours")


def write(paths: Sequence[Path], write_one: Callable[[Path], object]) -> tuple[list[Path], list[TwolinkError]]:
    """Write a result into each file. A file that fails does not keep the result from the others."""
    written: list[Path] = []
    failures: list[TwolinkError] = []
    for path in paths:
        try:
            write_one(path)
            written.append(path)
        except TwolinkError as error:
            failures.append(error)
    return written, failures


def write_by_ending(result: Any, path: Path) -> None:
    """Write a run, or another result, into a file by its ending."""
    suffix = path.suffix.lower()
    if suffix == ".html" and isinstance(result, Trajectory):
        result.playback(path, on_skipped=print_not_drawn)
    else:
        (result.plot if suffix in FORMATS else result.save)(path)


def deliver(
    record: Mapping[str, Any], text: object, paths: Sequence[Path] | None, write_one: Callable[[Path], object],
    as_json: bool, *, interrupted: bool = False, listed: str = "written", line: str = "wrote",
    lacking: Sequence[TwolinkError] = (),
) -> None:  # fmt: skip
    """Write a result into each file, print it with them, and end the command as `finish` does.

    listed: the key of the files in the record. line: what stands before each in the text. lacking: why parts of the
    result are not there.
    """
    written, failures = write(paths or [], write_one)
    show({**record, listed: written}, "\n".join([str(text), *(f"{line} {path}" for path in written)]), as_json)
    finish([*failures, *lacking], interrupted)


def finish(failures: Sequence[TwolinkError], interrupted: bool) -> None:
    """End a command whose results are printed and written. Raises its first failure, or Interrupted."""
    if failures:
        raise failures[0]
    if interrupted:
        raise Interrupted


def completion(known: Callable[[], Iterable[str]]) -> Callable[[str], list[str]]:
    """Completion by the shell: the known names that begin as the incomplete one does."""
    return lambda incomplete: [name for name in known() if name.startswith(incomplete)]


Json = Annotated[bool, Option("--json", help="Print JSON for programs.")]
Files = Annotated[list[Path] | None, Option("--out", metavar="FILE", help="Write a file, by its ending; repeatable.")]

Html = Annotated[Path | None, Option(help="Write a standalone page instead of opening a browser.")]
NoBrowser = Annotated[bool, Option("--no-browser", help="Print the address; open no browser.")]

_SCENE_HELP = "A bundled scene, a scene file (.toml), or a robot: with all that its file says."
SceneName = Annotated[str, Argument(metavar="SCENE", help=_SCENE_HELP, autocompletion=completion(bundled_scenes))]
Duration = Annotated[float | None, Option(help="Simulated time, s.", show_default="the scene's")]
Accuracy = Annotated[float, Option(help="Bound on the global error of q, rad or m.")]
AskedAccuracy = Annotated[
    float | None,
    Option(help="Bound on the global error of q, rad or m. Of a stepped scene, unless given: the best within a minute.",
           show_default="1e-06"),
]  # fmt: skip
SampleTimes = Annotated[
    str | None,
    Option("--t-eval", metavar="TIMES", help="Times of the samples, s, such as 0.1,0.5,2.", show_default="regular"),
]
ContactWay = Annotated[
    str | None,
    Option("--contact", metavar="WAY", help="located (verified) or stepped (estimated).", show_default="by the scene"),
]
_METHOD_HELP = "auto (the cheapest), or one of `twolink methods`."
Method = Annotated[str, Option(help=_METHOD_HELP, autocompletion=completion(lambda: METHODS))]

ROBOT_HELP = "A name (see `twolink robots`), or the path of a URDF, xacro or MJCF."
RobotName = Annotated[str, Argument(metavar="ROBOT", help=ROBOT_HELP, autocompletion=completion(catalogue_names))]
Root = Annotated[str, Option(help="Root: fixed to the world, or free (a floating base).")]
Lock = Annotated[list[str] | None, Option(metavar="JOINT=VALUE", help="Lock a joint, rad, m, or as 30deg; repeatable.")]
Gravity = Annotated[
    str | None, Option(help="Gravity along the world's axes, m/s^2.", show_default="0 0 -9.81, or the MJCF's")
]
Mimic = Annotated[bool, Option("--mimic", help="Couple mimic joints; else they move freely.")]
Unphysical = Annotated[str, Option(help="refuse or report physically impossible inertias.")]
Foreign = Annotated[str, Option(help="refuse or report names that a URDF has not, and MJCF without counterpart.")]
Purpose = Annotated[str, Option(help="dynamics; kinematics or identification take missing inertias.")]
Folders = Annotated[
    list[Path] | None, Option("--package-dir", metavar="FOLDER", help="Root of package://; repeatable.")
]
Xacro = Annotated[str, Option(help="expand xacro, or ignore: leave it out of a finished URDF, and report it.")]
XacroArguments = Annotated[
    list[str] | None, Option("--xacro-argument", metavar="NAME=VALUE", help="Of a xacro; repeatable.")
]
RobotLoader = functools.partial[Robot]


def sample_times_of(text: SampleTimes) -> list[float] | None:
    """The times that the option names."""
    return None if text is None else parse_numbers("t_eval", text)


def vector_of(robot: Robot, name: str, text: str, letter: str = "", others: Any = None) -> Any:
    """The vector of an option: numbers, or JOINT=VALUE for some joints, as `by_joint` takes them."""
    if "=" not in text:
        return parse_numbers(name, text, 'such as "0.1 0.2"; a unit needs the joint\'s name: "JOINT=20deg"')
    parts = re.split(r"[\s,;]+(?=[^\s,;=]+\s*=)", text.strip())
    pairs = _pairs(parts, name, 'JOINT=VALUE, such as "elbow=30 deg"')
    return by_joint(robot, letter or name, {joint: _entries(name, value) for joint, value in pairs.items()},
                    argument=name, others=others)  # fmt: skip


def _entries(name: str, text: str) -> Any:
    """Numbers of a joint, or the text if it has a unit."""
    return text if re.search(r"[a-zA-Z](\^2)?$", text.rstrip()) else parse_numbers(name, text)


def robot_from(
    source: str,
    root: Root = "fixed",
    lock: Lock = None,
    gravity: Gravity = None,
    mimic: Mimic = False,
    unphysical: Unphysical = "refuse",
    foreign: Foreign = "refuse",
    purpose: Purpose = "dynamics",
    package_dirs: Folders = None,
    xacro: Xacro = "expand",
    xacro_arguments: XacroArguments = None,
) -> Robot:
    """The robot that the options describe."""
    locks, field = locks_of(lock), None if gravity is None else parse_numbers("gravity", gravity)
    # load_robot refuses other words
    choices: dict[str, Any] = {"root": root, "unphysical": unphysical, "foreign": foreign, "purpose": purpose,
                               "xacro": xacro}  # fmt: skip
    choices["xacro_arguments"] = xacro_of(xacro_arguments)
    return load_robot(source, lock=locks, gravity=field, mimic=mimic, package_dirs=package_dirs or [], **choices)


def with_robot_options(command: Callable[..., None]) -> Callable[..., None]:
    """The command with the options of `robot_from` in place of its argument `load`, a function of a source."""
    options = list(signature(robot_from).parameters.values())[1:]

    @functools.wraps(command)
    def call(**given: Any) -> None:
        chosen = {option.name: given.pop(option.name) for option in options}
        command(load=functools.partial(robot_from, **chosen), **given)

    own = list(signature(command).parameters.values())
    place = [parameter.name for parameter in own].index("load")
    parameters = [*own[:place], *(option.replace(kind=own[place].kind) for option in options), *own[place + 1 :]]
    call.__signature__ = Signature(parameters)  # type: ignore[attr-defined]  # for Typer
    return call


def chosen_of(load: RobotLoader) -> list[str]:
    """The options of robots that are not left out."""
    usual = signature(robot_from).parameters
    return [name for name, value in load.keywords.items() if value != usual[name].default]


def locks_of(lock: Lock) -> dict[str, Any]:
    """The locked joints' configurations."""
    return {name: _entries("lock", x) for name, x in _pairs(lock, "lock", "JOINT=VALUE, such as elbow=0.5").items()}


def xacro_of(arguments: XacroArguments) -> dict[str, str]:
    """The arguments of a xacro by name."""
    return _pairs(arguments, "xacro_arguments", "NAME=VALUE, such as ur_type=ur5e")


def _pairs(texts: list[str] | None, option: str, form: str) -> dict[str, str]:
    """The values of an option that is repeatable, by name."""
    pairs: dict[str, str] = {}
    for text in texts or []:
        name, _, value = (part.strip() for part in text.rpartition("="))
        if not name:
            expected, _, example = form.partition(", ")
            raise Misuse(f"expected {expected}, got {text!r}", where=option, remedy=example)
        if name in pairs:
            raise Misuse(f"{name!r} is given twice", where=option, remedy="keep one")
        pairs[name] = value
    return pairs


def scene_from(source: str, load: RobotLoader | None = None, *, ground: bool | None = False) -> Scene:
    """A bundled scene, or that of a file; of a robot, which `load` loads, one with all that its file says.

    ground: the robot's links touch each other and the ground; None: those of a robot that is meant to move about.
    """
    load = load or functools.partial(robot_from, root="fixed")
    if is_robot(source):
        usual = catalogue_entry(source).usual_root if source in catalogue_names() else ""
        if load.keywords["root"] == "fixed":
            ground = usual == "free" if ground is None else ground
            load = functools.partial(load, root=usual or "fixed") if ground else load
        return scene_of(load(source), contact=bool(ground))
    scene = named_scene(source)
    if ground:
        raise Misuse("it is for robots, and this is a scene, which has its own contacts", where="ground",
                     remedy="leave it out")  # fmt: skip
    for name in chosen_of(load):
        raise Misuse("it is for robots, and this is a scene, which has its own", where=name,
                     remedy=f"change the scene: twolink scenes {source} prints a bundled one")  # fmt: skip
    return scene


def bounds_of(text: str, where: str = "wrt") -> tuple[str, tuple[float, float]]:
    """A variable's name and bounds from NAME=LOW:HIGH."""
    name, _, pair = text.partition("=")
    try:
        low, high = (float(number) for number in pair.split(":"))
    except ValueError:
        raise Misuse(f"expected NAME=LOW:HIGH, got {text!r}", where=where, remedy='such as "v.elbow=-1:1"') from None
    return name.strip(), (low, high)
