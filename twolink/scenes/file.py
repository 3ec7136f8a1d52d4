"""Scene files: TOML with a strict schema. An unknown key, joint or effect is an error, never passed over."""

from __future__ import annotations

import os
import re
import tomllib
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np

from twolink.dynamics import Robot, load_robot
from twolink.effects import TYPES, Effect, effect_class
from twolink.errors import SceneError, TwolinkError, nearest
from twolink.io.tables import read_text
from twolink.scenes.scene import Scene

MAX_BYTES = 2**20
Values = dict[str, float | list[float]]
Positive = Annotated[float, msgspec.Meta(gt=0)]


class RobotEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The robot of a scene file, where its name alone does not say enough."""

    source: str
    root: Literal["fixed", "free"] = "fixed"
    lock: Values = {}


class SceneFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The schema of a scene file. States are given by joint name; joints that are not named are neutral, at rest."""

    robot: str | RobotEntry
    title: str = ""
    duration: Positive = 10.0
    q: Values = {}
    v: Values = {}
    effects: list[dict[str, Any]] = []


def bundled_scenes() -> tuple[str, ...]:
    """The names of the scenes that come with twolink."""
    folder = resources.files("twolink.scenes") / "bundled"
    return tuple(sorted(p.name.removesuffix(".toml") for p in folder.iterdir() if p.name.endswith(".toml")))


def load_scene(source: str | os.PathLike[str]) -> Scene:
    """A scene by the name of a bundled one, or from a path to a TOML file.

    Raises SceneError with the path of the key, what was expected, and the nearest right name.
    """
    name = os.fspath(source) if isinstance(source, (str, os.PathLike)) else None
    if not isinstance(name, str):
        raise SceneError(f"a {type(source).__name__} is not a scene", where="load_scene",
                         remedy="pass a name or a path")  # fmt: skip
    is_path = isinstance(source, os.PathLike) or name.endswith(".toml") or os.sep in name
    if not is_path and name not in bundled_scenes():
        raise SceneError(
            f"there is no bundled scene {name!r}",
            where="load_scene",
            remedy=f"{nearest(name, bundled_scenes())} (a file's name ends in .toml)",
        )
    if is_path:
        path = Path(name)
        return _from_text(read_text(path, MAX_BYTES, "keep samples in files of their own"), name, path.parent)
    text = (resources.files("twolink.scenes") / "bundled" / f"{name}.toml").read_text(encoding="utf-8")
    return _from_text(text, name, None)


def _from_text(text: str, label: str, folder: Path | None) -> Scene:
    try:
        content = msgspec.convert(_beside(tomllib.loads(text), folder), SceneFile)
    except msgspec.ValidationError as error:
        raise _schema_error(error, label, {"": SceneFile, "robot": RobotEntry}) from None
    except (ValueError, RecursionError) as error:
        raise SceneError(f"not TOML: {error}", where=label, remedy="check that line") from None
    effects = [effect_from(table, f"effects[{i}]", label) for i, table in enumerate(content.effects)]
    try:
        robot = _robot(content.robot, folder)
        q = state_by_joint(robot, content.q, robot.neutral, "q")
        v = state_by_joint(robot, content.v, np.zeros(robot.nv), "v")
        return Scene(robot, q, v, effects, content.duration, content.title)
    except TwolinkError as error:
        where = f"{label}: {error.where}" if error.where else label
        raise SceneError(error.what, where=where, remedy=error.remedy) from None


def _beside(given: Any, folder: Path | None) -> Any:
    """What a scene file says, with the samples it takes from files looked for beside it."""
    if isinstance(given, list):
        return [_beside(value, folder) for value in given]
    if not isinstance(given, dict):
        return given
    table = {key: _beside(value, folder) for key, value in given.items()}
    if folder is not None and table.get("kind") == "sampled" and isinstance(table.get("file"), str):
        table["file"] = os.path.join(folder, table["file"])
    return table


def effect_from(table: dict[str, Any], path: str, label: str) -> Effect:
    """An effect from its table; its class is imported for it."""
    kind = table.get("type")
    if kind is None:
        raise SceneError("it has no type", where=f"{label}: {path}", remedy='such as type = "gravity"')
    if not isinstance(kind, str) or kind not in TYPES:
        raise SceneError(f"there is no effect {kind!r}", where=f"{label}: {path}", remedy=nearest(str(kind), TYPES))
    made = effect_class(kind)
    if kind == "release" and isinstance(table.get("of"), dict):
        table = table | {"of": effect_from(table["of"], f"{path}.of", label)}
    try:
        return msgspec.convert(table, made)
    except msgspec.ValidationError as error:
        raise _schema_error(error, label, {"": made}, path) from None


def _schema_error(
    error: msgspec.ValidationError, label: str, schemas: dict[str, type[msgspec.Struct]], inside: str = ""
) -> SceneError:
    """msgspec's message in our form: the key's path first, and the nearest name for an unknown key."""
    message = str(error)
    match = re.match(r"(.*?)(?: - at `\$?\.?(.*)`)?$", message, re.DOTALL)
    what, path = (match.group(1), match.group(2) or "") if match else (message, "")
    unknown = re.search(r"unknown field `(.*)`", what)
    remedy = "see a bundled scene for an example"
    if unknown:
        fields = schemas.get(path)
        known = [] if fields is None else [f.name for f in msgspec.structs.fields(fields)]
        remedy = nearest(unknown.group(1), known)
    where = ".".join(part for part in (inside, path) if part)
    return SceneError(what, where=f"{label}: {where}" if where else label, remedy=remedy)


def _robot(entry: str | RobotEntry, folder: Path | None) -> Robot:
    entry = RobotEntry(entry) if isinstance(entry, str) else entry
    beside = None if folder is None else os.path.join(folder, entry.source)
    source = beside if beside is not None and os.path.isfile(beside) else entry.source
    return load_robot(source, root=entry.root, lock=entry.lock)


def state_by_joint(robot: Robot, values: Values, start: np.ndarray, name: str) -> np.ndarray:
    """A state vector from values by joint name; a continuous joint's q may be given as an angle."""
    state = np.array(start)
    for joint_name, value in values.items():
        joint = next((j for j in robot.joints if j.name == joint_name), None)
        if joint is None:
            raise SceneError(
                f"robot {robot.name!r} has no joint {joint_name!r}",
                where=name,
                remedy=nearest(joint_name, robot.joint_names),
            )
        part = joint.q if name == "q" else joint.v
        given = np.atleast_1d(np.asarray(value, dtype=float))
        if joint.kind == "cos-sin" and name == "q" and given.size == 1:
            given = np.array([np.cos(given[0]), np.sin(given[0])])
        if given.size != part.stop - part.start:
            raise SceneError(
                f"expected {part.stop - part.start} numbers, got {given.size}",
                where=f"{name}.{joint_name}",
                remedy="give the joint's configuration or velocity",
            )
        state[part] = given
    return state
