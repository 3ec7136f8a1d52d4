"""A robot as plain data: what the command line prints as JSON and the service answers."""

import math
from typing import Any

import numpy as np
import pinocchio as pin

from twolink.dynamics.robot import Robot


def robot_record(robot: Robot) -> dict[str, Any]:
    """A robot as plain data, for JSON.

    Parameters
    ----------
    robot : Robot

    Returns
    -------
    dict
        name, nq, nv, mass [kg], gravity [m/s^2] and neutral (nq numbers); joints: dictionaries with name, kind
        (Pinocchio's), layout, q and v (start and stop of the joint's entries), limits (None where there is none) and
        the mass moved [kg]; links (names), and those fixed to the ground; report (the load report).
    """
    return {
        "name": robot.name,
        "nq": robot.nq,
        "nv": robot.nv,
        "mass": robot.mass,
        "gravity": robot.gravity.tolist(),
        "neutral": robot.neutral.tolist(),
        "joints": [_joint(robot, i) for i in range(len(robot.joints))],
        "links": list(robot.frame_names),
        "fixed_links": [
            robot.model.frames[i].name for i in link_frames(robot) if not robot.model.frames[i].parentJoint
        ],
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
    """Limits as numbers. Pinocchio writes a missing limit as infinity or as the largest double."""
    return [float(x) if math.isfinite(x) and abs(x) < 1e300 else None for x in values]


def link_frames(robot: Robot) -> list[int]:
    """The indices of the links' frames, in the model's order."""
    return [i for i, frame in enumerate(robot.model.frames) if frame.type == pin.FrameType.BODY]
