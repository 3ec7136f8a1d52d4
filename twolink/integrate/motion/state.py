"""The state x = (q, v, z) of a robot and of its effects, its rate, and its manifold.

q moves on a manifold: a quaternion or a (cos, sin) pair has length 1, which is why q' is not v:
    angle or length    q' = v
    (cos, sin)         c' = -s w, s' = c w
    planar             (x, y)' = R(cos, sin) (vx, vy), velocities being in the moving frame
    quaternion         p' = p * (w, 0) / 2, w in the moving frame
    free-flyer         r' = R(p) v, and the quaternion's rate

z are states of effects, such as the current of a motor.

Arrays are (size,) of one state or (size, n) of many, one state a column; entries are numbers or expressions.
"""

from typing import Any

import numpy as np

from twolink.dynamics import Robot
from twolink.dynamics.configurations import difference_rows

Array = np.ndarray[Any, np.dtype[Any]]


class StateSpace:
    """Packs and unpacks states, and knows rates, distances and normalisation."""

    def __init__(self, robot: Robot, numbers: int = 0, states: tuple[str, ...] = ()) -> None:
        self.robot, self.states = robot, states  # the names of z
        self.nq, self.nv = robot.nq, robot.nv
        self.moving = robot.nq + robot.nv + len(states)
        self.size = self.moving + numbers  # rows behind (q, v, z) that are constant within a piece
        self.v_rows, self.z_rows = slice(self.nq, self.nq + self.nv), slice(self.nq + self.nv, self.moving)
        self.tangent = 2 * self.nv + len(states)  # rows of a change: of q in the tangent space, of v and of z
        self.curved = [j for j in robot.joints if j.kind not in ("vector", "mimic")]
        flat = [j for j in robot.joints if j.kind == "vector"]
        self._flat_q = np.concatenate([np.arange(j.q.start, j.q.stop) for j in flat] or [np.empty(0, int)])
        self._flat_v = np.concatenate([np.arange(j.v.start, j.v.stop) for j in flat] or [np.empty(0, int)])
        # Entries whose errors count as they are: angles, lengths, unit vectors; a velocity's counts by its size.
        self.absolute = np.arange(self.size) < self.nq
        # Of each joint, its rows of q and of v.
        self.joint_rows = tuple((j.q, slice(j.v.start + self.nq, j.v.stop + self.nq))
                                for j in robot.joints if j.kind != "mimic")  # fmt: skip
        turning = [j for j in flat if j.unit == "rad"]
        self.angles = np.array([j.q.start for j in turning], dtype=int)

    def rows(self, x: Array) -> tuple[Array, Array]:
        """(q, v) as arrays (n, nq), (n, nv) of states (size, n), q back on its manifold."""
        q, v = np.ascontiguousarray(x[: self.nq].T), np.ascontiguousarray(x[self.v_rows].T)
        return (self.robot.normalize(q) if self.curved else q), v

    def rate(self, q: Array, v: Array) -> Array:
        """q' (nq, ...) for q (nq, ...) and v (nv, ...)."""
        if not self.curved:
            return v
        rate = np.empty_like(q)
        rate[self._flat_q] = v[self._flat_v]
        for joint in self.curved:
            rate[joint.q] = _curved_rate(joint.kind, q[joint.q], v[joint.v])
        return rate

    def normalized(self, x: Array, xp: Any) -> Array:
        """x with its quaternions and (cos, sin) pairs scaled to length 1."""
        units = [joint.normalized for joint in self.curved if joint.normalized is not None]
        if units:
            x = x.copy()
        for unit in units:
            part = x[unit]
            x[unit] = part / xp.sqrt((part * part).sum(axis=0))
        return x

    def distance(self, q: Array, other: Array) -> Array:
        """The distance of configurations, max |difference(q, other)| over the tangent space.

        Parameters
        ----------
        q, other : ndarray (n, nq)
            Configurations on their manifold.

        Returns
        -------
        distance : ndarray (n,)
            In rad or m.

        Notes
        -----
        Angles between (cos, sin) pairs are computed here: pin.difference gives exactly 0 for many below 1e-8.
        """
        if not self.curved:
            return np.asarray(np.abs(q - other).max(axis=-1, initial=0.0))
        return np.asarray(np.abs(difference_rows(self.robot, q, other)).max(axis=-1, initial=0.0))


def _curved_rate(kind: str, q: Array, v: Array) -> Array:
    if kind == "cos-sin":
        return np.array([-q[1] * v[0], q[0] * v[0]])
    if kind == "planar":
        c, s = q[2], q[3]
        return np.array([c * v[0] - s * v[1], s * v[0] + c * v[1], -s * v[2], c * v[2]])
    if kind == "quaternion":
        return _quaternion_rate(q, v)
    return np.concatenate([_rotated(q[3:], v[:3]), _quaternion_rate(q[3:], v[3:])])


def _quaternion_rate(p: Array, w: Array) -> Array:
    x, y, z, s = p
    a, b, c = w
    return 0.5 * np.array(
        [s * a + y * c - z * b, s * b + z * a - x * c, s * c + x * b - y * a, -(x * a + y * b + z * c)]
    )


def _rotated(p: Array, u: Array) -> Array:
    """R(p) u = u + 2 s (w x u) + 2 w x (w x u), with p = (w, s)."""
    w, s = p[:3], p[3]
    once = _cross(w, u)
    return np.asarray(2.0 * (np.array([s * x for x in once]) + _cross(w, once)) + u)  # p may be jets: they lead


def _cross(a: Array, b: Array) -> Array:
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
