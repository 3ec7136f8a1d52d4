"""Joints that stop and stick: stops, dry friction and detents."""

import math
from collections.abc import Mapping, Sequence
from typing import Literal

from twolink.dynamics import Robot
from twolink.effects.checks import check_values_or_urdf
from twolink.effects.conditions import JointReaches
from twolink.effects.effect import CoordinateJoint, Load, NotNegative, Place, Share, SingleJoint, check_name, number
from twolink.effects.switching import Catch, JointLock, Stop, SwitchingEffect, Trigger
from twolink.errors import SceneError
from twolink.robots.joint_layout import urdf_limits


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

    limits: Mapping[CoordinateJoint, tuple[Place, Place]] | Literal["urdf"] = "urdf"
    restitution: Share = 0.0

    def check(self, robot: Robot) -> None:
        """The lower stop is below the upper one."""
        if self.limits != "urdf":
            for joint, ends in self.limits.items():
                pair = isinstance(ends, Sequence) and len(ends) == 2 and all(isinstance(x, (int, float)) for x in ends)
                if not pair or not number(ends[0]) < number(ends[1]):
                    raise SceneError(f"expected (lower, upper), got {ends!r:.60}", where=f"limits.{joint}",
                                     remedy="such as (-1.0, 1.0); inf for no stop")  # fmt: skip
        if not self.modes(robot):
            raise SceneError("no joint has a stop", where="limits", remedy="give limits by joint")

    def modes(self, robot: Robot) -> list[Stop]:
        """The stops at finite limits."""
        stops = []
        for joint in robot.joints:
            if joint.kind != "vector" or joint.v.stop - joint.v.start != 1:
                continue
            unit = f"{joint.unit}/s"
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


class DryFriction(SwitchingEffect, frozen=True):
    """Dry friction that holds joints at rest (Coulomb 1785).

        tau_k = -c_k sign(v_k)   while joint k slips
        |tau_k| <= s_k           at rest; a joint that comes to rest sticks until more is needed to hold it

    Parameters
    ----------
    kinetic : mapping of joint to float, or "urdf"
        c, N m or N, not negative. Joints with one degree of freedom. "urdf": all joints to which the URDF gives one
        (<dynamics friction>), which forward dynamics alone does not apply.
    static : mapping of joint to float
        s, N m or N, not below c; c by default.
    """

    kinetic: Mapping[SingleJoint, Load] | Literal["urdf"] = "urdf"
    static: Mapping[str, Load] = {}

    def check(self, robot: Robot) -> None:
        """Require friction in the URDF where it is asked for, and s that is not below c."""
        if self.kinetic == "urdf":
            check_values_or_urdf(None, robot.model.friction, "kinetic", "friction")
        kinetic = self._kinetic(robot)
        for joint, level in self.static.items():
            check_name(joint, kinetic, "static", "joint with kinetic friction")
            if number(level) < kinetic[joint]:
                raise SceneError(f"it is {level:g}, below the kinetic friction {kinetic[joint]:g}",
                                 where=f"static.{joint}", remedy="static friction is the larger one")  # fmt: skip

    def modes(self, robot: Robot) -> list[JointLock]:
        """Static friction holds a joint, kinetic friction brakes it."""
        dofs = {joint.name: joint.v.start for joint in robot.joints}
        kinetic = self._kinetic(robot)
        static = {name: float(self.static.get(name, c)) for name, c in kinetic.items()}
        return [JointLock(dofs[name], -static[name], static[name], c) for name, c in kinetic.items()]

    def _kinetic(self, robot: Robot) -> dict[str, float]:
        """The kinetic friction of each joint that has one."""
        if self.kinetic == "urdf":
            friction = robot.model.friction
            return {joint.name: float(friction[joint.v.start]) for joint in robot.joints if friction[joint.v].any()}
        return {name: float(c) for name, c in self.kinetic.items()}


class Detent(SwitchingEffect, frozen=True):
    """A joint that a spring-loaded ball holds at a notch, until that takes more than a torque.

        |tau| <= T   while q = p and v = 0;   else tau = 0
        v+ = 0       where q passes p with |v| <= s: the ball falls into the notch

    Past the breakaway torque T the joint is free, until it passes a notch slowly. Then the ball stops it by an impulse,
    and the kinetic energy that this takes is lost. A faster joint passes without loss.

    Parameters
    ----------
    joint : str
        A joint with one coordinate.
    torque : float
        Breakaway torque T, N m or N.
    positions : tuple of float
        Notches p, rad or m.
    speed : float
        Largest speed s at which the ball falls into a notch, rad/s or m/s. 0: it never does.

    Notes
    -----
    An ideal detent: the width of the notch and the spring's force on its flanks are left out.
    """

    joint: CoordinateJoint
    torque: NotNegative
    positions: tuple[float, ...] = (0.0,)
    speed: NotNegative = 0.0

    def check(self, robot: Robot) -> None:
        """Require a notch."""
        del robot
        if not self.positions:
            raise SceneError("there is no notch", where="positions", remedy="such as (0.0,)")

    def modes(self, robot: Robot) -> list[JointLock | Trigger]:
        """The ball in each notch, and the ball that falls into it."""
        joint = next(j for j in robot.joints if j.name == self.joint)
        entry, dof, torque, speed = joint.q.start, joint.v.start, float(self.torque), float(self.speed)
        unit = f"{joint.unit}/s"
        modes: list[JointLock | Trigger] = []
        for p in map(float, self.positions):
            modes.append(JointLock(dof, -torque, torque, 0.0, entry, p, ("catch", "breakaway")))
            if speed:
                catch = Catch(dof, entry, p, speed, unit)
                modes.append(Trigger("catch", self.joint, condition=JointReaches(self.joint, p), catch=catch))
        return modes
