"""Columns of logs as other programs name and order them, by our names: guessed, and said.

MuJoCo orders joints depth first, as its file does; a free body's quaternion is (w, x, y, z) there, and the velocity of
its origin is along the axes of the world (its documentation, "Floating objects").
"""

import json
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from twolink.errors import QueryError
from twolink.io.tables import read_table
from twolink.robots.joint_layout import JointLayout, column_forms, read_columns
from twolink.robots.model import RobotModel
from twolink.robots.xml import parse_xml

Table = Mapping[str, Any]
_NAMES = {
    "t": ("time", "times", "timestamp", "timestamps", "sim_time", "sample_times"),
    "q": ("qpos", "joint_q", "joint_pos", "joint_position", "joint_positions", "dof_pos", "position", "positions",
          "pos", "observation.state"),
    "v": ("qvel", "joint_qd", "joint_vel", "joint_velocity", "joint_velocities", "dof_vel", "velocity", "velocities",
          "vel", "qd", "dq", "observation.velocity"),
    "tau": ("joint_torque", "joint_torques", "joint_effort", "joint_efforts", "dof_torque", "torque", "torques",
            "effort", "efforts", "observation.effort"),
}  # fmt: skip
_STATE = "observation.state"  # of LeRobot
_OF_COLUMNS = ("joint_names", "dof_names", "names")
_OF_MUJOCO = ("qpos", "qvel")
_WIDTHS = {"free-flyer": (7, 6), "quaternion": (4, 3), "vector": (1, 1), "cos-sin": (1, 1)}  # of q and v in MuJoCo


def read_log_table(path: Path) -> dict[str, Any]:
    """The columns of a file (see `io.tables.read_table`), with `joint_names` of a data set of LeRobot.

    These stand in its meta/info.json, as names of the columns of observation.state.
    """
    table: dict[str, Any] = dict(read_table(path)[0])
    folders = path.resolve().parents[:4] if _STATE in table else ()
    about = next((file for folder in folders if (file := folder / "meta" / "info.json").is_file()), None)
    if about is None:
        return table
    try:
        names = json.loads(about.read_bytes())["features"][_STATE]["names"]
        table["joint_names"] = next(iter(names.values())) if isinstance(names, dict) else list(names)
    except (OSError, ValueError, LookupError, TypeError, StopIteration) as error:
        raise QueryError(f"it names no columns of {_STATE}: {error}", where=str(about), code="column-missing",
                         remedy="repair it, or move the log out of the data set") from None  # fmt: skip
    return table


def in_our_names(table: Table, robot: RobotModel) -> tuple[dict[str, Any], tuple[str, ...]]:
    """The table with t, q, v and tau by our names where it has them by those of other programs; and what was guessed.

    Known are matrices and columns with names of MuJoCo, Isaac Lab, Newton and LeRobot, `joint_names` beside a matrix,
    names of joints alone, and numbers from 1 on. What has our names stays as it is.

    Raises
    ------
    QueryError
        Code "column-missing": a matrix of another program does not fit the robot, or there are several episodes.
    """
    found, notes = dict(table), []
    episodes = np.unique(np.asarray(found.get("episode_index", 0)))
    if len(episodes) > 1:
        raise QueryError(f"the log has {len(episodes)} episodes", argument="episode_index", code="column-missing",
                         remedy="give a log of one episode")  # fmt: skip
    if "t" not in found and (name := next((x for x in _NAMES["t"] if x in found), "")):
        found["t"] = found.pop(name)
        notes.append(f"{name} as t")
    for letter in ("q", "v", "tau"):
        note = _from_one(found, robot.joints, letter)
        if not note and not _is_there(found, robot.joints, letter):
            note = _matrix(found, robot, letter) or _columns(found, robot.joints, letter)
        notes += [note] if note else []
    return found, tuple(notes)


def _is_there(table: Table, joints: Sequence[JointLayout], letter: str) -> bool:
    """True if the table has columns of a letter by our names."""
    return letter in table or any(
        name in table for joint in joints for form in column_forms(joint, letter) for name in form
    )


