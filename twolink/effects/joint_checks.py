"""What effects on joints have in common: checks of what is given by joint, and limits of effort."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any, Literal

from twolink.algorithms.spatial import Scalar, minus, plus
from twolink.dynamics import Robot
from twolink.effects.effect import finite, one_of
from twolink.effects.motion import Loads, Motion
from twolink.errors import SceneError

Limits = Mapping[str, float] | Literal["urdf"] | None


def check_joints(given: Any, robot: Robot, field: str, *, dofs: bool = False, coordinates: bool = False) -> None:
    """Require a mapping that names joints, one at least. Raises SceneError.

    dofs: joints with one degree of freedom only. coordinates: with one coordinate too, an angle or a length.
    """
    if not isinstance(given, Mapping):
        raise SceneError(f"expected values by joint, got {given!r}", where=field, remedy="such as {'elbow': 1.0}")
    if not given:
        raise SceneError("it names no joint", where=field, remedy="name joints, or leave the effect out")
    for joint in given:
        check_joint(joint, robot, field, dofs=dofs or coordinates, coordinate=coordinates)


def check_joint(joint: str, robot: Robot, field: str, *, dofs: bool = True, coordinate: bool = False) -> None:
    """Require a joint that moves, with one degree of freedom, or one coordinate. Raises SceneError."""
    if joint in locked_joints(robot):
        raise SceneError(f"joint {joint!r} is locked", where=field, remedy="leave it out, or load the robot without")
    one_of(joint, robot.joint_names, field, "joint")
    layout = next(j for j in robot.joints if j.name == joint)
    if dofs and layout.v.stop - layout.v.start != 1:
        one_of(joint, single_joints(robot), field, "joint of one degree of freedom")
    if coordinate and layout.kind != "vector":
        raise SceneError(
            f"joint {joint!r} is continuous: its configuration is (cos, sin), which does not count turns",
            where=field,
            remedy='give the joint limits in the URDF (type="revolute"), so that it has an angle',
        )


def check_values(given: Mapping[str, float], field: str, *, least: float = -math.inf) -> None:
    """Require finite numbers by joint. Raises SceneError."""
    for joint, value in given.items():
        finite(value, f"{field}.{joint}", least=least)


def locked_joints(robot: Robot) -> tuple[str, ...]:
    """The joints that were locked when the robot was loaded."""
    return tuple(robot.visuals.model.names[i] for i in robot.visuals.locked)


def single_joints(robot: Robot) -> list[str]:
    """The joints with one degree of freedom."""
    return [j.name for j in robot.joints if j.v.stop - j.v.start == 1]


def check_limits(limits: Limits, joints: Iterable[str], robot: Robot, field: str = "effort") -> None:
    """Require limits above 0 for joints that are driven; of "urdf", that the URDF gives them. Raises SceneError."""
    if limits is None:
        return
    driven = list(joints)
    if limits == "urdf":
        for joint in driven:
            value = _urdf_limit(robot.model, joint)
            if not (math.isfinite(value) and value > 0):
                raise SceneError(f"the URDF's effort limit of joint {joint!r} is {value:g}", where=field,
                                 remedy="give limits by joint")  # fmt: skip
        return
    if not isinstance(limits, Mapping):
        raise SceneError(f"expected limits by joint, or 'urdf', got {limits!r}", where=field,
                         remedy="such as {'elbow': 30.0}")  # fmt: skip
    for joint in limits:
        one_of(joint, driven, field, "driven joint")
    check_values(limits, field, least=0.0)


def clamped(torque: Scalar, joint: str, limits: Limits, motion: Motion, loads: Loads) -> Scalar:
    """The torque within its joint's limit L: -L, torque, or L. The distances to the limit go to the loads."""
    limit = _urdf_limit(motion.model, joint) if limits == "urdf" else (limits or {}).get(joint)
    if limit is None:
        return torque
    limit, xp = float(limit), motion.xp
    loads.limits += [(f"{joint}, lower", plus(torque, limit)), (f"{joint}, upper", minus(limit, torque))]
    return xp.where(xp.less(torque, -limit), -limit, xp.where(xp.less(limit, torque), limit, torque))


def _urdf_limit(model: Any, joint: str) -> float:
    return float(model.effortLimit[model.idx_vs[model.getJointId(joint)]])
