"""Errors of motions, and the exact motions they are taken from: closed forms in 60 digits, stored references, and
Taylor series in extended precision, checked by a second one.
"""

import functools
import json
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import mpmath as mp
import numpy as np

from twolink.dynamics import Robot
from twolink.hard.case import ErrorFunction, StateHistory
from twolink.integrate.motion.scene_equations import equations_of
from twolink.integrate.solution import Solution
from twolink.integrate.solvers import taylor
from twolink.scenes import Scene

DIGITS = 60
REFERENCES = Path(__file__).parent / "references.json"
ExactMotion = Callable[[np.ndarray], np.ndarray]
"""q (n, nq) at times t (n,), NaN where it is not available."""
FINE, COARSE, QUAD = 1e-19, 1e-17, 1e-22  # tolerances of the reference and of its check


def configuration_error(exact: ExactMotion) -> ErrorFunction:
    """max |difference(q, q_exact)| at each time, rad or m."""
    return lambda robot, track: distance(robot, track.q, exact(track.t))


def energy_error(scale: float) -> ErrorFunction:
    """|E - E(0)| over a scale [J], for motions that keep their energy."""

    def error(robot: Robot, track: StateHistory) -> np.ndarray:
        energy = np.sum(robot.energy(track.q, track.v), axis=0)
        return np.asarray(np.abs(energy - energy[0]) / scale)

    return error


def distance(robot: Robot, q: np.ndarray, other: np.ndarray) -> np.ndarray:
    """The distance of configurations (n, nq) in the tangent space, max over its entries (n,), rad or m.

    Angles between unit vectors and quaternions are taken by the arc tangent, which keeps its digits for near ones;
    pin.difference returns 0 for some of them. Computed in the precision of the arguments. Positions are compared along
    the axes they are stored in. Independent of the distance behind the error bars, which it judges.
    """
    parts = [np.zeros(len(q), q.dtype)]
    for joint in robot.joints:
        a, b = q[:, joint.q].T, other[:, joint.q].T
        flat = {"vector": len(a), "planar": 2, "free-flyer": 3}.get(joint.kind, 0)
        parts += list(np.abs(a[:flat] - b[:flat]))
        a, b = a[flat:], b[flat:]
        if len(a) == 2:
            parts.append(np.abs(np.arctan2(a[0] * b[1] - a[1] * b[0], a[0] * b[0] + a[1] * b[1])))
        elif len(a) == 4:
            parts.append(_rotation_between(a, b))
    return np.asarray(np.max(parts, axis=0)).astype(float)


def _rotation_between(p: np.ndarray, r: np.ndarray) -> np.ndarray:
    """The largest component of the rotation vector between unit quaternions (4, n), (x, y, z, w)."""
    vector = p[3] * r[:3] - r[3] * p[:3] - np.cross(p[:3].T, r[:3].T).T
    length = np.sqrt((vector * vector).sum(axis=0))
    angle = 2 * np.arctan2(length, np.abs((p * r).sum(axis=0)))
    return np.asarray(np.abs(vector).max(axis=0) / np.where(length > 0, length, 1.0) * angle)


@functools.cache
def _references() -> Any:
    return json.loads(REFERENCES.read_text(encoding="utf-8"))


def stored(name: str) -> ErrorFunction:
    """The error against a reference of references.json, which `high_precision` made."""
    reference = _references()[name]
    return configuration_error(at_table_times(reference["t"], reference["q"]))


def at_table_times(times: Sequence[float], q: Sequence[Sequence[Any]]) -> ExactMotion:
    """Tabulated values (k, nq), NaN at all other times."""
    table, values = np.asarray(times, float), np.array(q, float)

    def exact(t: np.ndarray) -> np.ndarray:
        row = np.clip(np.searchsorted(table, t - 1e-9), 0, len(table) - 1)
        return np.where((np.abs(table[row] - t) < 1e-9)[:, None], values[row], np.nan)

    return exact


def in_digits(value: Callable[[Any], Sequence[Any]]) -> ExactMotion:
    """A closed form q(t) that is evaluated with DIGITS digits; its argument is an mpmath number."""

    def exact(t: np.ndarray) -> np.ndarray:
        with mp.workdps(DIGITS):
            return np.array([[float(x) for x in value(mp.mpf(float(s)))] for s in t])

    return exact


def swing(start: float, w0: float, offset: float = 0.0, factors: Sequence[float] = (1.0,)) -> ExactMotion:
    """A pendulum released at rest `start` [rad] from hanging, w0^2 = m g c / I: theta = 2 asin(k sn(K - w0 t, k)).

    k = sin(start / 2). The columns of q are offset + theta times the factors.
    """

    def angle(t: Any) -> Sequence[Any]:
        theta = _swing_angle(mp.sin(mp.mpf(start) / 2), w0, t)
        return [offset + theta * factor for factor in factors]

    return in_digits(angle)