def _is_single(joints: Sequence[JointLayout]) -> bool:
    """True if each joint has one velocity, so that a column is enough for it."""
    return all(joint.v.stop - joint.v.start == 1 for joint in joints)


def _from_one(found: dict[str, Any], joints: Sequence[JointLayout], letter: str) -> str:
    """Take columns that are numbered from 1 by the names of their joints. Returns what was done, or ""."""
    names = [f"{letter}{k + 1}" for k in range(len(joints))]
    beyond = {f"{letter}0", f"{letter}{len(joints) + 1}"}
    if not found.keys().isdisjoint(beyond) or not found.keys() >= set(names) or not _is_single(joints):
        return ""
    found |= {f"{letter}.{joint.name}": found.pop(name) for joint, name in zip(joints, names, strict=True)}
    return f"{names[0]} ... {names[-1]} as those of joint {joints[0].name} ... {joints[-1].name}"


def _matrix(found: dict[str, Any], robot: RobotModel, letter: str) -> str:
    """Take a matrix with another name. Returns what was done, or ""."""
    for name in _NAMES[letter]:
        if name in found and np.ndim(found[name]) == 2:
            values = np.asarray(found.pop(name), dtype=float)
            listed = next((found[key] for key in _OF_COLUMNS if np.size(found.get(key, ())) == values.shape[1]), None)
            if name in _OF_MUJOCO:
                found |= _by_joint(_of_mujoco(values, robot, letter, name, found), robot.joints, letter)
                return f"{name} as {letter}, in MuJoCo's order and conventions"
            if listed is not None:
                names = list(map(str, listed))
                columns = _of_joints(names, robot.joints, [["{0}"], *map(_joined, _NAMES)])
                if not columns:
                    raise QueryError(f"its columns are {', '.join(names[:9])}", argument=name, code="column-missing",
                                     remedy=f"name the joints: {', '.join(robot.joint_names)}")  # fmt: skip
                places = zip(robot.joint_names, map(names.index, columns), strict=True)
                found |= {f"{letter}.{joint}": values[:, place] for joint, place in places}
                return f"{name} as {letter}, by the names of its columns"
            if not _is_single(robot.joints):
                raise QueryError(f"conventions of free bodies and ball joints in {name!r} are not known", argument=name,
                                 remedy="give q and v as twolink has them", code="column-missing")  # fmt: skip
            found |= _by_joint(values, robot.joints, letter)
            return f"{name} as {letter}, joints in the order {', '.join(robot.joint_names)}"
    return ""


def _by_joint(values: np.ndarray, joints: Sequence[JointLayout], letter: str) -> dict[str, np.ndarray]:
    """The matrix by its letter; with angles of continuous joints in it, by joint, as their unit is not known here."""
    forms = [column_forms(joint, letter) for joint in joints]
    names = [name for form in forms for name in (form[2] if len(form) > 2 else form[0])]
    if values.shape[1] != len(names) or all(len(form) == 2 for form in forms):
        return {letter: values}
    return dict(zip(names, values.T, strict=True))


def _columns(found: dict[str, Any], joints: Sequence[JointLayout], letter: str) -> str:
    """Take columns whose names hold those of the joints, or count them. Returns what was done, or ""."""
    if not _is_single(joints):
        return ""
    words = [_plain(word) for word in (letter, *_NAMES[letter])]
    spellings = [_joined(letter), *([f"{word}{between}{{1}}"] for word in words for between in ("_", "")),
                 *([["{0}"]] if letter == "q" else [])]  # fmt: skip
    taken = _of_joints([name for name, values in found.items() if np.ndim(values) == 1], joints, spellings)
    if not taken:
        return ""
    found |= {f"{letter}.{joint.name}": found.pop(name) for joint, name in zip(joints, taken, strict=True)}
    return f"{taken[0]}{' ...' if len(taken) > 1 else ''} as {letter}"


