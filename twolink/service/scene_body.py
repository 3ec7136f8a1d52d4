"""Scenes in requests: the schema of scene files as JSON, with robots by id. Nothing is read from files."""

import functools
from typing import Any

from twolink.dynamics import Robot, load_robot
from twolink.errors import RobotError, SceneError, TwolinkError
from twolink.robots.catalogue import catalogue_names
from twolink.scenes import Scene, load_scene
from twolink.scenes.file_format import RobotEntry, SceneFile
from twolink.scenes.from_data import scene_from_data
from twolink.service.robot_pickle import read_robot, write_robot
from twolink.service.robot_tasks import robot_by_id

_MAX_EFFECTS = 200


def scene_of(scene: str | SceneFile, robots: str, robot: bytes = b"") -> Scene:
    """The scene: a bundled one by name, or one in full. robots: the folder of uploaded robots. robot: that of `packed`.

    Raises SceneError and RobotError whose `where` is the path in the request.
    """
    if isinstance(scene, str):
        if scene.endswith(".toml") or "/" in scene or "\\" in scene:
            raise SceneError("paths are not read here", argument="scene", remedy="GET /v1/scenes lists the scenes")
        return load_scene(scene)
    try:
        if len(scene.effects) > _MAX_EFFECTS:
            what = f"{len(scene.effects)} effects, the limit is {_MAX_EFFECTS}"
            raise SceneError(what, argument="effects", remedy="leave some out")
        _refuse_files(scene.effects)
        return scene_from_data(scene, (lambda _: read_robot(robot)) if robot else functools.partial(_robot, robots))
    except TwolinkError as error:
        where = f"scene.{error.where}" if error.where else "scene"
        raise error.at(where, argument=error.argument or "scene") from None


def packed(scene: str | SceneFile, robots: str) -> bytes:
    """The robot of a scene, for processes that shall not read what was uploaded; empty for a bundled scene."""
    return b"" if isinstance(scene, str) else write_robot(scene_of(scene, robots).base)


def _robot(robots: str, entry: RobotEntry) -> Robot:
    """A robot by id. Only those of the catalogue take options here: an uploaded one has its own."""
    if entry.root == "fixed" and not entry.lock:
        return robot_by_id(entry.source, robots)
    if entry.source in catalogue_names():
        return load_robot(entry.source, root=entry.root, lock=entry.lock)
    what = "an uploaded robot's root and lock are set when it is uploaded"
    raise RobotError(what, argument="robot", remedy="POST /v1/robots with other options gives another id")


def _refuse_files(value: Any) -> None:
    """Raise SceneError where a table of samples would be read from a file."""
    if isinstance(value, dict):
        if isinstance(value.get("file"), str):
            what = f"files are not read here: {value['file'][:80]!r}"
            raise SceneError(what, argument="effects", remedy="send times and values")
        value = list(value.values())
    for item in value if isinstance(value, list) else ():
        _refuse_files(item)
