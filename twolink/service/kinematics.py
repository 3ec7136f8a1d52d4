"""Queries that the service adds to those of the command line: poses of many links, and derivatives of the dynamics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from twolink.algorithms.functions import frame_index
from twolink.dynamics import Robot
from twolink.dynamics.arguments import configuration, rows
from twolink.dynamics.robot_record import link_frames
from twolink.errors import QueryError


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


def derivatives(robot: Robot, arguments: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """With tau (or neither): da_dq, da_dv, da_dtau; with a: dtau_dq, dtau_dv, dtau_da; each (..., nv, nv)."""
    if "tau" in arguments and "a" in arguments:
        remedy = "send tau for forward dynamics, a for inverse dynamics"
        raise QueryError("tau and a exclude each other", argument="a", remedy=remedy)
    zero = np.zeros(robot.nv)
    q, v = arguments["q"], arguments.get("v", zero)
    if "a" in arguments:
        matrices = robot.inverse_dynamics_derivatives(q, v, arguments["a"])
        return dict(zip(("dtau_dq", "dtau_dv", "dtau_da"), matrices, strict=True))
    matrices = robot.forward_dynamics_derivatives(q, v, arguments.get("tau", zero))
    return dict(zip(("da_dq", "da_dv", "da_dtau"), matrices, strict=True))
