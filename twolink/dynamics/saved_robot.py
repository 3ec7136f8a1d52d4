"""What a saved trajectory says of its robot, and how that very robot is found again."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Literal

import numpy as np

from twolink.dynamics import Robot, load_robot
from twolink.errors import RobotError, SceneError
from twolink.io.fingerprints import model_digest
from twolink.robots.catalogue import catalogue_entry

GIVE_IT = "give it: robot=..."


def robot_notes(robot: Robot) -> dict[str, str]:
    """Name, origin, and how it was loaded: all that finds a robot of the catalogue again, and a digest to be sure."""
    full = robot.visuals.model
    free = full.njoints > 1 and full.names[1] == "root_joint"
    return {
        "robot": robot.name,
        "source": robot.report.source,
        "catalogue": json.dumps(_is_from_catalogue(robot)),
        "root": "free" if free else "fixed",
        "lock": json.dumps(_lock(robot)),
        "mimic": json.dumps(robot.has_mimic),
        "gravity": json.dumps(robot.gravity.tolist()),
        "nq": str(robot.nq),
        "digest": model_digest(robot.model),
    }


def find_robot(notes: Mapping[str, str], label: str) -> Robot:
    """The robot that the notes name, loaded again from the catalogue (never from a path) as it was then.

    Raises SceneError when it is none of the catalogue, or is not the same any more.
    """
    if "robot" not in notes:
        raise SceneError("the file does not name its robot", where=label, remedy=GIVE_IT)
    name = notes["robot"]
    if notes.get("catalogue") != "true" or "digest" not in notes:
        source = f" (it came from {notes['source']!r})" if "source" in notes else ""
        raise SceneError(f"its robot {name!r} is not known by name{source}", where=label, remedy=GIVE_IT)
    root: Literal["fixed", "free"] = "free" if notes.get("root") == "free" else "fixed"
    try:
        lock, mimic = json.loads(notes.get("lock", "{}")), notes.get("mimic") == "true"
        robot = load_robot(catalogue_entry(name).name, root=root, lock=lock, mimic=mimic)
    except RobotError as error:
        raise SceneError(f"its robot {name!r}: {error.what}", where=label, remedy=GIVE_IT) from None
    except (ValueError, RecursionError):
        raise _damaged(label) from None
    return require_same(robot, notes, label)


def require_same(robot: Robot, notes: Mapping[str, str], label: str) -> Robot:
    """The robot, in the gravity field of the notes, if it is the one they describe; else SceneError."""
    nq, digest = notes.get("nq", str(robot.nq)), notes.get("digest")
    if nq != str(robot.nq):
        what = f"its robot has nq = {nq}, {robot.name!r} has {robot.nq}"
        raise SceneError(what, where=label, remedy="give the robot with the same root and locked joints: robot=...")
    if digest is not None and digest != model_digest(robot.model):
        what = f"its robot {notes.get('robot', '')!r} is not this {robot.name!r}: joints, masses or placements differ"
        raise SceneError(what, where=label, remedy="give the robot it was made with: robot=...")
    if "gravity" not in notes:
        return robot
    try:
        gravity = np.array(json.loads(notes["gravity"]), dtype=float)
        if gravity.shape != (3,) or not np.isfinite(gravity).all():
            raise ValueError
    except (ValueError, TypeError, RecursionError):
        raise _damaged(label) from None
    return robot if np.array_equal(gravity, robot.gravity) else robot.with_gravity(gravity)


def _is_from_catalogue(robot: Robot) -> bool:
    try:
        return catalogue_entry(robot.name).path.name == robot.report.source
    except RobotError:
        return False


def _lock(robot: Robot) -> dict[str, list[float]]:
    """The locked joints with their configurations, as load_robot takes them."""
    full, reference = robot.visuals.model, robot.visuals.reference
    starts = {full.names[j]: (full.idx_qs[j], full.nqs[j]) for j in robot.visuals.locked}
    return {name: reference[start : start + size].tolist() for name, (start, size) in starts.items()}


def _damaged(label: str) -> SceneError:
    return SceneError("what it says of its robot is damaged", where=label, remedy="save it again")
