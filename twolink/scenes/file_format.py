"""The format of scene files: its schema, and saved scenes that `load_scene` reads again."""

import functools
import inspect
import json
import operator
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np

from twolink.dynamics import Robot
from twolink.dynamics.robot_record import robot_notes
from twolink.effects import TYPES, Effect, effect_class
from twolink.effects.effect import plain
from twolink.errors import SceneError
from twolink.io.docstrings import texts_in
from twolink.io.files import write_atomic
from twolink.io.fingerprints import changed_joint, model_digest
from twolink.io.text import kebab_case
from twolink.robots.collisions import AnyShape
from twolink.robots.load import load_model
from twolink.robots.model import RobotModel

EXPORTED = 1e-9  # relative: inertias that were turned and moved
JointValues = dict[str, float | str | list[float]]


class RobotEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """The robot of a scene: its source, with the root and the locked joints as in `load_robot`."""

    source: str
    root: Literal["fixed", "free"] = "fixed"
    lock: JointValues = {}


class ObjectEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """A robot or object beside the robot of a scene, see `Scene.with_object`.

    Parameters
    ----------
    source : str or shape
        A robot's name, the path of a robot or mesh, or a shape.
    pose : sequence of float
        Its position, m, or position and quaternion x y z w, in the world.
    mass : float, optional
        Of a shape or mesh, kg; without it that is fixed.
    name : str
        By default that of the robot, file or shape.
    root : {"fixed", "free"}, optional
        Whether it is fixed to the world.
    """

    source: str | AnyShape
    pose: tuple[float, ...] = (0.0, 0.0, 0.0)
    mass: float | None = None
    name: str = ""
    root: Literal["fixed", "free"] | None = None


class SceneFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """The tables of a scene file. States are by joint name; other joints are neutral and at rest."""

    robot: str | RobotEntry
    title: str = ""
    duration: Annotated[float, msgspec.Meta(gt=0)] = 10.0
    q: JointValues = {}
    v: JointValues = {}
    objects: list[ObjectEntry] = []
    effects: list[dict[str, Any]] = []


def scene_schema() -> dict[str, Any]:
    """The JSON Schema (draft 2020-12) of scene files, with the tables of all effects."""
    schema = msgspec.json.schema(SceneFile)
    effects = msgspec.json.schema(functools.reduce(operator.or_, [effect_class(name) for name in TYPES]))
    schema["$defs"] |= effects.pop("$defs")
    for kind in map(effect_class, TYPES):
        if "of" in kind.__struct_fields__:
            schema["$defs"][kind.__name__]["properties"]["of"] = dict(effects)
    schema["$defs"]["SceneFile"]["properties"]["effects"]["items"] = effects
    for definition in schema["$defs"].values():
        _describe_fields(definition)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


def _describe_fields(definition: dict[str, Any]) -> None:
    """Move the description of each field from the section "Parameters" of a class's docstring to the field."""
    docstring = inspect.cleandoc(definition.get("description", ""))
    for name, text in texts_in(docstring).items():
        if name in definition["properties"]:
            definition["properties"][name]["description"] = text
            definition["description"] = docstring.partition("\nParameters\n")[0].strip()


def save_scene(
    path: Path, robot: Robot, q: np.ndarray, v: np.ndarray, effects: Sequence[Effect], duration: float, title: str
) -> Path:
    """Write the parts of a scene to a .toml file; see `Scene.save`."""
    if path.suffix.lower() != ".toml":
        what = f"{path.suffix or 'no suffix'} is no format for scenes"
        raise SceneError(what, where=str(path), remedy="use .toml", code="unknown-format")
    entry, beside, urdf = _robot_entry(robot, path)
    text = msgspec.toml.encode(scene_content(entry, robot, q, v, effects, duration, title))
    if beside is not None:
        write_atomic(beside, lambda file: file.write(urdf))
    return write_atomic(path, lambda file: file.write(text))


def scene_content(
    entry: RobotEntry, robot: Robot, q: np.ndarray, v: np.ndarray, effects: Sequence[Effect], duration: float,
    title: str, objects: Sequence[ObjectEntry] = (),
) -> SceneFile:  # fmt: skip
    """The tables of a scene file. entry: how the file names the robot, or that part of it which is beside objects."""
    return SceneFile(
        robot=entry if entry.root != "fixed" or entry.lock else entry.source,
        title=title,
        duration=duration,
        q=_by_joint(robot, q, np.full(robot.nq, np.nan) if objects else robot.neutral, "q"),
        v=_by_joint(robot, v, np.zeros(robot.nv), "v"),
        objects=list(objects),
        effects=[effect_table(effect) for effect in effects],
    )


