"""Queries the service adds to those of Robot: where links are, and the derivatives of the dynamics."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from twolink.dynamics import Robot
from twolink.dynamics.arguments import array, batch_shape, configuration, rows
from twolink.dynamics.robot_record import link_frames
from twolink.errors import QueryError, nearest


def frame_poses(robot: Robot, q: ArrayLike, frames: Sequence[str] | None = None) -> np.ndarray:
    """Poses (..., n, 7) in the world: position [m] and quaternion (x y z w), of frames by name, or of all links."""
    states = configuration("q", q, robot.nq, robot.joints)
    batch = states.shape[:-1]
    indices = link_frames(robot) if frames is None else [_frame(robot, name) for name in frames]
    flat = rows(states, batch)
    poses = np.empty((len(flat), len(indices), 7))
    for i, configured in enumerate(flat):
        pin.framesForwardKinematics(robot.model, robot.data, configured)
        for k, index in enumerate(indices):
            poses[i, k] = pin.SE3ToXYZQUAT(robot.data.oMf[index])
    return poses.reshape(*batch, len(indices), 7)


def _frame(robot: Robot, name: str) -> int:
    if not robot.model.existFrame(name):
        known = [frame.name for frame in robot.model.frames]
        raise QueryError(f"there is no frame {name!r}", where="frames", remedy=nearest(name, known))
    return int(robot.model.getFrameId(name))


def derivatives(robot: Robot, arguments: dict[str, Any]) -> dict[str, np.ndarray]:
    """With tau (or neither): da_dq, da_dv, da_dtau; with a: dtau_dq, dtau_dv, dtau_da; each (..., nv, nv).

    Derivatives to q are along tangent directions, as v is. Raises QueryError for mimic joints.
    """
    if robot.has_mimic:
        raise QueryError("there are none for mimic joints", where="robot", remedy="load it with mimic=false")
    if "tau" in arguments and "a" in arguments:
        raise QueryError("tau and a are both given", where="a", remedy="tau: forward dynamics; a: inverse dynamics")
    inverse = "a" in arguments
    third = "a" if inverse else "tau"
    still = np.zeros(robot.nv)
    q = configuration("q", arguments["q"], robot.nq, robot.joints)
    v, last = (array(name, arguments.get(name, still), robot.nv) for name in ("v", third))
    batch = batch_shape(q=q, v=v, **{third: last})
    states = list(zip(*(rows(x, batch) for x in (q, v, last)), strict=True))
    result = np.empty((3, len(states), robot.nv, robot.nv))
    for i, state in enumerate(states):
        result[:, i] = _inverse(robot, *state) if inverse else _forward(robot, *state)
    if not np.isfinite(result).all():
        what = "the result is not finite"
        raise QueryError(what, where=f"robot {robot.name!r}", remedy="the values overflow, or the mass matrix does")
    shaped = result.reshape(3, *batch, robot.nv, robot.nv)
    names = ("dtau_dq", "dtau_dv", "dtau_da") if inverse else ("da_dq", "da_dv", "da_dtau")
    return dict(zip(names, shaped, strict=True))


def _forward(robot: Robot, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> tuple[np.ndarray, ...]:
    data = robot.data
    pin.computeABADerivatives(robot.model, data, q, v, tau)
    return data.ddq_dq, data.ddq_dv, _symmetric(data.Minv)


def _inverse(robot: Robot, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> tuple[np.ndarray, ...]:
    data = robot.data
    pin.computeRNEADerivatives(robot.model, data, q, v, a)
    return data.dtau_dq, data.dtau_dv, _symmetric(data.M)


def _symmetric(upper: np.ndarray) -> np.ndarray:
    """Pinocchio fills the upper half."""
    return np.asarray(np.triu(upper) + np.triu(upper, 1).T)
