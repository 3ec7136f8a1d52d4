"""Motions that excite the parameters: Fourier series within the joints' limits, of least condition number.

    q(t) = c + s f(t),  f(t) = sum over k of A_k / (k w) sin(k w t) - B_k / (k w) cos(k w t),  w = 2 pi / duration

The motion is periodic, and with sum A_k = sum k B_k = 0 it starts and ends at rest. The scale s of each joint is the
largest that its limits allow, so that any coefficients give a motion that can be made; it is made smaller where torques
are beyond theirs, and of the joints between links that touch. Ramps of least jerk (Flash and Hogan 1985) lead from the
middle to it and back.

Source: Swevers, Ganseman, Tukel, De Schutter and Van Brussel 1997, "Optimal robot excitation and identification", IEEE
Transactions on Robotics and Automation 13.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtri

from twolink.dynamics import Robot
from twolink.dynamics.arguments import positive, whole
from twolink.errors import QueryError
from twolink.io.files import path_to_write
from twolink.io.tables import write_table
from twolink.io.text import Table
from twolink.parts.identification.base_parameters import Selection, base_parameters, select
from twolink.parts.identification.reach import Reach
from twolink.robots.joint_layout import joint_columns

HARMONICS = 5
_SHARE = 0.9  # of the limits that is used
_LESS, _LEAST = 0.8, 0.08  # of a joint's range, until torques and collisions allow it
_WHOLE = np.ones(1)
_TRIED = 5  # random motions beside the one that was improved
_STARTS = 20  # random coefficients of which the best is improved
_USUAL = (np.pi, 2.0)  # the most of half a range [rad, m]; a speed [rad/s, m/s] for joints without limits


@dataclass(frozen=True)
class ExcitingMotion:
    """A motion t (n,), q (n, nq), v, a (n, nv), and the condition number of the regressor along it.

    condition: its columns scaled to length 1, as `Identification.condition`. first: that of the best random motion.
    share: of the range that its limits allow, which torques and collisions left, on average of the joints. limit: what
    a larger share meets, "" where all is used. chosen: the parameters.
    """

    robot: Robot
    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    condition: float
    first: float
    share: float
    limit: str
    chosen: Selection

    def intervals(self, noise: ArrayLike | None = None, confidence: float = 0.95) -> Table:
        """The half-widths that `identify` will give, by combination, for white noise of the torques.

        noise: standard deviations (nv,) or one, N m or N; by default 1 % of each joint's largest torque.
        """
        columns, known = self.chosen.system(self.robot, self.q, self.v, self.a)
        base = base_parameters(self.robot, self.chosen)
        largest = np.abs(columns @ self.chosen.nominal + known).max(axis=0)
        deviation = 0.01 * np.maximum(largest, 1e-3 * largest.max()) if noise is None else np.asarray(noise, float)
        rows = columns[..., list(base.members)] / np.broadcast_to(deviation, (self.robot.nv,))[:, None]
        lengths = np.linalg.norm(rows, axis=(0, 1))
        triangle = np.linalg.qr((rows / lengths).reshape(-1, len(lengths)), mode="r")
        spread = np.linalg.norm(np.linalg.inv(triangle), axis=1) / lengths
        half = (ndtri((1 + confidence) / 2) * spread).tolist()
        values = (base.matrix @ self.chosen.nominal).tolist()
        return Table(("parameter", "value", "+-"), tuple(zip(base.combinations, values, half, strict=True)))

    def save(self, path: str | Path) -> Path:
        """Write t, q.JOINT, v.JOINT and a.JOINT to a .csv, .parquet or .npz file."""
        columns = {"t": self.t}
        for letter, values in (("q", self.q), ("v", self.v), ("a", self.a)):
            columns |= dict(zip((c for c, _ in joint_columns(self.robot.joints, letter)), values.T, strict=True))
        return write_table(path_to_write(path), columns, {})


def exciting_motion(
    robot: Robot, duration: float, parameters: Sequence[str] | None = None, *, samples: int = 500, steps: int = 10,
    seed: int = 0, acceleration: float | None = None, ramps: bool = False,
) -> ExcitingMotion:  # fmt: skip
    """A motion within 0.9 of the joints' limits, and without collision, along which parameters can be told well.

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
    acceleration : float, optional
        Limit of all joints, rad/s^2 or m/s^2; a URDF has none.
    ramps : bool
        Whether the motion starts and ends at rest in the middle of the joints' ranges, longer by both ramps.

    Returns
    -------
    ExcitingMotion

    Raises
    ------
    QueryError
        Codes "floating-base" for joints with several degrees of freedom, "nothing-identifiable", "unknown-parameter",
        "no-motion" where torques or collisions leave none.

    Notes
    -----
    Collisions are those of the pairs "self" of contacts, by the shapes of the URDF's <collision>: not of neighbours,
    nor of links that overlap in the neutral configuration or that an SRDF calls apart. The surroundings are not known.
    Torques are those of the robot as its URDF says, without friction.
    """
    duration = positive(duration, "duration", QueryError, "give the period in seconds, such as 10")
    driven = [joint for joint in robot.joints if joint.v.stop > joint.v.start]
    odd = next((joint.name for joint in driven if joint.v.stop - joint.v.start > 1), None)
    if odd is not None:
        raise QueryError(f"joint {odd!r} has several degrees of freedom, and no limits that a motion could keep",
                         argument="robot", code="floating-base",
                         remedy="load the robot with a fixed root, or lock the joint")  # fmt: skip
    chosen = select(robot, parameters)
    members = list(base_parameters(robot, chosen).members)
    if not members:
        raise QueryError(f"no joint torque depends on {', '.join(chosen.names[:6])}", argument="parameters",
                         code="nothing-identifiable", remedy="look for others")  # fmt: skip
    coarse = np.linspace(0, duration, max(8 * HARMONICS, 4 * len(members) // robot.nv), endpoint=False)
    most = np.inf if acceleration is None else positive(acceleration, "acceleration", QueryError, "such as 5")

    middle, _, speed = _limits(robot)

    def motion(coefficients: np.ndarray, at: np.ndarray, share: np.ndarray) -> list[np.ndarray]:
        x, v, a = _states(robot, coefficients, at, duration, most)
        return [middle + share * (x - middle), share * v, share * a]

    def logarithm(coefficients: np.ndarray, share: np.ndarray = _WHOLE) -> float:
        x, v, a = motion(coefficients, coarse, share)
        columns = chosen.system(robot, _configurations(robot, x), v, a)[0]
        flat = columns[..., members].reshape(-1, len(members))
        return float(np.log(np.linalg.cond(flat / np.maximum(np.linalg.norm(flat, axis=0), 1e-300))))

    starts = np.random.default_rng(whole(seed, "seed", QueryError)).standard_normal((_STARTS, 2 * HARMONICS * robot.nv))
    values = np.array([logarithm(x) for x in starts])
    order = np.argsort(values)
    from scipy.optimize import minimize  # 0.2 s: only where it is used

    found = minimize(logarithm, starts[order[0]], method="BFGS", options={"maxiter": steps})
    candidates = [*([found.x] if found.fun < values[order[0]] else []), *starts[order[:_TRIED]]]
    t, beyond, what, clear = np.linspace(0, duration, samples), Reach(robot), "", list[ExcitingMotion]()
    for coefficients in candidates:
        shares, limit = np.ones(robot.nv), ""
        while shares.min() > _LEAST:
            parts = [t, *motion(coefficients, t, shares)]
            moved = _with_ramps(parts, middle, speed, most) if ramps else parts
            what, to_blame = beyond(q := _configurations(robot, moved[1]), moved[2], moved[3])
            if not what:
                condition, first = np.exp([logarithm(coefficients, shares), values[order[0]]]).tolist()
                clear.append(ExcitingMotion(robot, moved[0], q, moved[2], moved[3], condition, first,
                                            float(shares.mean()), limit, chosen))  # fmt: skip
                break
            shares, limit = np.where(to_blame, _LESS * shares, shares), what
    if not clear:
        raise QueryError(f"even {_LEAST:.0%} of the range is too much: {what}", argument="robot", code="no-motion",
                         remedy="narrow the joints' limits about a place that is clear")  # fmt: skip
    return min(clear, key=lambda found: found.condition)


def _with_ramps(parts: list[np.ndarray], middle: np.ndarray, speed: np.ndarray, most: float) -> list[np.ndarray]:
    """The motion between ramps s(u) = 10 u^3 - 15 u^4 + 6 u^5 from the middle to its start, and back."""
    t, x, v, a = parts
    step, way = t[1] - t[0], x[0] - middle
    shortest = max(1.0, float(np.max(1.875 * np.abs(way) / speed)), float(np.sqrt(5.774 * np.abs(way).max() / most)))
    count = int(np.ceil(shortest / step))
    u = np.arange(count)[:, None] / count
    rates = [np.polynomial.Polynomial([0, 0, 0, 10, -15, 6]).deriv(k)(u) / (count * step) ** k for k in range(3)]
    up = [middle * (k == 0) + rate * way for k, rate in enumerate(rates)]
    down = [(-1) ** k * part[::-1] for k, part in enumerate(up)]
    joined = [np.concatenate(parts) for parts in zip(up, (x, v, a), down, strict=True)]
    return [step * np.arange(len(joined[0])), *joined]


def _states(
    robot: Robot, coefficients: np.ndarray, t: np.ndarray, duration: float, most: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Angles or lengths (n, nv), v and a at times t."""
    sines, cosines = coefficients.reshape(2, HARMONICS, robot.nv)
    w = 2 * np.pi / duration * np.arange(1, HARMONICS + 1)[:, None]
    sines = sines - sines.mean(axis=0)
    cosines = cosines - w * (w * cosines).sum(axis=0) / (w * w).sum()
    middle, reach, speed = _limits(robot)
    x, v, a = _series(sines, cosines, w, np.linspace(0, duration, 40 * HARMONICS))
    offset = (x.max(axis=0) + x.min(axis=0)) / 2
    ranges = ((reach, x - offset), (speed, v), (_SHARE * most, a))
    scale = np.min([limit / np.abs(values).max(axis=0) for limit, values in ranges], axis=0)
    x, v, a = _series(sines, cosines, w, t)
    return middle + scale * (x - offset), scale * v, scale * a


def _series(sines: np.ndarray, cosines: np.ndarray, w: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, ...]:
    """f (n, nv) and its two derivatives at times t (n,), for frequencies w (harmonics, 1)."""
    sine, cosine = np.sin(w * t).T, np.cos(w * t).T
    x = sine @ (sines / w) - cosine @ (cosines / w)
    return x, cosine @ sines + sine @ cosines, cosine @ (cosines * w) - sine @ (sines * w)


def _limits(robot: Robot) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The middle and half of the range that is used of each joint (nv,), and its speed.

    A range wider than the usual one is used about 0, or as near to 0 as its limits allow.
    """
    model = robot.model
    middle, reach = np.zeros(robot.nv), np.full(robot.nv, _USUAL[0])
    for joint in robot.joints:
        if joint.kind == "vector":
            low, high = joint.lower[0], joint.upper[0]
            half = min((high - low) / 2, _USUAL[0])
            middle[joint.v.start], reach[joint.v.start] = min(max(0.0, low + half), high - half), half
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
