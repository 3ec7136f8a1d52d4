"""Configurations as points of a manifold: differences, steps, and random ones."""

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from twolink.dynamics.arguments import array, batch_shape, configuration, rows
from twolink.dynamics.queries import Array
from twolink.errors import QueryError
from twolink.robots.model import RobotModel


def difference(robot: RobotModel, q0: ArrayLike, q1: ArrayLike) -> Array:
    """The tangent vector (..., nv) from q0 to q1; see `Robot.difference`."""
    start, end = (configuration(name, q, robot.nq, robot.joints) for name, q in (("q0", q0), ("q1", q1)))
    batch = batch_shape(q0=start, q1=end)
    return difference_rows(robot, rows(start, batch), rows(end, batch)).reshape(*batch, robot.nv)


def difference_rows(robot: RobotModel, start: Array, end: Array) -> Array:
    """The tangent vectors (n, nv) between rows of configurations (n, nq), which are not checked."""
    out = np.empty((len(start), robot.nv))
    for i, pair in enumerate(zip(start, end, strict=True)):
        out[i] = pin.difference(robot.model, *pair)
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
    out = np.empty((len(start), robot.nq))
    for i, pair in enumerate(zip(start, step, strict=True)):
        out[i] = pin.integrate(robot.model, *pair)
    # Pinocchio divides by the angle, which loses digits where that is small.
    for joint in robot.joints:
        if joint.kind == "planar":
            out[:, joint.q] = _planar_step(start[:, joint.q], step[:, joint.v])
    return robot.normalize(out).reshape(*batch, robot.nq)


def random_state(robot: RobotModel, n: int, seed: int = 0) -> tuple[Array, Array]:
    """n random states; see `Robot.random_state`."""
    if isinstance(n, bool) or not isinstance(n, (int, np.integer)) or n < 0:
        raise QueryError(f"expected a whole number, got {n!r:.60}", argument="n", remedy="such as 10")
    rng = np.random.default_rng(seed)
    limits = robot.model.lowerPositionLimit, robot.model.upperPositionLimit
    lower, upper = np.clip(limits, -1e100, 1e100)  # a range that is not limited overflows
    low = np.where(upper - lower > 2 * np.pi, np.clip(-np.pi, lower, upper - 2 * np.pi), lower)
    q = rng.uniform(low, np.minimum(upper, low + 2 * np.pi), (n, robot.nq))
    for joint in robot.joints:
        if joint.unit is not None:  # a normal distribution in all directions, scaled to length 1, is uniform on them
            q[:, joint.unit] = rng.normal(size=(n, joint.unit.stop - joint.unit.start))
    return robot.normalize(q), rng.uniform(-1, 1, (n, robot.nv))
