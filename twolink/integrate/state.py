"""The state x = (q, v) of a robot, its rate, and its manifold.

q moves on a manifold: a quaternion or a (cos, sin) pair has length 1, which is why q' is not v:
    angle or length    q' = v
    (cos, sin)         c' = -s w, s' = c w
    planar             (x, y)' = R(cos, sin) (vx, vy), velocities being in the moving frame
    quaternion         p' = p * (w, 0) / 2, w in the moving frame
    free-flyer         r' = R(p) v, and the quaternion's rate
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from twolink.dynamics import Robot


class StateSpace:
    """Packs and unpacks states, and knows rates, distances and normalisation."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.curved = [j for j in robot.joints if j.kind not in ("vector", "mimic")]
        flat = [j for j in robot.joints if j.kind == "vector"]
        self._flat_q = np.concatenate([np.arange(j.q.start, j.q.stop) for j in flat] or [np.empty(0, int)])
        self._flat_v = np.concatenate([np.arange(j.v.start, j.v.stop) for j in flat] or [np.empty(0, int)])

    def pack(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """x = (q, v), (..., nq + nv)."""
        return np.concatenate([q, v], axis=-1)

    def unpack(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(q, v) with q back on its manifold."""
        q, v = x[..., : self.robot.nq], x[..., self.robot.nq :]
        return (self.robot.normalize(q) if self.curved else q), v

    def rate(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """q' (nq,) of one state."""
        if not self.curved:
            return v
        rate = np.empty_like(q)
        rate[self._flat_q] = v[self._flat_v]
        for joint in self.curved:
            rate[joint.q] = _curved_rate(joint.kind, q[joint.q], v[joint.v])
        return rate

    def distance(self, q: np.ndarray, other: np.ndarray) -> np.ndarray:
        """max |difference(q, other)| over the tangent space, rad or m, for rows (n, nq)."""
        if not self.curved:
            return np.asarray(np.abs(q - other).max(axis=-1, initial=0.0))
        model = self.robot.model
        return np.array([np.abs(pin.difference(model, a, b)).max() for a, b in zip(q, other, strict=True)])


def _curved_rate(kind: str, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    if kind == "cos-sin":
        return np.array([-q[1] * v[0], q[0] * v[0]])
    if kind == "planar":
        c, s = q[2], q[3]
        return np.array([c * v[0] - s * v[1], s * v[0] + c * v[1], -s * v[2], c * v[2]])
    if kind == "quaternion":
        return _quaternion_rate(q, v)
    return np.concatenate([_rotate(q[3:], v[:3]), _quaternion_rate(q[3:], v[3:])])


def _quaternion_rate(p: np.ndarray, w: np.ndarray) -> np.ndarray:
    x, y, z, s = p
    a, b, c = w
    return 0.5 * np.array(
        [s * a + y * c - z * b, s * b + z * a - x * c, s * c + x * b - y * a, -(x * a + y * b + z * c)]
    )


def _rotate(p: np.ndarray, u: np.ndarray) -> np.ndarray:
    """R(p) u = u + 2 s (w x u) + 2 w x (w x u), with p = (w, s)."""
    cross = np.cross(p[:3], u)
    return np.asarray(u + 2 * (p[3] * cross + np.cross(p[:3], cross)))
