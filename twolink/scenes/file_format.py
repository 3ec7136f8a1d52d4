"""The format of scene files: its schema, saved scenes that `load_scene` reads again, and a commented template."""

import functools
import inspect
import json
import operator
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np

from twolink.dynamics import Robot
from twolink.dynamics.robot_record import robot_notes, robot_record
from twolink.effects import TYPES, Effect, effect_class
from twolink.effects.effect import plain
from twolink.errors import SceneError
from twolink.io.files import write_atomic
from twolink.io.text import kebab_case
from twolink.robots.collisions import AnyShape

JointValues = dict[str, float | list[float]]
_HEAD = """\
# A scene: a robot, where it starts, and what acts on it. SI units, radians.
# Nothing acts that is not in this file. `twolink scenes NAME` prints a bundled scene as an example;
# `twolink scenes --schema` lists every effect with its fields.
"""
_STATE = """
# Where it starts, by joint. A joint that is left out is at its neutral position, and at rest.
[q]
{q}
[v]
{v}
[[effects]]
type = "gravity"
field = [0.0, 0.0, -9.81]  # m/s^2

# What else may act: take the "# " away from what the scene calls for.
"""
_DAMPING = """
[[effects]]
type = "joint-damping"  # torque = -damping v
damping = {values}  # N m s/rad or N s/m{source}
"""
_FRICTION = """
[[effects]]
type = "dry-friction"  # torque = -kinetic sign(v); static = {{ ... }} is what a joint at rest can take, if it is more
kinetic = {values}  # N m or N{source}
"""
_TORQUE = """
[[effects]]
type = "torque"
inputs = {{ {joint} = {{ kind = "sine", amplitude = 1.0, frequency = 3.0 }} }}  # N m or N; rad/s, not Hz
"""
_OF_POSITION = """
[[effects]]
type = "joint-pd"  # torque = kp (target - q) - kd v
target = {{ {joint} = {start} }}  # rad or m
kp = {{ {joint} = 100.0 }}  # N m/rad or N/m
kd = {{ {joint} = 10.0 }}  # N m s/rad or N s/m

[[effects]]
type = "joint-stops"
limits = {{ {joint} = [{lower}, {upper}] }}  # rad or m
restitution = 0.5
"""


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
            schema["$defs"][kind.__name__]["properties"]["of"] = effects
    schema["$defs"]["SceneFile"]["properties"]["effects"]["items"] = effects
    for definition in schema["$defs"].values():
        _describe_fields(definition)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


def _describe_fields(definition: dict[str, Any]) -> None:
    """Move the description of each field from the section "Parameters" of a class's docstring to the field."""
    summary, _, sections = inspect.cleandoc(definition.get("description", "")).partition("\nParameters\n----------\n")
    lines = sections.partition("\n\n")[0].splitlines()
    fields: list[str] = []
    for line in lines:
        if line.startswith(" "):
            for field in fields:
                text = definition["properties"][field].get("description", "")
                definition["properties"][field]["description"] = f"{text} {line.strip()}".lstrip()
        else:
            fields = [name for name in line.partition(" : ")[0].split(", ") if name in definition["properties"]]
    if lines:
        definition["description"] = summary.strip()


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


def scene_template(robot: Robot, entry: RobotEntry, start: np.ndarray) -> str:
    """The text of a scene file: the robot under gravity, and comments on what else a scene may have.

    Parameters
    ----------
    robot : Robot
        The robot.
    entry : RobotEntry
        How the file names it.
    start : (nq,) array
        Where it starts.

    Returns
    -------
    str
        TOML that `load_scene` reads.
    """
    joints = robot_record(robot)["joints"]
    starts = {joint["name"]: _start(start, joint) for joint in joints if joint["layout"] != "mimic"}
    named: Any = entry if entry.root != "fixed" or entry.lock else entry.source
    scalars = {"title": f"{robot.name} under gravity", "duration": 10.0}
    head = msgspec.toml.encode({**scalars, "robot": named}).decode()
    q = "".join(_line(joint, starts[joint["name"]], _limits_of(joint)) for joint in joints if joint["name"] in starts)
    v = "".join(f"# {_line(joint, [0.0] * (joint['v'][1] - joint['v'][0]))}" for joint in joints)
    return _HEAD + head + _STATE.format(q=q, v=v) + _commented(_effects(robot, joints, starts))


def _effects(robot: Robot, joints: list[dict[str, Any]], starts: dict[str, Any]) -> str:
    """Effects that fit the robot: damping and friction of the URDF, and what drives or stops its first joint."""
    text = ""
    if single := [joint for joint in joints if joint["v"][1] - joint["v"][0] == 1 and joint["name"] in starts]:
        for effect, urdf in ((_DAMPING, robot.model.damping), (_FRICTION, robot.model.friction)):
            found = {joint["name"]: float(urdf[joint["v"][0]]) for joint in single if urdf[joint["v"][0]]}
            source = ", by the URDF" if found else ": the URDF gives none"
            values = ", ".join(f"{_key(name)} = {x}" for name, x in (found or {single[0]["name"]: 0.0}).items())
            text += effect.format(values=f"{{ {values} }}", source=source)
        text += _TORQUE.format(joint=_key(single[0]["name"]))
    if turning := [joint for joint in joints if joint["layout"] == "vector"]:
        lower, upper = _limits(turning[0]) or (-1.5, 1.5)
        start = starts[turning[0]["name"]][0]
        text += _OF_POSITION.format(joint=_key(turning[0]["name"]), start=start, lower=lower, upper=upper)
    return text


def _start(q: np.ndarray, joint: dict[str, Any]) -> list[float]:
    """The start of a joint, to the last digit only where fewer would not do; a continuous joint's angle."""
    values = q[slice(*joint["q"])]
    if joint["layout"] == "cos-sin":
        return [round(float(np.arctan2(values[1], values[0])), 3)]
    numbers: list[float] = (values.round(3) if joint["layout"] == "vector" else values).tolist()
    return numbers


def _limits(joint: dict[str, Any]) -> tuple[float, float] | None:
    lower, upper = joint["lower"][0], joint["upper"][0]
    return None if lower is None or upper is None else (lower, upper)


def _limits_of(joint: dict[str, Any]) -> str:
    """The unit of a joint with one coordinate and its limits, as a comment."""
    if joint["layout"] not in ("vector", "cos-sin"):
        return ""
    limits = _limits(joint) if joint["layout"] == "vector" else None
    between = f", between {limits[0]:.4g} and {limits[1]:.4g}" if limits else ""
    return f"  # {'m' if joint['kind'] == 'prismatic' else 'rad'}{between}"


def _line(joint: dict[str, Any], values: list[float], note: str = "") -> str:
    """A joint's numbers as a line of TOML."""
    return f"{_key(joint['name'])} = {values[0] if len(values) == 1 else values}{note}\n"


def _key(name: str) -> str:
    """A name as a key of TOML."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else msgspec.json.encode(name).decode()


def _commented(text: str) -> str:
    return "".join(f"# {line}" if line.strip() else line for line in text.splitlines(keepends=True))
