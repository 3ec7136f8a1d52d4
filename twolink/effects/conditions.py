"""Conditions: quantities of the moving robot that reach a value, where an event happens."""

from typing import Literal

import msgspec

from twolink.algorithms.motion import KinematicState
from twolink.algorithms.spatial import Scalar, dot, unit
from twolink.dynamics import Robot
from twolink.effects.checks import check_fields, check_joint
from twolink.effects.effect import Direction, LinkName, SingleJoint
from twolink.errors import SceneError


class JointReaches(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="joint-reaches"):
    """A joint's position or velocity reaches a value, from either side.

    Parameters
    ----------
    joint : str
        A joint with one degree of freedom; for positions, with one coordinate.
    value : float
        rad or m, or per second.
    of : {"position", "velocity"}
        The quantity.
    """

    joint: SingleJoint
    value: float
    of: Literal["position", "velocity"] = "position"

    def distance(self, motion: KinematicState) -> Scalar:
        """The signed distance from the value: 0 when it is reached."""
        if self.of == "velocity":
            return motion.v[motion.dofs(self.joint)[0]] - self.value
        return motion.q[motion.coordinate(self.joint)[0]] - self.value


class FrameReaches(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="frame-reaches"):
    """A point's position or velocity along a direction of the world reaches a value, from either side.

    Parameters
    ----------
    frame : str
        A link.
    value : float
        m or m/s.
    of : {"position", "velocity"}
        The quantity.
    direction : (float, float, float)
        Along the world's axes, of any length: it is scaled to 1.
    point : (float, float, float)
        In the link's axes, m.
    """

    frame: LinkName
    value: float
    of: Literal["position", "velocity"] = "position"
    direction: Direction = (0.0, 0.0, 1.0)
    point: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def distance(self, motion: KinematicState) -> Scalar:
        """The signed distance from the value: 0 when it is reached."""
        see = motion.velocity if self.of == "velocity" else motion.position
        return dot(unit(self.direction, "direction"), see(self.frame, self.point)) - self.value


Condition = JointReaches | FrameReaches


def check_condition(when: Condition, robot: Robot, field: str) -> None:
    """Require a condition that fits the robot. Raises SceneError."""
    check_fields(when, robot, f"{field}.")
    if isinstance(when, JointReaches) and when.of == "position":
        check_joint(when.joint, robot, f"{field}.joint", coordinate=True)


def check_when(at: float | None, when: Condition | None, robot: Robot) -> None:
    """Require one of a time and a condition, and that it fits the robot. Raises SceneError."""
    if (at is None) == (when is None):
        what = "neither a time nor a condition is given" if at is None else "a time and a condition are both given"
        remedy = 'at = 1.5, or when = {kind = "joint-reaches", joint = .., value = ..}'
        raise SceneError(what, where="at", remedy=remedy)
    if when is not None:
        check_condition(when, robot, "when")
