"""Forces and moments on frames as functions of time."""

from __future__ import annotations

from typing import Literal

from twolink.algorithms.functions import frame_pose
from twolink.algorithms.spatial import Vec, add, cross, force_to_parent, plus
from twolink.dynamics import Robot
from twolink.effects.effect import Effect, one_of
from twolink.effects.frame_checks import check_frame, check_three, floats, three
from twolink.effects.inputs import Input, check_input, value_at
from twolink.effects.motion import Loads, Motion

Three = tuple[Input, Input, Input]


class FrameWrench(Effect, frozen=True):
    """A force f(t) at a point of a frame and a moment n(t).

    frame: a link. force, moment: N and N m, numbers or functions of time, along the axes of the "world" or of the
    "frame", with which they turn. point: where the force acts, in the frame, m.
    """

    frame: str
    force: Three = (0.0, 0.0, 0.0)
    moment: Three = (0.0, 0.0, 0.0)
    axes: Literal["world", "frame"] = "world"
    point: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def check(self, robot: Robot) -> None:
        """The frame moves; inputs are finite."""
        check_frame(self.frame, robot, "frame")
        one_of(self.axes, ("world", "frame"), "axes", "choice")
        check_three(self.point, "point")
        for name in ("force", "moment"):
            for i, given in enumerate(three(getattr(self, name), name)):
                check_input(given, f"{name}[{i}]")

    def act(self, motion: Motion, loads: Loads) -> None:
        """f and n, moved to the joint that carries the frame."""
        force, moment, point = _now(self.force, motion), _now(self.moment, motion), floats(self.point)
        if self.axes == "world":
            loads.force(self.frame, force, moment, point)
            return
        i, place = frame_pose(motion.model, self.frame)
        at_joint = force_to_parent(place, (force, add(moment, cross(point, force))))
        before = loads.wrenches.get(i, [0.0] * 6)
        loads.wrenches[i] = [plus(a, b) for a, b in zip(before, (*at_joint[0], *at_joint[1]), strict=True)]


def _now(given: Three, motion: Motion) -> Vec:
    x, y, z = (value_at(one, motion.t, motion.xp) for one in given)
    return x, y, z
