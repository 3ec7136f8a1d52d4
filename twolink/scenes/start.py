"""The start of a scene: states by joint name, and what is remarked on a start that may be a mistake."""

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from twolink.dynamics import Robot
from twolink.errors import SceneError, nearest
from twolink.robots.joint_layout import turns, urdf_limits

MANY_TURNS = 2 * math.pi  # rad, from which on an angle may have been meant in degrees


def state_by_joint(robot: Robot, values: Mapping[str, ArrayLike], name: str) -> np.ndarray:
    """A configuration (nq,) or velocity (nv,) from values by joint name; others are neutral, and at rest.

    Parameters
    ----------
    robot : Robot
    values : mapping of joint to array_like
        A joint's entries; a continuous joint's q may be its angle [rad].
    name : {"q", "v"}
        Which of the two.

    Returns
    -------
    ndarray

    Raises
    ------
    SceneError
        There is no such joint (code "unknown-joint"), or the joint has another number of entries.
    """
    state = np.array(robot.neutral if name == "q" else np.zeros(robot.nv))
    joints = {joint.name: joint for joint in robot.joints}
    for joint_name, value in values.items():
        if joint_name not in joints:
            what, remedy = f"robot {robot.name!r} has no joint {joint_name!r}", nearest(joint_name, joints)
            raise SceneError(what, where=name, remedy=remedy, code="unknown-joint", argument=name)
        joint, where = joints[joint_name], f"{name}.{joint_name}"
        part = joint.q if name == "q" else joint.v
        try:
            numbers = joint.configuration(value) if name == "q" else np.atleast_1d(np.asarray(value, dtype=float))
        except (TypeError, ValueError):
            raise SceneError(f"expected numbers, got {value!r}", where=where, remedy="give SI units",
                             code="schema", argument=name) from None  # fmt: skip
        if numbers.shape != (part.stop - part.start,):
            what = f"expected {part.stop - part.start} numbers, got {numbers.size}"
            remedy = "give the joint's configuration or velocity"
            raise SceneError(what, where=where, remedy=remedy, code="schema", argument=name)
        state[part] = numbers
    return state


def start_notes(robot: Robot, q: np.ndarray) -> list[str]:
    """What may be a mistake in a start q (nq,): joints beyond the URDF's limits, angles that may be in degrees."""
    notes = []
    for joint in robot.joints:
        if joint.kind != "vector" or joint.v.stop - joint.v.start != 1:
            continue
        value, angle = float(q[joint.q.start]), turns(robot.model, joint)
        lower, upper = urdf_limits(robot.model, joint.q.start)
        unit = "rad" if angle else "m"
        note = ""
        if not lower <= value <= upper:
            note = f", beyond the limits {lower:.4g} to {upper:.4g} {unit} of the URDF"
        if angle and abs(value) > MANY_TURNS:
            note += f"; angles are in radians: {value:.4g} degrees are {math.radians(value):.4g} rad"
        if note:
            notes.append(f"{joint.name} starts at {value:.4g} {unit}{note}")
    return notes
