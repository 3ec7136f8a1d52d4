"""Configurations as points of a manifold: differences, steps and random ones; and inverse kinematics: those that bring
a frame to a place, within the joints' limits.

Levenberg and Marquardt's method on e = (p* - p, log(R* R^T)), whose damping goes to 0 with the residual:

    (J^T J + |e|^2 / 2) dq = J^T e

so that it is safe at singular configurations and of second order where it ends. Joints at a limit that they would
leave stand still in a step.

References
----------
Sugihara 2011, "Solvability-unconcerned inverse kinematics by the Levenberg-Marquardt method", IEEE Trans. Robotics 27.
"""

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from twolink.dynamics.arguments import array, batch_shape, configuration, rows, whole
from twolink.dynamics.pinocchio_queries import query_of
from twolink.dynamics.queries import Array
from twolink.errors import QueryError
from twolink.robots.joint_layout import JointLayout
from twolink.robots.model import RobotModel

NEAR = 1e-10  # m and rad: how near a solution is
STEPS = 200  # from one start
STARTS = 20  # random ones, where the first does not lead there
LARGEST = 1.0  # rad or m, of a joint in a step
SAME = 1e-8  # how far a rotation matrix may be from one


def difference(robot: RobotModel, q0: ArrayLike, q1: ArrayLike) -> Array:
    """The tangent vector (..., nv) from q0 to q1; see `Robot.difference`."""
    start, end = (configuration(name, q, robot.nq, robot.joints) for name, q in (("q0", q0), ("q1", q1)))
    batch = batch_shape(q0=start, q1=end)
    return difference_rows(robot, rows(start, batch), rows(end, batch)).reshape(*batch, robot.nv)


def difference_rows(robot: RobotModel, start: Array, end: Array) -> Array:
    """The tangent vectors (n, nv) between rows of configurations (n, nq), which are not checked."""
    found = [pin.difference(robot.model, *pair) for pair in zip(start, end, strict=True)]
    out = np.array(found).reshape(len(start), robot.nv)
    # Pinocchio takes these angles from an arc cosine, which is 0 for angles below 1e-8.
    for joint in robot.joints:
        if joint.kind == "cos-sin":
            out[:, joint.v] = _angle(start[:, joint.q], end[:, joint.q])[:, None]
        elif joint.kind == "planar":
            out[:, joint.v] = _planar(start[:, joint.q], end[:, joint.q])
    return out


def _angle(start: Array, end: Array) -> Array:
    """The angle (n,) from one (cos, sin) pair (n, 2) to another, in [-pi, pi]."""
    (c0, s0), (c1, s1) = start.T, end.T
    return np.asarray(np.arctan2(c0 * s1 - s0 * c1, c0 * c1 + s0 * s1))


def _planar(start: Array, end: Array) -> Array:
    """The logarithm in SE(2), (n, 3), from one (x, y, cos, sin) (n, 4) to another."""
    angle = _angle(start[:, 2:], end[:, 2:])
    c, s = start[:, 2:].T
    x, y = (end - start)[:, :2].T
    x, y = c * x + s * y, c * y - s * x
    half = angle / 2
    with np.errstate(invalid="ignore"):
        along = np.where(half == 0.0, 1.0, half / np.tan(half))
    return np.stack([along * x + half * y, along * y - half * x, angle], axis=-1)


def _planar_step(start: Array, step: Array) -> Array:
    """The exponential in SE(2): (x, y, cos, sin) (n, 4) after a step (n, 3) along the body's axes."""
    (x, y, c, s), (along, across, angle) = start.T, step.T
    straight, bent = np.sinc(angle / np.pi), angle / 2 * np.sinc(angle / 2 / np.pi) ** 2  # sin w / w, (1 - cos w) / w
    dx, dy = straight * along - bent * across, bent * along + straight * across
    turn, turned = np.cos(angle), np.sin(angle)
    return np.stack([x + c * dx - s * dy, y + s * dx + c * dy, c * turn - s * turned, s * turn + c * turned], axis=-1)


