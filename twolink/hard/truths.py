"""Closed forms, evaluated in 40 digits and more: what the hard cases are held against."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from twolink.dynamics import Robot
from twolink.hard.case import Track

DIGITS = 60
Closed = Callable[[np.ndarray], np.ndarray]
"""q (n, nq) at times t (n,), NaN where it is not known."""


def of_configuration(closed: Closed) -> Callable[[Robot, Track], np.ndarray]:
    """max |difference(q, q_exact)| at each time."""

    def error(robot: Robot, track: Track) -> np.ndarray:
        exact = closed(track.t)
        out = distance(robot, track.q, exact)
        out[~np.isfinite(track.q).all(axis=1) & ~np.isnan(exact).any(axis=1)] = np.inf
        return out

    return error


def distance(robot: Robot, q: np.ndarray, other: np.ndarray) -> np.ndarray:
    """The distance of configurations (n, nq) in the tangent space, max over its entries (n,), rad or m.

    Angles between unit vectors and quaternions are taken by the arc tangent, which keeps its digits for near ones;
    pin.difference returns 0 for some of them. Computed in the precision of the arguments; positions count along the
    axes they are stored in.
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


def of_energy(scale: float) -> Callable[[Robot, Track], np.ndarray]:
    """|E - E(0)| over a scale [J]: for motions that keep their energy."""

    def error(robot: Robot, track: Track) -> np.ndarray:
        energy = np.sum(robot.energy(track.q, track.v), axis=0)
        return np.asarray(np.abs(energy - energy[0]) / scale)

    return error


def column(values: Closed, *, count: int = 1, factors: Sequence[float] = ()) -> Closed:
    """q whose columns are all one function of time, times factors."""
    scale = np.array(factors or [1.0] * count)
    return lambda t: values(t)[:, None] * scale


def swing(start: float, w0: float) -> Closed:
    """A pendulum let go `start` rad from hanging, w0^2 = m g c / I: 2 asin(k sn(K - w0 t)), k = sin(start / 2)."""

    def angle(t: np.ndarray) -> np.ndarray:
        import mpmath as mp

        with mp.workdps(DIGITS):
            k = mp.sin(mp.mpf(start) / 2)
            quarter = mp.ellipk(k * k)
            args = [mp.fmod(quarter - mp.mpf(w0) * mp.mpf(float(x)), 4 * quarter) for x in t]
            return np.array([float(2 * mp.asin(k * mp.ellipfun("sn", u, m=k * k))) for u in args])

    return angle


def toppling(start: float, w0: float) -> Closed:
    """A pendulum let go at rest `start` [rad] beside upright; the angle from upright, exact for the smallest starts.

    phi = 2 acos(cd-like form): with k = cos(start / 2), the angle from hanging is 2 asin(k sn(K - w0 t)), and from
    upright pi minus that, counted on through the bottom.
    """

    def angle(t: np.ndarray) -> np.ndarray:
        import mpmath as mp

        with mp.workdps(DIGITS):
            k = mp.cos(mp.mpf(start) / 2)
            quarter = mp.ellipk(k * k)
            out = []
            for x in t:
                u = mp.fmod(quarter - mp.mpf(w0) * mp.mpf(float(x)), 4 * quarter)
                out.append(float(mp.pi - 2 * mp.asin(k * mp.ellipfun("sn", u, m=k * k))))
            return np.array(out)

    return angle


def whirl(rate: float, w0: float) -> Closed:
    """A pendulum that starts upright at `rate` [rad/s] and goes round for ever; its angle from upright.

    With half the angle from hanging, sin = sn(u, m): phi'^2 = rate^2 + 4 w0^2 cos^2(phi / 2) = c^2 (1 - m sin^2), where
    c^2 = rate^2 + 4 w0^2 and m = 4 w0^2 / c^2; the angle from hanging is 2 am(c t / 2 - K).
    """

    def angle(t: np.ndarray) -> np.ndarray:
        import mpmath as mp

        with mp.workdps(DIGITS):
            c = mp.sqrt(mp.mpf(rate) ** 2 + 4 * mp.mpf(w0) ** 2)
            m = 4 * mp.mpf(w0) ** 2 / c**2
            quarter = mp.ellipk(m)
            out = []
            for x in t:
                u = c * mp.mpf(float(x)) / 2 - quarter
                turns = mp.floor((u + quarter) / (2 * quarter))
                rest = u - 2 * quarter * turns
                out.append(float(2 * (mp.asin(mp.ellipfun("sn", rest, m=m)) + mp.pi * turns) + mp.pi))
            return np.array(out)

    return angle


def symmetric_top(equal: float, axial: float, across: float, spin: float) -> Closed:
    """A free body with moments (equal, equal, axial), turning at (across, 0, spin) [rad/s] in its own axes at t = 0.

    R(t) = exp(l t |L| / equal) exp(z t (1 - axial / equal) spin), l the direction of the angular momentum L, which is
    (equal across, 0, axial spin) for R(0) = 1. Quaternions (x, y, z, w) behind the position, which stays.
    """

    def pose(t: np.ndarray) -> np.ndarray:
        import mpmath as mp

        with mp.workdps(DIGITS):
            momentum = mp.matrix([mp.mpf(equal) * mp.mpf(across), 0, mp.mpf(axial) * mp.mpf(spin)])
            size = mp.norm(momentum)
            out = []
            for x in t:
                now = mp.mpf(float(x))
                half, turn = size / equal * now / 2, (1 - mp.mpf(axial) / equal) * spin * now / 2
                first = [momentum[i] / size * mp.sin(half) for i in range(3)] + [mp.cos(half)]
                second = [mp.mpf(0), mp.mpf(0), mp.sin(turn), mp.cos(turn)]
                out.append([0.0, 0.0, 0.0, *(float(c) for c in _product(first, second))])
            return np.array(out)

    return pose


def _product(a: Sequence[Any], b: Sequence[Any]) -> list[Any]:
    """The product of quaternions (x, y, z, w)."""
    return [
        a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1],
        a[3] * b[1] - a[0] * b[2] + a[1] * b[3] + a[2] * b[0],
        a[3] * b[2] + a[0] * b[1] - a[1] * b[0] + a[2] * b[3],
        a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2],
    ]


def oscillation(start: float, w: float) -> Closed:
    """start cos(w t), with w t reduced in many digits."""

    def value(t: np.ndarray) -> np.ndarray:
        import mpmath as mp

        with mp.workdps(DIGITS):
            return np.array([float(mp.mpf(start) * mp.cos(mp.mpf(w) * mp.mpf(float(x)))) for x in t])

    return value


def at_known_times(t: Sequence[float], q: Sequence[Sequence[float]]) -> Closed:
    """Tabled values, NaN between."""
    known, values = np.asarray(t, float), np.asarray(q, float)

    def closed(times: np.ndarray) -> np.ndarray:
        out = np.full((len(times), values.shape[1]), np.nan)
        at = np.clip(np.searchsorted(known, times - 1e-9), 0, len(known) - 1)
        hit = np.abs(known[at] - times) < 1e-9
        out[hit] = values[at[hit]]
        return out

    return closed
