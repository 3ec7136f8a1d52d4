"""Saving a scene as a TOML file that `load_scene` reads again."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from twolink.dynamics import Robot
from twolink.dynamics.saved_robot import robot_notes
from twolink.effects import TYPES, Effect, effect_class
from twolink.effects.effect import plain
from twolink.errors import SceneError
from twolink.io.atomic import write_atomic
from twolink.io.text import kebab_case
from twolink.scenes.file_format import RobotEntry, SceneFile


def save_scene(
    path: Path, robot: Robot, q: np.ndarray, v: np.ndarray, effects: Sequence[Effect], duration: float, title: str
) -> Path:
    """Write the parts of a scene to a .toml file; see `Scene.save`."""
    if path.suffix != ".toml":
        what = f"{path.suffix or 'no suffix'} is no format for scenes"
        raise SceneError(what, where=str(path), remedy="use .toml", code="unknown-format")
    entry, beside = _robot_entry(robot, path)
    text = msgspec.toml.encode(scene_content(entry, robot, q, v, effects, duration, title))
    if beside is not None:
        write_atomic(beside, lambda file: file.write(robot.visuals.text.encode("utf-8")))
    return write_atomic(path, lambda file: file.write(text))


def scene_content(
    entry: RobotEntry, robot: Robot, q: np.ndarray, v: np.ndarray, effects: Sequence[Effect], duration: float,
    title: str,
) -> SceneFile:  # fmt: skip
    """The tables of a scene file. entry: how the file names the robot."""
    return SceneFile(
        robot=entry if entry.root != "fixed" or entry.lock else entry.source,
        title=title,
        duration=duration,
        q=_by_joint(robot, q, robot.neutral, "q"),
        v=_by_joint(robot, v, np.zeros(robot.nv), "v"),
        effects=[_without_none(_table(effect)) for effect in effects],
    )


def _robot_entry(robot: Robot, path: Path) -> tuple[RobotEntry, Path | None]:
    """The robot by its name in the catalogue; any other one by the name of a URDF beside the scene, and that file."""
    notes = robot_notes(robot)
    source, beside = robot.name, None
    if notes["catalogue"] != "true":
        content = robot.visuals.text.encode("utf-8")
        places = (path.with_suffix(".urdf"), path.with_name(f"{path.stem}-robot.urdf"))  # the first may be the original
        free = [place for place in places if not place.exists() or place.read_bytes() == content]
        if not free:
            remedy = "save the scene under another name"
            raise SceneError("another file is there", where=str(places[1]), remedy=remedy, code="file-exists")
        beside = free[0]
        source = beside.name
    return RobotEntry(source, "free" if notes["root"] == "free" else "fixed", json.loads(notes["lock"])), beside


def _by_joint(robot: Robot, values: np.ndarray, neutral: np.ndarray, name: str) -> dict[str, float | list[float]]:
    """The entries that differ from the neutral ones, by joint."""
    table: dict[str, float | list[float]] = {}
    for joint in robot.joints:
        part = joint.q if name == "q" else joint.v
        numbers = values[part].tolist()
        if numbers != neutral[part].tolist():
            table[joint.name] = numbers[0] if len(numbers) == 1 else numbers
    return table


def _table(effect: Effect) -> Any:
    if isinstance(getattr(effect, "of", None), Effect):
        _table(effect.of)  # type: ignore[attr-defined]
    name = type(effect).__name__
    kind = kebab_case(name)
    if kind not in TYPES or effect_class(kind) is not type(effect):
        raise SceneError(f"{name} is no effect of twolink: load_scene could not read it", where=name,
                         remedy="make the scene in Python, or leave the effect out", code="own-effect")  # fmt: skip
    try:
        return msgspec.to_builtins(effect, enc_hook=plain)
    except TypeError:
        remedy = "give a condition, or leave the effect out"
        raise SceneError("functions cannot be written to a file", where=type(effect).__name__, remedy=remedy) from None


def _without_none(value: Any) -> Any:
    """TOML has no null: None is the default and left out."""
    if isinstance(value, dict):
        return {key: _without_none(item) for key, item in value.items() if item is not None}
    return [_without_none(item) for item in value] if isinstance(value, (list, tuple)) else value
