"""A robot as plain data: what the command line prints and the service answers; which robot a saved trajectory or scene
belongs to, and how it is loaded again.
"""

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import msgspec
import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from twolink.algorithms.functions import frame_index
from twolink.dynamics import load_robot
from twolink.dynamics.arguments import configuration, rows
from twolink.dynamics.robot import Robot
from twolink.errors import RobotError, SceneError
from twolink.io.fingerprints import model_digest
from twolink.robots.catalogue import FILES, catalogue_entry
from twolink.robots.joint_layout import JointLayout

PASS_IT = "pass the robot of its scene: robot=..."


class JointRecord(msgspec.Struct, frozen=True):
    """A joint: its place in q and v (start and stop), its limits (None: none), and the mass of its body, kg.

    kind: Pinocchio's. The body is without those that it carries.
    """

    name: str
    kind: str
    layout: str
    q: list[int]
    v: list[int]
    lower: list[float | None]
    upper: list[float | None]
    velocity_limit: list[float | None]
    effort_limit: list[float | None]
    mass: float


class RobotRecord(msgspec.Struct, frozen=True):
    """A robot: sizes, mass [kg], gravity [m/s^2], joints, links, and what of its file is suspicious or was assumed.

    neutral: nq numbers. fixed_links: those fixed to the ground. report: the load report.
    """

    name: str
    nq: int
    nv: int
    mass: float
    gravity: list[float]
    neutral: list[float]
    joints: list[JointRecord]
    links: list[str]
    fixed_links: list[str]
    report: dict[str, Any]


def robot_record(robot: Robot) -> dict[str, Any]:
    """The `RobotRecord` of a robot as plain data, for JSON."""
    fixed = [frame.name for i in link_frames(robot) if not (frame := robot.model.frames[i]).parentJoint]
    joints = [_joint(robot, joint) for joint in robot.joints]
    record = RobotRecord(robot.name, robot.nq, robot.nv, robot.mass, robot.gravity.tolist(), robot.neutral.tolist(),
                         joints, list(robot.frame_names), fixed, robot.report.to_dict())  # fmt: skip
    plain: dict[str, Any] = msgspec.to_builtins(record)
    return plain


def _joint(robot: Robot, joint: JointLayout) -> JointRecord:
    def known(limits: tuple[float, ...]) -> list[float | None]:
        return [x if math.isfinite(x) else None for x in limits]

    return JointRecord(joint.name, joint.type, joint.kind, [joint.q.start, joint.q.stop], [joint.v.start, joint.v.stop],
                       known(joint.lower), known(joint.upper), known(joint.velocity_limit), known(joint.effort_limit),
                       robot.model.inertias[joint.index].mass)  # fmt: skip


def link_frames(robot: Robot) -> list[int]:
    """The indices of the links' frames, in the model's order."""
    return [i for i, frame in enumerate(robot.model.frames) if frame.type == pin.FrameType.BODY]


def link_poses(robot: Robot, q: ArrayLike, frames: Sequence[str] | None = None) -> np.ndarray:
    """Poses (..., n, 7) in the world: position [m] and quaternion (x y z w), of frames by name, or of all links.

    One pass through the tree for all links of a state: `Robot.frame_pose` takes one for each.
    """
    states = configuration("q", q, robot.nq, robot.joints)
    batch = states.shape[:-1]
    indices = link_frames(robot) if frames is None else [frame_index(robot.model, name, "frames") for name in frames]
    flat = rows(states, batch)
    poses = np.empty((len(flat), len(indices), 7))
    for i, state in enumerate(flat):
        pin.framesForwardKinematics(robot.model, robot.data, state)
        for k, index in enumerate(indices):
            poses[i, k] = pin.SE3ToXYZQUAT(robot.data.oMf[index])
    return poses.reshape(*batch, len(indices), 7)


