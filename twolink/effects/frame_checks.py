"""What effects on frames have in common: points of the robot's frames and of the ground."""

from __future__ import annotations

from typing import Any

from twolink.algorithms.functions import frame_pose
from twolink.algorithms.spatial import Scalar, Vec, minus
from twolink.dynamics import Robot
from twolink.effects.effect import finite, one_of
from twolink.effects.motion import GROUND, Motion
from twolink.errors import SceneError


def check_frame(frame: str, robot: Robot, field: str, *, ground: bool = False) -> bool:
    """Require a link's frame; returns whether it moves. Raises SceneError, also for what does not move.

    ground: whether the world and links fixed to it will do.
    """
    names = [f.name for f in robot.model.frames if f.type.name == "BODY"]
    if frame == GROUND and frame not in names:
        moves = False
    else:
        one_of(frame, [*names, GROUND] if ground else names, field, "frame")
        moves = frame_pose(robot.model, frame)[0] != 0
    if not (moves or ground):
        raise SceneError(f"frame {frame!r} does not move: what acts on it changes nothing", where=field,
                         remedy="name a link that moves")  # fmt: skip
    return moves


def check_place(frame: str, point: Any, robot: Robot, name: str) -> None:
    """Require a link or the ground, in the field `name`, and a point of it, in point_`name`. Raises SceneError."""
    check_frame(frame, robot, name, ground=True)
    check_three(point, f"point_{name}")


def apart(motion: Motion, a: str, point_a: Vec, b: str, point_b: Vec) -> list[Scalar]:
    """x_a - x_b of two frames' points, along the world's axes, m."""
    ends = motion.position(a, point_a), motion.position(b, point_b)
    return [minus(x, y) for x, y in zip(*ends, strict=True)]


def floats(given: tuple[float, float, float]) -> Vec:
    """Three numbers as constants that fold."""
    x, y, z = map(float, given)
    return x, y, z


def three(given: Any, field: str) -> tuple[Any, Any, Any]:
    """Require three of something. Raises SceneError."""
    if not isinstance(given, (tuple, list)) or len(given) != 3:
        raise SceneError(f"expected three, got {given!r}", where=field, remedy="one along each of x, y, z")
    return given[0], given[1], given[2]


def check_three(given: Any, field: str) -> None:
    """Require three finite numbers. Raises SceneError."""
    finite(three(given, field), field)
