"""Forces and moments on links as functions of time."""

from typing import Literal

from twolink.algorithms.functions import frame_pose
from twolink.algorithms.spatial import Vec, add, cross, force_to_parent
from twolink.dynamics import Robot
from twolink.effects.effect import Effect, LinkName
from twolink.effects.frame_checks import check_frame, floats
from twolink.effects.inputs import Input, value_at
from twolink.effects.motion import Loads, Motion

Three = tuple[Input, Input, Input]


class FrameWrench(Effect, frozen=True):
    """A force f(t) at a point of a link, and a moment n(t): tau = J_v^T f + J_w^T n.

    J_v and J_w are the Jacobians of the point's velocity and of the link's angular velocity.

    Parameters
    ----------
    frame : str
        The link.
    force : (3,) inputs
        f, N: numbers or functions of time.
    moment : (3,) inputs
        n, N m: numbers or functions of time.
    axes : "world" or "frame"
        The axes of force and moment: the world's, or the link's, with which they turn.
    point : (3,) floats
        Where the force acts, in the link's frame, m.
    """

    frame: LinkName
    force: Three = (0.0, 0.0, 0.0)
    moment: Three = (0.0, 0.0, 0.0)
    axes: Literal["world", "frame"] = "world"
    point: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def check(self, robot: Robot) -> None:
        """Require a link that moves."""
        check_frame(self.frame, robot, "frame")

    def act(self, motion: Motion, loads: Loads) -> None:
        """Add f and n, moved to the joint that carries the link."""
        force, moment, point = _value(self.force, motion), _value(self.moment, motion), floats(self.point)
        if self.axes == "world":
            loads.force(self.frame, force, moment, point)
            return
        body, place = frame_pose(motion.model, self.frame)
        loads.wrench(body, *force_to_parent(place, (force, add(moment, cross(point, force)))))


def _value(vector: Three, motion: Motion) -> Vec:
    x, y, z = (value_at(component, motion.t, motion.xp) for component in vector)
    return x, y, z
