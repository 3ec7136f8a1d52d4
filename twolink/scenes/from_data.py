"""From the tables of a scene to a Scene: effects, robot and initial state."""

import re
from collections.abc import Callable
from typing import Any

import msgspec

from twolink.dynamics import Robot
from twolink.effects import TYPES, Effect, effect_class
from twolink.errors import SceneError, nearest, require_known
from twolink.io.text import split_path
from twolink.scenes.file_format import RobotEntry, SceneFile
from twolink.scenes.scene import Scene, at_effect


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
    return Scene(robot, content.q, content.v, effects, content.duration, content.title)


def scene_tables(content: Any) -> SceneFile:
    """Plain data as the tables of a scene. Raises SceneError, code "schema"; `where` is the path in the scene."""
    try:
        return msgspec.convert(content, SceneFile)
    except msgspec.ValidationError as error:
        raise _schema_error(error, {"": SceneFile, "robot": RobotEntry}) from None


def _effect(table: dict[str, Any], path: str = "") -> Effect:
    """An effect from its table, which stands at `path` in another effect; its class is imported now."""
    kind = table.get("type")
    if kind is None:
        raise SceneError("it has no type", where=path, remedy='such as type = "gravity"', code="schema")
    require_known(kind, TYPES, SceneError, "there is no effect {!r}", where=path, code="unknown-effect")
    if kind in ("engage", "release") and isinstance(table.get("of"), dict):
        table = table | {"of": _effect(table["of"], f"{path}.of".lstrip("."))}
    try:
        return msgspec.convert(table, effect_class(kind))
    except msgspec.ValidationError as error:
        raise _schema_error(error, {"": effect_class(kind)}, path) from None


def _schema_error(
    error: msgspec.ValidationError, schemas: dict[str, type[msgspec.Struct]], inside: str = ""
) -> SceneError:
    """msgspec's message with the key's path first, and the nearest name for an unknown key."""
    what, path = split_path(str(error))
    unknown = re.search(r"unknown field `(.*)`", what)
    remedy = "see a bundled scene for an example"
    if unknown and path in schemas:
        remedy = nearest(unknown.group(1), [field.name for field in msgspec.structs.fields(schemas[path])])
    where = ".".join(part for part in (inside, path) if part)
    return SceneError(what, where=where, remedy=remedy, code="schema")
