"""Stops at the ends of joints."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Literal

from twolink.dynamics import Robot
from twolink.effects.effect import finite
from twolink.effects.joint_checks import check_joints
from twolink.effects.switching import Switch
from twolink.errors import SceneError


class JointStops(Switch, frozen=True):
    """lower_k <= q_k <= upper_k, rigid: at a stop v_k becomes -e v_k (Newton 1687); under load the joint rests there.

    limits: (lower, upper) by joint, rad or m; "urdf" for those that the URDF gives. restitution: e, from 0 to 1.
    Bounces that have become smaller than the accuracy end in rest.
    """

    limits: Mapping[str, tuple[float, float]] | Literal["urdf"] = "urdf"
    restitution: float = 0.0

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
        if not any(math.isfinite(end) for ends in self.stops(robot).values() for end in ends):
            raise SceneError("no joint has a stop", where="limits", remedy="give limits by joint")

    def lockable(self, robot: Robot) -> Sequence[int]:
        """The joints with stops."""
        return [k for _, k in self.stops(robot)]

    def stops(self, robot: Robot) -> dict[tuple[int, int], tuple[float, float]]:
        """(lower, upper) by the places of a joint in q and in v."""
        found = {}
        for joint in robot.joints:
            if joint.kind != "vector" or joint.v.stop - joint.v.start != 1:
                continue
            place = joint.q.start, joint.v.start
            if self.limits != "urdf":
                if joint.name in self.limits:
                    lower, upper = self.limits[joint.name]
                    found[place] = float(lower), float(upper)
                continue
            ends = (float(getattr(robot.model, f"{end}PositionLimit")[place[0]]) for end in ("lower", "upper"))
            lower, upper = (x if abs(x) < 1e30 else math.copysign(math.inf, x) for x in ends)
            if lower < upper and (math.isfinite(lower) or math.isfinite(upper)):
                found[place] = lower, upper
        return found


def check_restitution(value: float) -> None:
    """Require a coefficient of restitution from 0 to 1. Raises SceneError."""
    finite(value, "restitution", least=0.0)
    if value > 1:
        raise SceneError(f"expected a number from 0 to 1, got {value:g}", where="restitution",
                         remedy="above 1 an impact would create energy")  # fmt: skip
