"""A robot as plain data: sizes, joints with their limits, links, and the load report."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pinocchio as pin

from twolink.dynamics import Robot


def describe(robot: Robot) -> dict[str, Any]:
    """What a client needs to ask about a robot. Limits that are not there are None."""
    return {
        "name": robot.name,
        "nq": robot.nq,
        "nv": robot.nv,
        "mass": robot.mass,
        "gravity": robot.gravity.tolist(),
        "neutral": robot.neutral.tolist(),
        "joints": [_joint(robot, i) for i in range(len(robot.joints))],
        "links": link_names(robot),
        "report": robot.report.to_dict(),
    }


def _joint(robot: Robot, i: int) -> dict[str, Any]:
    joint, model = robot.joints[i], robot.model
    return {
        "name": joint.name,
        "kind": model.joints[joint.index].shortname().removeprefix("JointModel"),
        "layout": joint.kind,
        "q": [joint.q.start, joint.q.stop],
        "v": [joint.v.start, joint.v.stop],
        "lower": _limits(model.lowerPositionLimit[joint.q]),
        "upper": _limits(model.upperPositionLimit[joint.q]),
        "velocity_limit": _limits(model.velocityLimit[joint.v]),
        "effort_limit": _limits(model.upperEffortLimit[joint.v]),
        "mass": model.inertias[joint.index].mass,
    }


def _limits(values: np.ndarray) -> list[float | None]:
    """Pinocchio writes no limit as infinity, or as the largest double."""
    return [float(x) if math.isfinite(x) and abs(x) < 1e300 else None for x in values]


def link_frames(robot: Robot) -> list[int]:
    """The frames of the links, in the model's order."""
    return [i for i, frame in enumerate(robot.model.frames) if frame.type == pin.FrameType.BODY]


def link_names(robot: Robot) -> list[str]:
    """The links, in the model's order."""
    return [robot.model.frames[i].name for i in link_frames(robot)]
