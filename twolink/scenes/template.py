"""A commented scene file to begin with: a robot with all that its file says, and what else a scene may have."""

import re
from typing import Any

import msgspec
import numpy as np

from twolink.dynamics.robot_record import robot_record
from twolink.effects import Effect
from twolink.effects.forces import JointDamping
from twolink.effects.joint_switches import DryFriction, JointStops
from twolink.scenes.file_format import RobotEntry, effect_table
from twolink.scenes.scene import Scene

_HEAD = """\
# A scene: a robot, where it starts, and what acts on it. SI units, radians.
# Nothing acts that is not in this file: it begins with what the robot's own says. `twolink scenes NAME` prints a
# bundled scene as an example; `twolink scenes --schema` lists every effect with its fields.
"""
_STATE = """
# Where it starts, by joint. A joint that is left out is at its neutral position, and at rest.
[q]
{q}
[v]
{v}{effects}
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
"""
_STOPS = """
[[effects]]
type = "joint-stops"
limits = {{ {joint} = [{lower}, {upper}] }}  # rad or m
restitution = 0.5
"""


def scene_template(entry: RobotEntry, scene: Scene) -> str:
    """The text of a scene file for `load_scene`: the scene, and comments on what else it may have.

    entry: how the file names the robot.
    """
    robot = scene.base
    joints = robot_record(robot)["joints"]
    starts = {joint["name"]: _start(scene.q, joint) for joint in joints if joint["layout"] != "mimic"}
    named: Any = entry if entry.root != "fixed" or entry.lock else entry.source
    head = msgspec.toml.encode({"title": scene.title, "duration": scene.duration, "robot": named}).decode()
    q = "".join(_line(joint, starts[joint["name"]], _limits_of(joint)) for joint in joints if joint["name"] in starts)
    v = "".join(("" if any(part := scene.v[slice(*joint["v"])].tolist()) else "# ") + _line(joint, part)
                for joint in joints)  # fmt: skip
    effects = "".join(_effect(scene, effect) for effect in scene.effects)
    others = _others(scene, joints, starts).splitlines(keepends=True)
    commented = "".join(f"# {line}" if line.strip() else line for line in others)
    return _HEAD + head + _STATE.format(q=q, v=v, effects=effects) + commented


def _effect(scene: Scene, effect: Effect) -> str:
    """An effect with what differs from its defaults; damping and friction with the values of the robot's file."""
    model = scene.base.model
    for kind, text, values in ((JointDamping, _DAMPING, model.damping), (DryFriction, _FRICTION, model.friction)):
        if isinstance(effect, kind):
            found = {joint.name: float(values[joint.v.start]) for joint in scene.base.joints if any(values[joint.v])}
            return text.format(values=_value(found), source=", by the robot's file")
    table, usual = effect_table(effect), {field.name: field.default for field in msgspec.structs.fields(type(effect))}
    lines = [f"{name} = {_value(value)}\n" for name, value in table.items() if value not in (usual.get(name), {}, [])]
    return "\n[[effects]]\n" + "".join(lines)


def _others(scene: Scene, joints: list[dict[str, Any]], starts: dict[str, Any]) -> str:
    """Effects that fit the robot and are not there: losses, and what drives or stops its first joint."""
    text, there = "", [type(effect) for effect in scene.effects]
    if single := [joint for joint in joints if joint["v"][1] - joint["v"][0] == 1 and joint["name"] in starts]:
        for kind, effect in ((JointDamping, _DAMPING), (DryFriction, _FRICTION)):
            if kind not in there:
                text += effect.format(values=_value({single[0]["name"]: 0.0}), source=": the robot's file gives none")
        text += _TORQUE.format(joint=_key(single[0]["name"]))
    if turning := [joint for joint in joints if joint["layout"] == "vector"]:
        lower, upper = _limits(turning[0]) or (-1.5, 1.5)
        first = {"joint": _key(turning[0]["name"]), "start": starts[turning[0]["name"]][0]}
        text += _OF_POSITION.format(**first)
        text += "" if JointStops in there else _STOPS.format(**first, lower=lower, upper=upper)
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


def _value(value: Any) -> str:
    """A value of TOML in a line."""
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{_key(name)} = {_value(item)}' for name, item in value.items())} }}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_value, value))}]"
    return msgspec.json.encode(value).decode()