def toppling(start: float, w0: float) -> ExactMotion:
    """A pendulum released at rest `start` [rad] beside upright: its angle from upright, exact for the smallest starts.

    The angle from hanging is 2 asin(k sn(K - w0 t, k)) with k = cos(start / 2); pi minus it is the angle from upright.
    """

    return in_digits(lambda t: [mp.pi - _swing_angle(mp.cos(mp.mpf(start) / 2), w0, t)])


def _swing_angle(k: Any, w0: float, t: Any) -> Any:
    """2 asin(k sn(K - w0 t, k)), the angle [rad] of a pendulum from hanging."""
    quarter = mp.ellipk(k * k)
    return 2 * mp.asin(k * mp.ellipfun("sn", mp.fmod(quarter - mp.mpf(w0) * t, 4 * quarter), m=k * k))


def whirl(rate: float, w0: float, factors: Sequence[float]) -> ExactMotion:
    """A pendulum that starts upright at `rate` [rad/s] and keeps turning; pi/2 minus its angle phi from upright.

    phi'^2 = rate^2 + 4 w0^2 cos^2(phi / 2) = c^2 (1 - m sin^2), with c^2 = rate^2 + 4 w0^2 and m = 4 w0^2 / c^2; the
    angle from hanging is 2 am(c t / 2 - K). The columns of q are this angle times the factors.
    """

    def angle(t: Any) -> Sequence[Any]:
        c = mp.sqrt(mp.mpf(rate) ** 2 + 4 * mp.mpf(w0) ** 2)
        m = 4 * mp.mpf(w0) ** 2 / c**2
        quarter = mp.ellipk(m)
        u = c * t / 2 - quarter
        turns = mp.floor((u + quarter) / (2 * quarter))
        phi = 2 * (mp.asin(mp.ellipfun("sn", u - 2 * quarter * turns, m=m)) + mp.pi * turns) + mp.pi
        return [(mp.mpf(math.pi / 2) - phi) * factor for factor in factors]

    return in_digits(angle)


def symmetric_top(equal: float, axial: float, across: float, spin: float) -> ExactMotion:
    """A free body with moments (equal, equal, axial), turning at (across, 0, spin) [rad/s] in its own axes at t = 0.

    R(t) = exp(l t |L| / equal) exp(z t (1 - axial / equal) spin), l the direction of the angular momentum L, which is
    (equal across, 0, axial spin) for R(0) = 1. The position stays 0; quaternions (x, y, z, w).
    """

    def pose(t: Any) -> Sequence[Any]:
        momentum = mp.matrix([mp.mpf(equal) * mp.mpf(across), 0, mp.mpf(axial) * mp.mpf(spin)])
        size = mp.norm(momentum)
        half, turn = size / equal * t / 2, (1 - mp.mpf(axial) / equal) * spin * t / 2
        a = [momentum[i] / size * mp.sin(half) for i in range(3)]
        c, s, scalar = mp.cos(turn), mp.sin(turn), mp.cos(half)
        # The product of the quaternions (a, scalar) and (0, 0, s, c).
        return [0, 0, 0, a[0] * c + a[1] * s, a[1] * c - a[0] * s, scalar * s + a[2] * c, scalar * c - a[2] * s]

    return in_digits(pose)


def oscillation(start: float, w: float, factors: Sequence[float] = (1.0,)) -> ExactMotion:
    """q = start cos(w t) times the factors."""
    return in_digits(lambda t: [mp.mpf(start) * mp.cos(mp.mpf(w) * t) * factor for factor in factors])


def extended_reference(scene: Scene, times: np.ndarray, *, quad: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Solve a smooth scene in numbers of 31 digits.

    Parameters
    ----------
    scene : Scene
        A scene without events.
    times : (n,) array
        Samples, s, from 0.
    quad : bool
        Check by 47 digits; else by another tolerance, and with it other orders and steps.

    Returns
    -------
    q : (n, nq) array of numpy.longdouble
        Configurations.
    error : (n,) array
        The reference's own error, rad or m: the distance from its check, the largest up to each sample.
    """
    equations, nq = equations_of(scene), scene.robot.nq
    best = _digits(taylor.solve(equations, times, FINE, precision="extended"))
    if quad:
        second = _digits(taylor.solve(equations, times, QUAD, precision="quad"))
    else:
        second = _digits(taylor.solve(equations, times, COARSE, precision="extended"))
    return best[:, :nq], np.maximum.accumulate(distance(scene.robot, best[:, :nq], second[:, :nq]))


def _digits(solution: Solution) -> np.ndarray:
    return np.asarray(solution.precise[..., 0].astype(np.longdouble) + solution.precise[..., 1])