def _of_joints(names: Sequence[str], joints: Sequence[JointLayout], spellings: Iterable[list[str]]) -> list[str]:
    """The names of the joints' columns, by the first spelling in which each joint has one; or [].

    A spelling is a list of forms, {0} in them the joint's name, {1} its number from 0 on. Names that differ in
    capitals and punctuation alone are ambiguous.
    """
    counts = Counter(map(_plain, names))
    there = {_plain(name): name for name in names if counts[_plain(name)] == 1}
    if len({_plain(joint.name) for joint in joints}) < len(joints):
        return []
    for forms in spellings:
        wanted = [[form.format(_plain(joint.name), k) for form in forms] for k, joint in enumerate(joints)]
        found = [[there[name] for name in of_joint if name in there] for of_joint in wanted]
        if all(len(one) == 1 for one in found):
            return [name for (name,) in found]
    return []


def _joined(letter: str) -> list[str]:
    """The name of a joint before or behind a word for a letter."""
    words = [_plain(word) for word in (letter, *_NAMES[letter])]
    return [form for word in words for form in (f"{word}_{{0}}", f"{{0}}_{word}")]


def _plain(name: str) -> str:
    return re.sub("[^0-9a-z]+", "_", name.lower()).strip("_")


def joint_order(robot: RobotModel, breadth: bool = False) -> list[str]:
    """The joints in the order of the robot's file, depth first, as MuJoCo has them, or breadth first, as PhysX."""
    root = parse_xml(robot.visuals.text.encode(), robot.name, "utf-8")
    children: dict[str, list[tuple[str, str]]] = {}
    for joint in root.all("joint"):
        parent, child = (part.attributes["link"] if part else "" for part in map(joint.first, ("parent", "child")))
        children.setdefault(parent, []).append((joint.attributes["name"], child))
    carried = {child for each in children.values() for _, child in each}
    left, order = [("", link) for link in children if link not in carried], list[str]()
    while left:
        name, link = left.pop(0)
        order.append(name)
        more = children.get(link, [])
        left = [*left, *more] if breadth else [*more, *left]
    known = robot.joint_names
    return [*(name for name in known if name not in order), *(name for name in order if name in known)]


def _of_mujoco(values: np.ndarray, robot: RobotModel, letter: str, name: str, found: Table) -> np.ndarray:
    """qpos or qvel as our q or v, of the same samples; of continuous joints their angles."""
    by_name = {joint.name: joint for joint in robot.joints}
    joints = [by_name[each] for each in joint_order(robot)]
    other = next((joint for joint in joints if joint.kind not in _WIDTHS), None)
    widths = [_WIDTHS.get(joint.kind, (0, 0))[letter == "v"] for joint in joints]
    if other is not None or values.shape[1] != sum(widths):
        what = f"{name} has {values.shape[1]} columns, this robot {sum(widths)} in MuJoCo"
        raise QueryError(f"{name} has no place for the {other.kind} joint {other.name!r}" if other else what,
                         argument=name, remedy="give q and v as twolink has them", code="column-missing")  # fmt: skip
    ours: dict[str, np.ndarray] = {}
    for joint, end, width in zip(joints, np.cumsum(widths), widths, strict=True):
        own = values[:, end - width : end]
        if letter == "q":  # the quaternion, if there is one, ends with w
            own = own if width == 1 else np.column_stack([own[:, :-4], own[:, -3:], own[:, -4]])
        elif joint.kind == "free-flyer":
            q = np.asarray(read_columns(found, robot.joints, "q")[0], dtype=float)
            if q.shape != (len(values), robot.nq):
                raise QueryError("qvel of a free body needs its qpos", argument=name, code="column-missing",
                                 remedy="give qpos, or v as twolink has it")  # fmt: skip
            turns = [pin.Quaternion(row).normalized().matrix() for row in q[:, joint.q][:, 3:]]
            own = np.column_stack([np.einsum("nji,nj->ni", turns, own[:, :3]), own[:, 3:]])
        ours[joint.name] = own
    return np.column_stack([ours[name] for name in robot.joint_names])
