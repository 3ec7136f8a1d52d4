"""Loading scenes: TOML files with a strict schema, from a path or bundled with twolink."""

import functools
import os
import tomllib
from importlib import resources
from pathlib import Path
from typing import Any

from twolink.dynamics import Robot, load_robot
from twolink.errors import SceneError, TwolinkError, nearest
from twolink.io.listing import Table
from twolink.io.text import read_text
from twolink.scenes.file_format import RobotEntry
from twolink.scenes.from_data import scene_from_data, scene_tables
from twolink.scenes.scene import Scene

MAX_BYTES = 2**20


def bundled_scenes() -> tuple[str, ...]:
    """The names of the scenes that come with twolink."""
    folder = resources.files("twolink.scenes") / "bundled"
    return tuple(sorted(p.name.removesuffix(".toml") for p in folder.iterdir() if p.name.endswith(".toml")))


def scenes() -> Table:
    """The bundled scenes: their names, what they show, and their effects.

    Returns
    -------
    Table
        Columns name, title, robot, duration [s], effects (a tuple of their types).
    """
    rows = []
    for name in bundled_scenes():
        content = scene_tables(bundled_content(name))
        robot = content.robot if isinstance(content.robot, str) else content.robot.source
        effects = tuple(dict.fromkeys(effect["type"] for effect in content.effects))
        rows.append((name, content.title, robot, content.duration, effects))
    return Table(("name", "title", "robot", "duration", "effects"), tuple(rows))


def load_scene(source: str | os.PathLike[str]) -> Scene:
    """A bundled scene by its name, or a scene from a TOML file.

    Parameters
    ----------
    source : str or path
        A name that `tl.scenes()` lists, or the path of a file. Robots and tables of samples that the file names are
        first looked for in its own folder.

    Returns
    -------
    Scene
        The scene.

    Raises
    ------
    SceneError
        Names the file, the path of the key, what was expected, and the nearest right name.
    """
    name = os.fspath(source) if isinstance(source, (str, os.PathLike)) else None
    if not isinstance(name, str):
        what = f"a {type(source).__name__} is not a scene"
        raise SceneError(what, where="load_scene", remedy="pass a name or a path", argument="source")
    if name.endswith(".urdf"):
        remedy = f"tl.Scene(tl.load_robot({name!r}), effects=[tl.effects.Gravity()]); `twolink new` begins a scene file"
        raise SceneError("a URDF is a robot, not a scene", where=name, remedy=remedy, argument="source")
    if isinstance(source, os.PathLike) or name.endswith(".toml") or os.sep in name:
        path = Path(name)
        text = read_text(path, SceneError, MAX_BYTES, "keep samples in files of their own")
        try:
            content = tomllib.loads(text)
        except (ValueError, RecursionError) as error:
            raise SceneError(f"not TOML: {error}", where=name, remedy="check that line", code="not-toml") from None
        return _from_content(content, name, path.parent)
    return _from_content(bundled_content(name), name, None)


def bundled_text(name: str) -> str:
    """The file of a bundled scene. Raises SceneError, code "unknown-scene"."""
    if name not in bundled_scenes():
        remedy = f"{nearest(name, bundled_scenes())} (a file's name ends in .toml)"
        what = f"there is no bundled scene {name!r}"
        raise SceneError(what, where="load_scene", remedy=remedy, code="unknown-scene", argument="source")
    return (resources.files("twolink.scenes") / "bundled" / f"{name}.toml").read_text(encoding="utf-8")


@functools.cache
def bundled_content(name: str) -> dict[str, Any]:
    """The content of a bundled scene's file; do not change it."""
    return tomllib.loads(bundled_text(name))


def _from_content(content: dict[str, Any], label: str, folder: Path | None) -> Scene:
    """The scene of a file's content. `label` names the file in errors; relative paths start from `folder`."""

    def load(entry: RobotEntry) -> Robot:
        beside = None if folder is None else os.path.join(folder, entry.source)
        source = beside if beside is not None and os.path.isfile(beside) else entry.source
        return load_robot(source, root=entry.root, lock=entry.lock)

    try:
        return scene_from_data(scene_tables(_with_paths(content, folder)), load)
    except TwolinkError as error:
        raise error.at(f"{label}: {error.where}" if error.where else label, SceneError) from None


def _with_paths(value: Any, folder: Path | None) -> Any:
    """A file's content, where the paths of sampled inputs start from the file's folder."""
    if isinstance(value, list):
        return [_with_paths(item, folder) for item in value]
    if not isinstance(value, dict):
        return value
    table = {key: _with_paths(item, folder) for key, item in value.items()}
    if folder is not None and table.get("kind") == "sampled" and isinstance(table.get("file"), str):
        table["file"] = os.path.join(folder, table["file"])
    return table
