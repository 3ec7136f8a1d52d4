"""Checks of values by joint, and limits of effort, for effects on joints."""

import math
from collections.abc import Iterable, Mapping
from typing import Any, Literal

from twolink.algorithms.spatial import Scalar, minus, plus
from twolink.dynamics import Robot
from twolink.effects.effect import NotNegative, check_name, number
from twolink.effects.motion import Loads, Motion
from twolink.errors import SceneError

Limits = Mapping[str, NotNegative] | Literal["urdf"] | None


def check_joints(values: Any, robot: Robot, field: str, *, dofs: bool = False, coordinates: bool = False) -> None:
    """Require values by joint, for one joint or more. Raises SceneError.

    dofs: joints with one degree of freedom only. coordinates: joints with one coordinate only, an angle or a length.
    """
    if not values:
        raise SceneError("it names no joint", where=field, remedy="name joints, or leave the effect out")
    for joint in values:
        check_joint(joint, robot, field, dofs=dofs or coordinates, coordinate=coordinates)


def check_joint(joint: str, robot: Robot, field: str, *, dofs: bool = True, coordinate: bool = False) -> None:
    """Require a joint that moves: with one degree of freedom, or with one coordinate. Raises SceneError."""
    if joint in (robot.visuals.model.names[i] for i in robot.visuals.locked):
        raise SceneError(f"joint {joint!r} is locked", where=field, remedy="leave it out, or load the robot without")
    check_name(joint, robot.joint_names, field, "joint")
    if dofs:
        check_name(joint, single_joints(robot), field, "joint of one degree of freedom")
    if coordinate and next(j.kind for j in robot.joints if j.name == joint) != "vector":
        what = f"joint {joint!r} is continuous: its configuration is (cos, sin), which does not count turns"
        remedy = 'give the joint limits in the URDF (type="revolute"), so that it has an angle'
        raise SceneError(what, where=field, remedy=remedy)


def check_subset(values: Any, joints: Iterable[str], field: str, what: str) -> None:
    """Require values by joint for some of the joints alone, which are each a `what`. Raises SceneError."""
    for joint in values:
        check_name(joint, joints, field, what)


def check_values_or_urdf(
    values: Mapping[str, float] | None, urdf: Any, robot: Robot, field: str, what: str = ""
) -> None:
    """Require values by joint; or None, and values (nv,) in the URDF, named `what`. Raises SceneError."""
    if values is not None:
        check_joints(values, robot, field)
    elif not urdf.any():
        remedy = "give it by joint, or leave the effect out"
        raise SceneError(f"the URDF gives no joint {what or field}", where=field, remedy=remedy)


def values_by_dof(values: Mapping[str, float] | None, urdf: Any, motion: Motion) -> dict[int, float]:
    """The values of each degree of freedom that has one: those by joint, or for None the URDF's (nv,)."""
    if values is None:
        return dict(enumerate(urdf.tolist()))
    return {k: number(value) for joint, value in values.items() for k in motion.dofs(joint)}


def single_joints(robot: Robot) -> list[str]:
    """The joints with one degree of freedom."""
    return [j.name for j in robot.joints if j.v.stop - j.v.start == 1]


def check_limits(limits: Limits, joints: Iterable[str], robot: Robot) -> None:
    """Require effort limits of driven joints, or "urdf" where the URDF gives them. Raises SceneError."""
    if limits is not None and limits != "urdf":
        check_subset(limits, joints, "effort", "driven joint")
    for joint in joints if limits == "urdf" else ():
        value = _urdf_limit(robot.model, joint)
        if not (math.isfinite(value) and value > 0):
            what = f"the URDF's effort limit of joint {joint!r} is {value:g}"
            raise SceneError(what, where="effort", remedy="give limits by joint")


def clamped(torque: Scalar, joint: str, limits: Limits, motion: Motion, loads: Loads) -> Scalar:
    """The torque of a joint within its limit L: min(max(torque, -L), L). The loads note where it is not smooth."""
    limit = _urdf_limit(motion.model, joint) if limits == "urdf" else (limits or {}).get(joint)
    if limit is None:
        return torque
    limit, xp, before = number(limit), motion.xp, len(loads.limits) // 2
    loads.limits += [(f"{joint}, lower", plus(torque, limit)), (f"{joint}, upper", minus(limit, torque))]
    below, above = xp.less(torque, -limit), xp.less(limit, torque)
    if loads.sides is not None:
        side = loads.sides[before]
        below, above = xp.less(side, -0.5), xp.less(0.5, side)
    return xp.where(below, -limit, xp.where(above, limit, torque))


def _urdf_limit(model: Any, joint: str) -> float:
    return float(model.effortLimit[model.idx_vs[model.getJointId(joint)]])