def _robot_entry(robot: Robot, path: Path) -> tuple[RobotEntry, Path | None, bytes]:
    """The robot by its name in the catalogue; any other one by the name of a URDF beside the scene, with its content.

    One whose constants were changed is written as it is now, by `export_urdf`.
    """
    if robot.has_mimic:
        raise SceneError("a scene file has no joints that follow others", where=f"robot {robot.name!r}",
                         code="mimic-joints", remedy="load it without mimic=True, and add Coupling")  # fmt: skip
    notes, text = robot_notes(robot), robot.visuals.text
    entry = RobotEntry(robot.name, "free" if notes["root"] == "free" else "fixed", json.loads(notes["lock"]))
    named = notes["catalogue"] == "true"
    if not _is_as_loaded(robot, robot.name if named else text, entry):
        named, text, entry = False, _exported(robot), RobotEntry(robot.name, entry.root)
        if robot.visuals.srdf.apart or not _is_as_loaded(robot, text, entry, EXPORTED):
            raise SceneError("the robot's constants were changed, and a URDF has not all of it, such as exclusions",
                             where=f"robot {robot.name!r}", code="robot-differs",
                             remedy="make the scene with load_robot(robot.export_urdf(...))")  # fmt: skip
    if named:
        return entry, None, b""
    content = text.encode("utf-8")
    places = (path.with_suffix(".urdf"), path.with_name(f"{path.stem}-robot.urdf"))  # the first may be the original
    free = [place for place in places if not place.exists() or place.read_bytes() == content]
    if not free:
        remedy = "save the scene under another name"
        raise SceneError("another file is there", where=str(places[1]), remedy=remedy, code="file-exists")
    return RobotEntry(free[0].name, entry.root, entry.lock), free[0], content


def _is_as_loaded(robot: Robot, source: str, entry: RobotEntry, near: float = 0.0) -> bool:
    """True if what a scene file says of a robot gives its numbers. near: relative; 0: to the bit."""
    again = load_model(RobotModel, source, root=entry.root, lock=entry.lock, purpose="kinematics",
                       unphysical="report", foreign="report")  # fmt: skip
    if near:
        return not changed_joint(robot.model, again.model, near=near)
    return not changed_joint(robot.model, again.model) and model_digest(robot.model) == model_digest(again.model)


def _exported(robot: Robot) -> str:
    """The URDF of a robot as it is now."""
    with tempfile.TemporaryDirectory() as folder:
        return robot.export_urdf(Path(folder) / "robot.urdf").read_text("utf-8")


def _by_joint(robot: Robot, values: np.ndarray, neutral: np.ndarray, name: str) -> JointValues:
    """The entries that differ from the neutral ones, by joint."""
    table: JointValues = {}
    for joint in robot.joints:
        part = joint.q if name == "q" else joint.v
        numbers = values[part].tolist()
        if numbers != neutral[part].tolist():
            table[joint.name] = numbers[0] if len(numbers) == 1 else numbers
    return table


def effect_table(effect: Effect) -> Any:
    """An effect as a table of a scene file. Raises SceneError for one that a file cannot hold."""
    if isinstance(getattr(effect, "of", None), Effect):
        effect_table(effect.of)  # type: ignore[attr-defined]
    name = type(effect).__name__
    kind = kebab_case(name)
    if kind not in TYPES or effect_class(kind) is not type(effect):
        what = (f"{name} calls Python at its ticks, which a file cannot hold" if effect.sampled is not None
                else f"{name} is no effect of twolink: load_scene could not read it")  # fmt: skip
        remedy = 'keep the scene as a Python program, or save its run: tl.simulate(scene).save("run.npz")'
        raise SceneError(what, where=name, remedy=remedy, code="own-effect")
    try:
        return _without_none(msgspec.to_builtins(effect, enc_hook=plain))
    except TypeError:
        remedy = "give a condition, or leave the effect out"
        raise SceneError("functions cannot be written to a file", where=type(effect).__name__, remedy=remedy) from None


def _without_none(value: Any) -> Any:
    """TOML has no null: None is the default and left out."""
    if isinstance(value, dict):
        return {key: _without_none(item) for key, item in value.items() if item is not None}
    return [_without_none(item) for item in value] if isinstance(value, (list, tuple)) else value
