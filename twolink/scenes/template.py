"""A commented scene file for a robot: a start for a scene of one's own."""

import re
from typing import Any

import msgspec

from twolink.dynamics import Robot
from twolink.dynamics.robot_record import robot_record
from twolink.scenes.file_format import RobotEntry

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


def scene_template(robot: Robot, entry: RobotEntry) -> str:
    """The text of a scene file: the robot under gravity, and comments on what else a scene may have.

    Parameters
    ----------
    robot : Robot
        The robot.
    entry : RobotEntry
        How the file names it.

    Returns
    -------
    str
        TOML that `load_scene` reads. A joint whose neutral position is beyond its limits starts between them.
    """
    joints = robot_record(robot)["joints"]
    starts = {joint["name"]: _start(robot, joint) for joint in joints if joint["layout"] != "mimic"}
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


def _start(robot: Robot, joint: dict[str, Any]) -> list[float]:
    """Where a joint starts: its neutral position, or the middle between its limits; a continuous joint's angle."""
    if joint["layout"] == "cos-sin":
        return [0.0]
    neutral: list[float] = robot.neutral[slice(*joint["q"])].tolist()
    limits = _limits(joint) if joint["layout"] == "vector" else None
    return [round((limits[0] + limits[1]) / 2, 3)] if limits and not limits[0] <= neutral[0] <= limits[1] else neutral


def _limits(joint: dict[str, Any]) -> tuple[float, float] | None:
    lower, upper = joint["lower"][0], joint["upper"][0]
    return None if lower is None or upper is None else (lower, upper)


def _limits_of(joint: dict[str, Any]) -> str:
    """The unit of a joint with one coordinate and its limits, as a comment."""
    if joint["layout"] not in ("vector", "cos-sin"):
        return ""
    limits = _limits(joint) if joint["layout"] == "vector" else None
    between = f", between {limits[0]:.4g} and {limits[1]:.4g}" if limits else ""
    return f"  # {'m' if joint['kind'].startswith('P') else 'rad'}{between}"


def _line(joint: dict[str, Any], values: list[float], note: str = "") -> str:
    """A joint's numbers as a line of TOML."""
    return f"{_key(joint['name'])} = {values[0] if len(values) == 1 else values}{note}\n"


def _key(name: str) -> str:
    """A name as a key of TOML."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else msgspec.json.encode(name).decode()


def _commented(text: str) -> str:
    return "".join(f"# {line}" if line.strip() else line for line in text.splitlines(keepends=True))
