"""Loading scenes: TOML files with a strict schema, from a path or bundled with twolink."""

import functools
import os
import tomllib
from collections.abc import Callable
from importlib import resources
from pathlib import Path
from typing import Any

import msgspec

from twolink.dynamics import Robot, load_robot
from twolink.effects import TYPES, USUAL_TYPES, Effect, effect_class
from twolink.errors import SceneError, TwolinkError, nearest, require_known, shown
from twolink.io.schemas import misfit
from twolink.io.text import Table, read_text
from twolink.scenes.file_format import RobotEntry, SceneFile
from twolink.scenes.objects import is_mesh, with_objects
from twolink.scenes.scene import Scene, at_effect

MAX_BYTES = 2**20


def scene_from_data(content: SceneFile, load: Callable[[RobotEntry], Robot]) -> Scene:
    """The scene that the tables of a scene file, or of a request, describe.

    Parameters
    ----------
    content : SceneFile
        The tables.
    load : callable
        Gives the robot of an entry.

    Returns
    -------
    Scene
        The scene.

    Raises
    ------
    TwolinkError
        A name does not exist or a value does not fit; `where` is the path in the scene, such as effects[0].joint.
    """
    effects = []
    for i, table in enumerate(content.effects):
        try:
            effects.append(_effect(table))
        except SceneError as error:
            raise at_effect(error, i) from None
    robot = load(RobotEntry(content.robot) if isinstance(content.robot, str) else content.robot)
    robot = with_objects(robot, content.objects, load)
    return Scene(robot, content.q, content.v, effects, content.duration, content.title)


def scene_tables(content: Any) -> SceneFile:
    """Plain data as the tables of a scene. Raises SceneError, code "schema"; `where` is the path in the scene."""
    try:
        return msgspec.convert(content, SceneFile)
    except msgspec.ValidationError as error:
        raise _schema_error(error, SceneFile) from None


def _effect(table: dict[str, Any], path: str = "") -> Effect:
    """An effect from its table, which stands at `path` in another effect; its class is imported now."""
    kind = table.get("type")
    if kind is None:
        raise SceneError("it has no type", where=path, remedy='such as type = "gravity"', code="schema")
    require_known(kind, TYPES, SceneError, "there is no effect {!r}", USUAL_TYPES, where=path, code="unknown-effect")
    if isinstance(table.get("of"), dict):
        table = table | {"of": _effect(table["of"], f"{path}.of".lstrip("."))}
    try:
        return msgspec.convert(table, effect_class(kind))
    except msgspec.ValidationError as error:
        raise _schema_error(error, effect_class(kind), path) from None


def _schema_error(error: msgspec.ValidationError, kind: Any, inside: str = "") -> SceneError:
    """The refusal of data of the type `kind`, which stands at the path `inside`."""
    what, path, remedy = misfit(error, kind)
    remedy = remedy or "see a bundled scene for an example"
    where = ".".join(part for part in (inside, path) if part)
    return SceneError(what, where=where, remedy=remedy, code="schema")


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
        remedy = f"tl.scene_of({name!r}); `twolink new` begins a scene file"
        raise SceneError("a URDF is a robot, not a scene", where=name, remedy=remedy, argument="source")
    if isinstance(source, os.PathLike) or name.lower().endswith(".toml") or os.sep in name:
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
        what = f"there is no bundled scene {shown(name)}"
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
    """A file's content, where the paths of sampled inputs and meshes start from the file's folder."""
    if isinstance(value, list):
        return [_with_paths(item, folder) for item in value]
    if not isinstance(value, dict):
        return value
    table = {key: _with_paths(item, folder) for key, item in value.items()}
    if folder is not None and table.get("kind") == "sampled" and isinstance(table.get("file"), str):
        table["file"] = os.path.join(folder, table["file"])
    if folder is not None and is_mesh(table.get("source")):
        table["source"] = os.path.join(folder, table["source"])
    return table
