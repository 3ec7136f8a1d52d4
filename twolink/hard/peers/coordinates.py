"""The coordinates that MuJoCo and Drake share, and Pinocchio's."""

from collections.abc import Iterable, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from twolink.hard.case import Track
from twolink.hard.peers.task import PeerTask


def to_peer(task: PeerTask, *, body_spin: bool) -> tuple[np.ndarray, np.ndarray]:
    """The initial state in the coordinates that peers share, joint by joint.

    One number for a joint of one degree of freedom. For a free body position and quaternion (w, x, y, z); velocity,
    then angular velocity, in the world's axes. body_spin: the angular velocity is in the body's axes.
    """
    q: list[float] = []
    for joint in task.joints:
        x = task.q[joint.q]
        q += {"free": [*x[:3], *x[-1:], *x[3:-1]], "continuous": [np.arctan2(x[-1], x[0])]}.get(joint.kind, [*x])
    return np.array(q), _turned(task, task.q[None], task.v[None], body_spin, inverse=False)[0]


def from_peer(task: PeerTask, q: np.ndarray, v: np.ndarray, *, body_spin: bool) -> Track:
    """Pinocchio's q (n, nq) and v (n, nv) of rows in the coordinates of `to_peer`."""
    out, at = np.empty((len(q), task.model.nq)), 0
    for joint in task.joints:
        if joint.kind == "free":
            quaternion = q[:, at + 3 : at + 7] / np.linalg.norm(q[:, at + 3 : at + 7], axis=1, keepdims=True)
            out[:, joint.q] = np.hstack([q[:, at : at + 3], quaternion[:, 1:], quaternion[:, :1]])
            at += 6
        elif joint.kind == "continuous":
            out[:, joint.q] = np.stack([np.cos(q[:, at]), np.sin(q[:, at])], axis=1)
        else:
            out[:, joint.q.start] = q[:, at]
        at += 1
    return Track(task.times, out, _turned(task, out, v, body_spin, inverse=True))


def _turned(task: PeerTask, q: np.ndarray, v: np.ndarray, body_spin: bool, *, inverse: bool) -> np.ndarray:
    """Velocities of free bodies from the body's axes to the world's, or back; v has one layout everywhere."""
    for joint in task.joints:
        if joint.kind == "free":
            v, at = v.copy(), joint.v.start
            turn = Rotation.from_quat(q[:, joint.q][:, 3:])
            for part in (slice(at, at + 3), slice(at + 3, at + 6))[: 1 if body_spin else 2]:
                v[:, part] = turn.apply(v[:, part], inverse=inverse)
    return v


def peer_columns(
    task: PeerTask,
    starts: Iterable[tuple[int, int]],
    free_q: Sequence[int] = range(7),
    free_v: Sequence[int] = range(6),
) -> tuple[np.ndarray, np.ndarray]:
    """The entries of a peer's q and v in the order of `to_peer`.

    starts: where each joint's entries begin in q and in v. free_q, free_v: the order of a free body's entries.
    """
    q: list[int] = []
    v: list[int] = []
    for joint, (q_start, v_start) in zip(task.joints, starts, strict=True):
        q += [q_start + k for k in (free_q if joint.kind == "free" else (0,))]
        v += [v_start + k for k in (free_v if joint.kind == "free" else (0,))]
    return np.array(q), np.array(v)
