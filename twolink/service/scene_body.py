"""Scenes as they come over the wire: the scene file's own schema in JSON, with robots by id and nothing from files."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from typing import Any

from twolink.dynamics import Robot, load_robot
from twolink.errors import RobotError, SceneError, TwolinkError
from twolink.robots.catalogue import catalogue_names
from twolink.scenes import Scene, load_scene
from twolink.scenes.file_format import RobotEntry, SceneFile
from twolink.scenes.from_data import scene_from_data
from twolink.service.robot_tasks import find

MOST_EFFECTS = 200


def scene_of(given: str | SceneFile, robots: str) -> Scene:
    """The scene: a bundled one by name, or as given. robots: the folder of uploaded robots.

    Raises SceneError and RobotError whose `where` is the path in the scene.
    """
    if isinstance(given, str):
        if given.endswith(".toml") or "/" in given or "\\" in given:
            raise SceneError("paths are not read here", where="scene", remedy="GET /v1/scenes lists the bundled ones")
        return load_scene(given)
    if len(given.effects) > MOST_EFFECTS:
        raise SceneError(f"{len(given.effects)} effects, the limit is {MOST_EFFECTS}", where="scene.effects",
                         remedy="leave some out")  # fmt: skip
    for name in _file_names(given.effects):
        raise SceneError(f"files are not read here: {name[:80]!r}", where="scene.effects",
                         remedy="send times and values")  # fmt: skip
    try:
        return scene_from_data(given, functools.partial(_robot, robots))
    except TwolinkError as error:
        where = f"scene.{error.where}" if error.where else "scene"
        raise error.at(where, argument=error.argument or "scene") from None


def _robot(robots: str, entry: RobotEntry) -> Robot:
    """A robot by id. Only those of the catalogue take options here: an uploaded one has its own."""
    if entry.root != "fixed" or entry.lock:
        if entry.source in catalogue_names():
            return load_robot(entry.source, root=entry.root, lock=entry.lock)
        raise RobotError("an uploaded robot's root and lock are set when it is uploaded", where="robot",
                         remedy="POST /v1/robots with other options gives another id")  # fmt: skip
    return find(entry.source, robots)


def _file_names(value: Any) -> Iterator[str]:
    """The files that tables of samples would be read from."""
    if isinstance(value, dict):
        if isinstance(value.get("file"), str):
            yield value["file"]
        for item in value.values():
            yield from _file_names(item)
    elif isinstance(value, list):
        for item in value:
            yield from _file_names(item)
