"""Checks of frames and points, for effects on frames."""

from twolink.algorithms.functions import frame_pose
from twolink.algorithms.spatial import Scalar, Vec, minus
from twolink.dynamics import Robot
from twolink.effects.effect import check_name, number
from twolink.effects.motion import GROUND, Motion
from twolink.errors import SceneError


def check_frame(frame: str, robot: Robot, field: str, *, ground: bool = False) -> int:
    """Require a link that moves, or with `ground` any link or the ground. Raises SceneError.

    Returns the number of the body that carries the link's frame; the ground is body 0.
    """
    names = [f.name for f in robot.model.frames if f.type.name == "BODY"]
    if frame == GROUND and frame not in names:
        body = 0
    else:
        check_name(frame, [*names, GROUND] if ground else names, field, "frame")
        body = frame_pose(robot.model, frame)[0]
    if body == 0 and not ground:
        what = f"frame {frame!r} does not move, so the effect changes nothing"
        raise SceneError(what, where=field, remedy="name a link that moves")
    return body


def apart(motion: Motion, a: str, point_a: Vec, b: str, point_b: Vec) -> list[Scalar]:
    """x_a - x_b of two frames' points, along the axes that the motion is seen in, m."""
    ends = motion.position(a, point_a), motion.position(b, point_b)
    return [minus(x, y) for x, y in zip(*ends, strict=True)]


def floats(vector: tuple[float, float, float]) -> Vec:
    """Three numbers as floats, which a formula folds as constants."""
    x, y, z = map(number, vector)
    return x, y, z
