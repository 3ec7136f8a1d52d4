"""Stops at the ends of joints."""

import math
from collections.abc import Mapping, Sequence
from typing import Literal

from twolink.dynamics import Robot
from twolink.effects.effect import NotNegative
from twolink.effects.joint_checks import check_joints
from twolink.effects.switching import Stop, SwitchingEffect
from twolink.errors import SceneError
from twolink.robots.joint_layout import turns, urdf_limits


class JointStops(SwitchingEffect, frozen=True):
    """Rigid stops at the ends of joints, lower <= q <= upper, with Newton's restitution (Newton 1687).

        v+ = -e v-   at an impact

    Under load a joint rests at its stop. Bounces that have become smaller than the accuracy end in rest.

    Parameters
    ----------
    limits : mapping of joint to (lower, upper), or "urdf"
        Positions of the stops, rad or m; infinite for no stop. "urdf": the limits in the URDF.
    restitution : float
        e, from 0 to 1.
    """

    limits: Mapping[str, tuple[float, float]] | Literal["urdf"] = "urdf"
    restitution: NotNegative = 0.0

    def check(self, robot: Robot) -> None:
        """Names are joints with one coordinate, and the lower stop is below the upper one."""
        check_restitution(self.restitution)
        if self.limits != "urdf":
            check_joints(self.limits, robot, "limits", coordinates=True)
            for joint, ends in self.limits.items():
                pair = isinstance(ends, Sequence) and len(ends) == 2 and all(isinstance(x, (int, float)) for x in ends)
                if not pair or not ends[0] < ends[1]:
                    raise SceneError(f"expected (lower, upper), got {ends!r}", where=f"limits.{joint}",
                                     remedy="such as (-1.0, 1.0); inf for no stop")  # fmt: skip
        if not self.modes(robot):
            raise SceneError("no joint has a stop", where="limits", remedy="give limits by joint")

    def modes(self, robot: Robot) -> list[Stop]:
        """The stops at finite limits."""
        stops = []
        for joint in robot.joints:
            if joint.kind != "vector" or joint.v.stop - joint.v.start != 1:
                continue
            unit = "rad/s" if turns(robot.model, joint) else "m/s"
            for position, side in zip(self._limits_of(joint.name, joint.q.start, robot), (1.0, -1.0), strict=True):
                if math.isfinite(position):
                    stops.append(Stop(joint.name, joint.v.start, joint.q.start, position, side, self.restitution, unit))
        return stops

    def _limits_of(self, joint: str, entry: int, robot: Robot) -> tuple[float, float]:
        """(lower, upper) of a joint; infinite where there is no stop."""
        if self.limits != "urdf":
            lower, upper = self.limits.get(joint, (-math.inf, math.inf))
            return float(lower), float(upper)
        return urdf_limits(robot.model, entry)


def check_restitution(value: float) -> None:
    """Require a coefficient of restitution of at most 1. Raises SceneError."""
    if value > 1:
        raise SceneError(f"expected a number from 0 to 1, got {value:g}", where="restitution",
                         remedy="above 1 an impact would create energy")  # fmt: skip
