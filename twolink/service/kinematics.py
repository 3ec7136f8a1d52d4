"""The query "kinematics": poses of many links at once."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from twolink.algorithms.functions import frame_index
from twolink.dynamics import Robot
from twolink.dynamics.arguments import configuration, rows
from twolink.dynamics.queries import Query
from twolink.dynamics.robot_record import link_frames


def link_poses(robot: Robot, q: ArrayLike, frames: Sequence[str] | None = None) -> np.ndarray:
    """Poses (..., n, 7) in the world: position [m] and quaternion (x y z w), of frames by name, or of all links.

    One pass through the tree for all links of a state: `Robot.frame_pose` takes one for each.
    """
    states = configuration("q", q, robot.nq, robot.joints)
    batch = states.shape[:-1]
    indices = link_frames(robot) if frames is None else [frame_index(robot.model, name, "frames") for name in frames]
    flat = rows(states, batch)
    poses = np.empty((len(flat), len(indices), 7))
    for i, state in enumerate(flat):
        pin.framesForwardKinematics(robot.model, robot.data, state)
        for k, index in enumerate(indices):
            poses[i, k] = pin.SE3ToXYZQUAT(robot.data.oMf[index])
    return poses.reshape(*batch, len(indices), 7)


def _kinematics(robot: Robot, q: ArrayLike, frames: list[str] | None = None) -> dict[str, Any]:
    """Poses (..., n, 7) of the links, or of frames, in the world: position [m], quaternion (x y z w)."""
    return {"frames": list(robot.frame_names) if frames is None else frames, "poses": link_poses(robot, q, frames)}


KINEMATICS = Query("kinematics", "link_poses", _kinematics, {"poses": (("frames", 7), "m, then 1")})
