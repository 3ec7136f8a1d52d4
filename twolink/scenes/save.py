"""Saving scenes: as files that load_scene reads again; and the schema of such files."""

from __future__ import annotations

import functools
import operator
import os
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from twolink.dynamics import Robot
from twolink.dynamics.saved_robot import robot_notes
from twolink.effects import TYPES, Effect, effect_class
from twolink.effects.effect import plain
from twolink.errors import SceneError
from twolink.io.tables import write_whole
from twolink.scenes.file import SceneFile
from twolink.scenes.scene import Scene


def save_scene(scene: Scene, path: str | os.PathLike[str]) -> Path:
    """Write a scene to a .toml file. Returns the path.

    A robot of the catalogue is written by its name; any other as a URDF beside the file, with the same stem.
    """
    import tomli_w

    place = Path(path)
    if place.suffix != ".toml":
        raise SceneError(f"{place.suffix or 'no suffix'} is no format for scenes", where=str(path), remedy="use .toml")
    table: dict[str, Any] = {"title": scene.title} if scene.title else {}
    table["robot"] = _robot(scene.base, place)
    table["duration"] = scene.duration
    for name, values, neutral in (("q", scene.q, scene.robot.neutral), ("v", scene.v, np.zeros(scene.robot.nv))):
        named = _by_joint(scene.robot, values, neutral, name)
        if named:
            table[name] = named
    if scene.effects:
        table["effects"] = [_without_none(_table(effect)) for effect in scene.effects]
    text = tomli_w.dumps(table)
    return write_whole(place, lambda file: file.write(text.encode("utf-8")))


def _robot(robot: Robot, place: Path) -> str | dict[str, Any]:
    notes = robot_notes(robot)
    entry: dict[str, Any] = {"source": robot.name}
    if notes["catalogue"] != "true":
        beside = place.with_suffix(".urdf")
        content = robot.visuals.text.encode("utf-8")
        if beside.exists() and beside.read_bytes() != content:
            raise SceneError("another file is there", where=str(beside), remedy="save the scene under another name")
        write_whole(beside, lambda file: file.write(content))
        entry["source"] = beside.name
    if notes["root"] == "free":
        entry["root"] = "free"
    lock = msgspec.json.decode(notes["lock"])
    if lock:
        entry["lock"] = lock
    return str(entry["source"]) if len(entry) == 1 else entry


def _by_joint(robot: Robot, values: np.ndarray, neutral: np.ndarray, name: str) -> dict[str, Any]:
    """The entries that differ from the neutral ones, by joint."""
    out: dict[str, Any] = {}
    for joint in robot.joints:
        part = joint.q if name == "q" else joint.v
        own = values[part].tolist()
        if own != neutral[part].tolist():
            out[joint.name] = own[0] if len(own) == 1 else own
    return out


def _table(effect: Effect) -> Any:
    try:
        return msgspec.to_builtins(effect, enc_hook=plain)
    except TypeError:
        raise SceneError("functions cannot be written to a file", where=type(effect).__name__,
                         remedy="give a condition, or leave the effect out") from None  # fmt: skip


def _without_none(value: Any) -> Any:
    """TOML has no null: what is None is left out, being the default."""
    if isinstance(value, dict):
        return {key: _without_none(v) for key, v in value.items() if v is not None}
    return [_without_none(v) for v in value] if isinstance(value, (list, tuple)) else value


def scene_schema() -> dict[str, Any]:
    """The JSON Schema (draft 2020-12) of scene files, all effects included."""
    kinds = [effect_class(type_) for type_ in TYPES]
    union = functools.reduce(operator.or_, kinds)
    schema = msgspec.json.schema(SceneFile)
    effects = msgspec.json.schema(union)
    schema["$defs"] |= effects.pop("$defs")
    schema["$defs"]["Release"]["properties"]["of"] = effects
    schema["$defs"]["SceneFile"]["properties"]["effects"]["items"] = effects
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}
