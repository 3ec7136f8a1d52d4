"""Motions that excite the parameters: Fourier series within the joints' limits, of least condition number.

    q(t) = c + s f(t),  f(t) = sum over k of A_k / (k w) sin(k w t) - B_k / (k w) cos(k w t),  w = 2 pi / duration

The motion is periodic, and with sum A_k = sum k B_k = 0 it starts and ends at rest. The scale s of each joint is the
largest that its limits allow, so that any coefficients give a motion that can be made.

Source: Swevers, Ganseman, Tukel, De Schutter and Van Brussel 1997, "Optimal robot excitation and identification", IEEE
Transactions on Robotics and Automation 13.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from twolink.dynamics import Robot
from twolink.dynamics.arguments import positive
from twolink.errors import QueryError
from twolink.identification.base_parameters import base_parameters, select
from twolink.io.tables import write_table
from twolink.robots.joint_layout import joint_columns

HARMONICS = 5
_SHARE = 0.9  # of the limits that is used
_STARTS = 20  # random coefficients of which the best is improved
_USUAL = (np.pi, 2.0)  # half a range [rad, m] and a speed [rad/s, m/s] for joints without limits


@dataclass(frozen=True)
class ExcitingMotion:
    """A motion t (n,), q (n, nq), v, a (n, nv), and the condition number of the regressor along it.

    condition: its columns scaled to length 1, as `Identification.condition`. first: that of the best random motion.
    """

    robot: Robot
    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    condition: float
    first: float

    def save(self, path: str | Path) -> Path:
        """Write t, q.JOINT, v.JOINT and a.JOINT to a .csv, .parquet or .npz file."""
        columns = {"t": self.t}
        for letter, values in (("q", self.q), ("v", self.v), ("a", self.a)):
            columns |= dict(zip((c for c, _ in joint_columns(self.robot.joints, letter)), values.T, strict=True))
        return write_table(Path(path), columns, {})


def exciting_motion(
    robot: Robot, duration: float, parameters: Sequence[str] | None = None, *, samples: int = 500, steps: int = 10,
    seed: int = 0,
) -> ExcitingMotion:  # fmt: skip
    """A motion within 0.9 of the joints' limits along which the parameters can be told well.

    Parameters
    ----------
    robot : Robot
        A robot whose joints have one degree of freedom each.
    duration : float
        The period, s. Longer periods mean slower motions at the same range.
    parameters : sequence of str, optional
        As in `identify`.
    samples : int
        Samples of the motion.
    steps : int
        Iterations of the optimiser (BFGS with finite differences); 0 takes the best of 20 random motions.
    seed : int
        Seed of the random coefficients.

    Returns
    -------
    ExcitingMotion

    Raises
    ------
    QueryError
        Codes "floating-base" for joints with several degrees of freedom, "nothing-identifiable", "unknown-parameter".

    Notes
    -----
    Collisions are not looked at: check the motion before it is made.
    """
    duration = positive(duration, "duration", QueryError, "give the period in seconds, such as 10")
    driven = [joint for joint in robot.joints if joint.v.stop > joint.v.start]
    odd = next((joint.name for joint in driven if joint.v.stop - joint.v.start > 1), None)
    if odd is not None:
        what = f"joint {odd!r} has several degrees of freedom, and no limits that a motion could keep"
        remedy = "load the robot with a fixed root, or lock the joint"
        raise QueryError(what, argument="robot", remedy=remedy, code="floating-base")
    chosen = select(robot, parameters)
    members = list(base_parameters(robot, chosen).members)
    if not members:
        what = f"no joint torque depends on {', '.join(chosen.names[:6])}"
        raise QueryError(what, argument="parameters", remedy="look for others", code="nothing-identifiable")
    coarse = np.linspace(0, duration, max(8 * HARMONICS, 4 * len(members) // robot.nv), endpoint=False)

    def logarithm(coefficients: np.ndarray) -> float:
        columns = chosen.system(robot, *_states(robot, coefficients, coarse, duration))[0]
        flat = columns[..., members].reshape(-1, len(members))
        return float(np.log(np.linalg.cond(flat / np.maximum(np.linalg.norm(flat, axis=0), 1e-300))))

    starts = np.random.default_rng(seed).standard_normal((_STARTS, 2 * HARMONICS * robot.nv))
    values = [logarithm(x) for x in starts]
    best = int(np.argmin(values))
    from scipy.optimize import minimize  # 0.2 s: only where it is used

    found = minimize(logarithm, starts[best], method="BFGS", options={"maxiter": steps})
    better = found.x if found.fun < values[best] else starts[best]
    t = np.linspace(0, duration, samples)
    q, v, a = _states(robot, better, t, duration)
    condition, first = np.exp([min(found.fun, values[best]), values[best]]).tolist()
    return ExcitingMotion(robot, t, q, v, a, condition, first)


def _states(robot: Robot, coefficients: np.ndarray, t: np.ndarray, duration: float) -> tuple[np.ndarray, ...]:
    """q, v and a at times t."""
    sines, cosines = coefficients.reshape(2, HARMONICS, robot.nv)
    w = 2 * np.pi / duration * np.arange(1, HARMONICS + 1)[:, None]
    sines = sines - sines.mean(axis=0)
    cosines = cosines - w * (w * cosines).sum(axis=0) / (w * w).sum()
    middle, reach, speed = _limits(robot)
    x, v, _ = _series(sines, cosines, w, np.linspace(0, duration, 40 * HARMONICS))
    offset = (x.max(axis=0) + x.min(axis=0)) / 2
    scale = np.minimum(reach / np.abs(x - offset).max(axis=0), speed / np.abs(v).max(axis=0))
    x, v, a = _series(sines, cosines, w, t)
    return _configurations(robot, middle + scale * (x - offset)), scale * v, scale * a


def _series(sines: np.ndarray, cosines: np.ndarray, w: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, ...]:
    """f (n, nv) and its two derivatives at times t (n,), for frequencies w (harmonics, 1)."""
    sine, cosine = np.sin(w * t).T, np.cos(w * t).T
    x = sine @ (sines / w) - cosine @ (cosines / w)
    return x, cosine @ sines + sine @ cosines, cosine @ (cosines * w) - sine @ (sines * w)


def _limits(robot: Robot) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The middle and half of the range that is used of each joint (nv,), and its speed."""
    model = robot.model
    middle, reach = np.zeros(robot.nv), np.full(robot.nv, _USUAL[0])
    for joint in robot.joints:
        if joint.kind == "vector":
            low, high = model.lowerPositionLimit[joint.q.start], model.upperPositionLimit[joint.q.start]
            if high - low < 2 * _USUAL[0]:
                middle[joint.v.start], reach[joint.v.start] = (low + high) / 2, (high - low) / 2
    speed = np.array(model.velocityLimit)
    speed = np.where((speed > 0) & (speed < 1e3), speed, _USUAL[1])
    return middle, _SHARE * reach, _SHARE * speed


def _configurations(robot: Robot, x: np.ndarray) -> np.ndarray:
    """Configurations (n, nq) of angles and lengths (n, nv)."""
    q = np.empty((len(x), robot.nq))
    for joint in robot.joints:
        if joint.v.stop > joint.v.start:
            value = x[:, joint.v]
            q[:, joint.q] = np.hstack([np.cos(value), np.sin(value)]) if joint.kind == "cos-sin" else value
    return q