def integrate(robot: RobotModel, q: ArrayLike, dv: ArrayLike) -> Array:
    """The configuration (..., nq) reached from q by dv (..., nv); see `Robot.integrate`."""
    start, step = configuration("q", q, robot.nq, robot.joints), array("dv", dv, robot.nv)
    batch = batch_shape(q=start, dv=step)
    start, step = rows(start, batch), rows(step, batch)
    found = [pin.integrate(robot.model, *pair) for pair in zip(start, step, strict=True)]
    out = np.array(found).reshape(len(start), robot.nq)
    # Pinocchio divides by the angle, which loses digits where that is small.
    for joint in robot.joints:
        if joint.kind == "planar":
            out[:, joint.q] = _planar_step(start[:, joint.q], step[:, joint.v])
    return robot.normalize(out).reshape(*batch, robot.nq)


def random_state(robot: RobotModel, n: int, seed: int = 0) -> tuple[Array, Array]:
    """n random states; see `Robot.random_state`."""
    n, rng = whole(n, "n", QueryError, "such as 10"), np.random.default_rng(whole(seed, "seed", QueryError))
    lower, upper = np.clip(_limits(robot.joints), -1e100, 1e100)  # a range that is not limited overflows
    low = np.where(upper - lower > 2 * np.pi, np.clip(-np.pi, lower, upper - 2 * np.pi), lower)
    q = rng.uniform(low, np.minimum(upper, low + 2 * np.pi), (n, robot.nq))
    for joint in robot.joints:
        part = joint.normalized
        if part is not None:  # a normal distribution in all directions, scaled to length 1, is uniform on them
            q[:, part] = rng.normal(size=(n, part.stop - part.start))
    return robot.normalize(q), rng.uniform(-1, 1, (n, robot.nv))


def _limits(joints: Sequence[JointLayout]) -> Array:
    """The lower and the upper limits of the entries of q of joints (2, n), infinite where there is none."""
    ends = [(joint.lower, joint.upper) for joint in joints]
    return np.array([[end for both in ends for end in both[k]] for k in (0, 1)])


def configurations_of(
    robot: RobotModel, frame: str, position: ArrayLike | None, rotation: ArrayLike | None, q0: ArrayLike | None
) -> Array:
    """Configurations (..., nq); see `Robot.inverse_kinematics`."""
    if position is None and rotation is None:
        raise QueryError("expected a position, a rotation, or both, got neither", argument="position",
                         remedy="position=[x, y, z] in m, rotation= a matrix (3, 3)")  # fmt: skip
    given = {}
    if position is not None:
        given["position"] = array("position", position, 3)
    if rotation is not None:
        given["rotation"] = _rotation(rotation)
    batch = batch_shape(**given)
    targets = (rows(given[name], batch) if name in given else None for name in ("position", "rotation"))
    solver = _Solver(robot, frame, *targets)
    q = configuration("q0", robot.neutral if q0 is None else q0, robot.nq, robot.joints)
    if q.ndim != 1:
        raise QueryError(f"expected one configuration, got shape {q.shape}", argument="q0",
                         remedy="each target begins from the solution before it")  # fmt: skip
    out = np.empty((int(np.prod(batch)), robot.nq))
    for i in range(len(out)):
        out[i] = q = solver.solve(i, q)
    return out.reshape(*batch, robot.nq)


