"""Motions from rest to rest along a line of configurations, whose speed is a trapezoid in time.

    q(t) = q_0 + s(t) d,   d = q_1 - q_0,   |s''| = A or 0,   0 <= s' <= V

A = min_i a_i / |d_i|, V = min_i v_i / |d_i|: every joint keeps its limits, and one of them is at its own. Where V is
not reached the trapezoid is a triangle. A sample at a jump of s'' has the value after it.
Source: Siciliano et al.: Robotics, 2009, section 4.2.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from twolink.dynamics.arguments import Positive, array, configuration, instance, positive
from twolink.dynamics.robot import Robot
from twolink.errors import QueryError

MOST = 10_000_000  # samples


class PlannedMotion(NamedTuple):
    """A motion in samples: t (n,), s; q (n, nq), v, a (n, nv), in rad, m and s."""

    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray

    def __str__(self) -> str:
        nq, nv = self.q.shape[1], self.v.shape[1]
        return f"a motion of {self.t[-1]:g} s, {len(self.t)} samples of q ({nq}), v and a ({nv})"

    def to_dict(self) -> dict[str, Any]:
        """The samples as lists, for JSON."""
        return {name: values.tolist() for name, values in self._asdict().items()}


def trapezoidal_motion(
    robot: Robot,
    q: ArrayLike,
    to: ArrayLike,
    *,
    acceleration: ArrayLike,
    speed: ArrayLike | None = None,
    samples_per_second: Positive = 100.0,
) -> PlannedMotion:
    """A motion from rest to rest, as quick as its limits allow.

    Parameters
    ----------
    robot : Robot
    q, to : array_like (nq,)
        The configurations at its begin and its end, rad or m. A joint that turns without end takes the shorter way.
    acceleration, speed : float or array_like (nv,)
        Limits of each joint, rad/s^2 or m/s^2, rad/s or m/s. Without a speed, those of the robot's file, of which 0 is
        none.
    samples_per_second : float
        The last sample is at the end.

    Returns
    -------
    PlannedMotion
        For `robot.inverse_dynamics(motion.q, motion.v, motion.a)`: a table of torques.

    Raises
    ------
    QueryError
        The ends are one configuration, or a limit is not positive or not there.

    Examples
    --------
    >>> import twolink as tl
    >>> robot = tl.load_robot("two_link")
    >>> motion = tl.trapezoidal_motion(robot, [0, 0], [1, 0.5], speed=1.0, acceleration=4.0)
    >>> tau = robot.inverse_dynamics(motion.q, motion.v, motion.a)
    """
    instance(robot, Robot, "robot")
    ends = [
        configuration(name, np.ravel(array(name, x, None)), robot.nq, robot.joints)
        for name, x in (("q", q), ("to", to))
    ]
    rate = positive(samples_per_second, "samples_per_second", QueryError, "such as 100")
    way = robot.difference(*ends)
    moved = np.abs(way) > 0.0
    if not moved.any():
        raise QueryError("it is where the motion begins", argument="to", remedy="give another configuration")
    own = np.concatenate([joint.velocity_limit for joint in robot.joints])
    limits = np.where(own > 0.0, own, np.inf) if speed is None else speed
    most_v = float((_limits(robot, "speed", limits)[moved] / np.abs(way[moved])).min())
    most_a = float((_limits(robot, "acceleration", acceleration)[moved] / np.abs(way[moved])).min())
    if speed is None and np.isinf(most_v):
        raise QueryError("the robot's file has none for the joints that move", argument="speed",
                         remedy="give a speed, rad/s or m/s")  # fmt: skip
    with np.errstate(all="ignore"):  # of limits so small that the motion never ends
        rise = np.minimum(np.divide(most_v, most_a), np.power(most_a, -0.5))
        peak = most_a * rise
        whole = np.nan_to_num(rise + np.divide(1.0, peak), nan=np.inf, posinf=np.inf)
    if whole > MOST / rate:
        raise QueryError(f"{whole:.3g} s have more than {MOST:.0e} samples", argument="samples_per_second",
                         remedy="give fewer, or a larger speed and acceleration")  # fmt: skip
    t = np.append(np.arange(0.0, whole * (1.0 - 1e-12), 1.0 / rate), whole)
    left = whole - t
    s = np.where(t < rise, 0.5 * most_a * t**2, np.where(left < rise, 1.0 - 0.5 * most_a * left**2,
                                                         peak * (t - 0.5 * rise)))  # fmt: skip
    rates = most_a * np.minimum(np.minimum(t, left), rise)
    second = most_a * np.select([t < rise, left <= rise + 1e-12 * whole], [1.0, -1.0], 0.0)
    along = robot.integrate(np.broadcast_to(ends[0], (len(t), robot.nq)), s[:, None] * way)
    return PlannedMotion(t, along, rates[:, None] * way, second[:, None] * way)


def _limits(robot: Robot, name: str, given: ArrayLike) -> np.ndarray:
    values = np.ravel(array(name, given, None, finite=name != "speed"))
    if values.size not in (1, robot.nv) or not values.min() > 0.0:
        raise QueryError(f"expected a positive number, or {robot.nv}, got {given!r:.60}", argument=name,
                         remedy="give rad and m a second")  # fmt: skip
    return np.broadcast_to(values, robot.nv)