def robot_notes(robot: Robot) -> dict[str, str]:
    """The notes by which `find_robot` loads a robot of the catalogue again.

    Parameters
    ----------
    robot : Robot
        The robot.

    Returns
    -------
    dict
        robot (its name), source, catalogue, root, lock, mimic, gravity [m/s^2] and nq, as text or JSON; and digest,
        by which another robot of the same name is noticed.
    """
    return {
        "robot": robot.name,
        "source": robot.report.source,
        "catalogue": json.dumps(_is_from_catalogue(robot)),
        "root": robot.root,
        "lock": json.dumps(robot.visuals.lock),
        "mimic": json.dumps(robot.has_mimic),
        "gravity": json.dumps(robot.gravity.tolist()),
        "nq": str(robot.nq),
        "digest": model_digest(robot.model),
    }


def find_robot(notes: Mapping[str, str], label: str) -> Robot:
    """The robot of the notes, loaded again from the catalogue, never from a path.

    Parameters
    ----------
    notes : mapping
        As `robot_notes` gives them.
    label : str
        The name of the file for errors.

    Returns
    -------
    Robot
        The robot with the same root, locked joints and gravity.

    Raises
    ------
    SceneError
        The robot is not of the catalogue, or has changed (code "robot-differs"), or the notes are damaged.
    """
    if "robot" not in notes:
        raise SceneError("the file does not name its robot", where=label, remedy=PASS_IT, argument="robot")
    name = notes["robot"]
    if notes.get("catalogue") != "true" or "digest" not in notes:
        source = f" (it came from {notes['source']!r})" if "source" in notes else ""
        what, remedy = f"its robot {name!r} is not known by name{source}", PASS_IT
        if (file := notes.get("source", "")).endswith(FILES):
            remedy = f'pass the robot: robot=load_robot("{file}")'
        raise SceneError(what, where=label, remedy=remedy, argument="robot")
    root: Literal["fixed", "free"] = "free" if notes.get("root") == "free" else "fixed"
    try:
        lock, mimic = json.loads(notes.get("lock", "{}")), notes.get("mimic") == "true"
        robot = load_robot(catalogue_entry(name).name, root=root, lock=lock, mimic=mimic)
    except RobotError as error:
        what = f"its robot {name!r}: {error.what}"
        raise SceneError(what, where=label, remedy=PASS_IT, argument="robot") from None
    except (ValueError, RecursionError):
        raise _damaged(label) from None
    return require_same(robot, notes, label)


def require_same(robot: Robot, notes: Mapping[str, str], label: str) -> Robot:
    """The robot in the gravity field of the notes, if they describe it.

    Raises
    ------
    SceneError
        Code "robot-differs": the notes describe another robot. Or the notes are damaged.
    """
    nq, digest = notes.get("nq", str(robot.nq)), notes.get("digest")
    what = remedy = ""
    if nq != str(robot.nq):
        what = f"its robot has nq = {nq}, {robot.name!r} has {robot.nq}"
        remedy = "pass the robot with the same root and locked joints: robot=..."
    elif digest is not None and digest != model_digest(robot.model):
        what = f"its robot {notes.get('robot', '')!r} is not this {robot.name!r}: joints, masses or placements differ"
        remedy = PASS_IT
    if what:
        raise SceneError(what, where=label, remedy=remedy, argument="robot", code="robot-differs")
    if "gravity" not in notes:
        return robot
    try:
        gravity = np.array(json.loads(notes["gravity"]), dtype=float)
        return robot if np.array_equal(gravity, robot.gravity) else robot.with_gravity(gravity)
    except (ValueError, TypeError, RecursionError):  # QueryError is a ValueError
        raise _damaged(label) from None


def _is_from_catalogue(robot: Robot) -> bool:
    """True if loading the robot's name gives the file that it came from."""
    try:
        return catalogue_entry(robot.name).path.name == robot.report.source
    except RobotError:
        return False


def _damaged(label: str) -> SceneError:
    return SceneError("its notes about the robot are damaged", where=label, remedy="save it again", code="damaged")