class _Solver:
    """Solutions for one frame. positions (n, 3), rotations (n, 9): its targets, or None for any."""

    def __init__(self, robot: RobotModel, frame: str, positions: Array | None, rotations: Array | None) -> None:
        self.robot, self.frame, self.positions, self.rotations = robot, frame, positions, rotations
        self.pose = query_of(robot, f"frame_pose:{frame}").one
        self.jacobian = query_of(robot, f"frame_jacobian_aligned:{frame}").one
        self.rows = slice(0 if positions is not None else 3, 6 if rotations is not None else 3)
        single = [joint for joint in robot.joints if joint.kind == "vector"]
        self.q_entries = np.array([k for joint in single for k in range(joint.q.start, joint.q.stop)], dtype=int)
        self.v_entries = np.array([k for joint in single for k in range(joint.v.start, joint.v.stop)], dtype=int)
        self.lower, self.upper = _limits(single)

    def solve(self, i: int, start: Array) -> Array:
        """A configuration for target i: near the start where one is found from there. Raises QueryError."""
        best, least = start, np.inf
        for k in range(STARTS + 1):
            q = self.descend(i, start if k == 0 else random_state(self.robot, 1, seed=k)[0][0])
            off = float(np.abs(self.off(i, q)).max())
            if off <= NEAR:
                return q
            if off < least:
                best, least = q, off
        e = self.off(i, best)
        metres = float(np.linalg.norm(e[:3])) if self.positions is not None else 0.0
        angle = float(np.linalg.norm(e[-3:])) if self.rotations is not None else 0.0
        raise QueryError(
            f"frame {self.frame!r} stays {metres:.3g} m and {angle:.3g} rad away within the joints' limits",
            where=f"target {i}", argument="position", code="unreachable",
            remedy="a nearer target, a position alone, or another q0",
            distance=metres, angle=angle, closest=best.tolist(),
        )  # fmt: skip

    def off(self, i: int, q: Array) -> Array:
        """e (3,) or (6,) of target i."""
        pose, parts = self.pose(self.robot.model, self.robot.data, q), []
        if self.positions is not None:
            parts.append(self.positions[i] - pose[9:])
        if self.rotations is not None:
            parts.append(_turn(self.rotations[i].reshape(3, 3) @ pose[:9].reshape(3, 3).T))
        return np.concatenate(parts)

    def descend(self, i: int, q: Array) -> Array:
        """The last configuration of Levenberg and Marquardt's method."""
        q, factor = self.within(q), 1.0
        e = self.off(i, q)
        for _ in range(STEPS):
            size = float(e @ e)
            if np.abs(e).max() <= 1e-3 * NEAR or factor > 1e9:
                break
            tried = self.within(integrate(self.robot, q, self.step(q, e, 0.5 * factor * size)))
            after = self.off(i, tried)
            if after @ after < size:
                q, e, factor = tried, after, max(1e-3, factor / 4)
            else:
                factor *= 8
        return q

    def step(self, q: Array, e: Array, damping: float) -> Array:
        """dq: no joint leaves the limit that it is at."""
        j = np.array(self.jacobian(self.robot.model, self.robot.data, q)[self.rows])
        at = q[self.q_entries]
        while True:
            m = j @ j.T + damping * np.eye(len(j))
            dq = j.T @ np.linalg.lstsq(m, e, rcond=None)[0]
            by = dq[self.v_entries]
            leaving = self.v_entries[((at <= self.lower) & (by < 0.0)) | ((at >= self.upper) & (by > 0.0))]
            if not len(leaving):
                return np.asarray(dq / max(1.0, float(np.abs(dq).max(initial=0.0)) / LARGEST))
            j[:, leaving] = 0.0

    def within(self, q: Array) -> Array:
        """q with its joints moved into their limits."""
        out = q.copy()
        out[self.q_entries] = np.clip(out[self.q_entries], self.lower, self.upper)
        return out


def _rotation(value: ArrayLike) -> Array:
    """Rotation matrices as (..., 9)."""
    matrix = np.asarray(value)
    if matrix.ndim < 2 or matrix.shape[-2:] != (3, 3):
        raise QueryError(f"expected shape (..., 3, 3), got {matrix.shape}", argument="rotation",
                         remedy="give a rotation matrix")  # fmt: skip
    flat = array("rotation", matrix.reshape(*matrix.shape[:-2], 9), 9)
    r = flat.reshape(-1, 3, 3)
    wrong = np.abs(r @ r.transpose(0, 2, 1) - np.eye(3)).max(initial=0.0)
    if wrong > SAME or (np.linalg.det(r) < 0.0).any():
        what = f"expected R R^T = 1 and det R = 1, R R^T is {wrong:.3g} off"
        raise QueryError(what, argument="rotation", remedy="give rotation matrices")
    return flat


def _turn(r: Array) -> Array:
    """log(R), the vector of a rotation [rad]; exact for small ones, where an arc cosine is 0."""
    vector = 0.5 * np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
    sine, cosine = float(np.linalg.norm(vector)), 0.5 * (float(np.trace(r)) - 1.0)
    if cosine < -0.9:  # near half a turn the vector has lost its direction
        return np.asarray(pin.log3(r))
    return vector if sine == 0.0 else vector * (np.arctan2(sine, cosine) / sine)
