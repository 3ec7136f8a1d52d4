"""Measurements of a motion: checked arrays and data files; velocities and accelerations where they are missing.

Around each sample a polynomial of degree 4 is fitted by least squares to the samples of a window; its value and
derivatives at the sample are q, v and a. For even times this is Savitzky and Golay's filter. Samples nearer to an end
than half a window are left out. Positions are differences in the tangent space, so that quaternions and angles that
pass pi are treated as they should be.

Source: Savitzky and Golay 1964, "Smoothing and differentiation of data by simplified least squares procedures",
Analytical Chemistry 36."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from math import factorial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from twolink.dynamics import Robot
from twolink.dynamics.arguments import array, configuration
from twolink.dynamics.configurations import difference_rows
from twolink.errors import QueryError
from twolink.io.tables import read_table
from twolink.robots.joint_layout import read_columns, turns

DEGREE = 4
SMALLEST = 3  # half a window: 7 samples for the 5 coefficients of the polynomial
_EXCESS = 1.1  # residuals of a window that is not too wide exceed those of the narrowest by less, and by chance


@dataclass(frozen=True)
class Smoothed:
    """q (m, nq), v, a (m, nv) at the samples with `half_window` others on each side in the window."""

    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    half_window: int


def smooth(robot: Robot, t: np.ndarray, q: np.ndarray, half: int | None = None) -> Smoothed:
    """Filtered positions with their velocities and accelerations.

    Parameters
    ----------
    robot : Robot
        The robot.
    t : ndarray, (n,)
        Increasing times, s. They need not be even.
    q : ndarray, (n, nq)
        Configurations.
    half : int, optional
        Samples on each side of the window. By default the widest whose residuals are the noise
        that the narrowest shows.

    Raises
    ------
    QueryError
        Code "too-few-samples".
    """
    widest = (len(t) - 1) // 2 - 1
    if widest < (half or SMALLEST):
        need = 2 * (half or SMALLEST) + 3
        what = f"{len(t)} samples are too few to differentiate, expected at least {need}"
        raise QueryError(what, argument="t", remedy="give more samples, or v and a", code="too-few-samples")
    if half is not None:
        return _fit(robot, t, q, half)[0]
    found, noise = _fit(robot, t, q, SMALLEST)
    limit = noise * (_EXCESS + 6 / np.sqrt(len(t)))
    for wider in np.unique(np.geomspace(SMALLEST, max(SMALLEST, widest // 4), 24).astype(int))[1:]:
        smoothed, residual = _fit(robot, t, q, int(wider))
        if np.any(residual > limit):
            break
        found = smoothed
    return found


def rate(t: np.ndarray, x: np.ndarray, half: int = SMALLEST) -> np.ndarray:
    """The time derivative (n - 2 half, k) of samples (n, k), by the same polynomials."""
    return np.asarray(_weigh(_weights(t, half)[:, 1], np.moveaxis(_windows(x, half), -1, 1)))


def _fit(robot: Robot, t: np.ndarray, q: np.ndarray, half: int) -> tuple[Smoothed, np.ndarray]:
    """The polynomials' values, and the root mean square (nv,) of what they leave of the positions, as noise."""
    inner = q[half : len(q) - half]
    near = np.stack([difference_rows(robot, inner, _shifted(q, half, k)) for k in range(-half, half + 1)], axis=1)
    weights = _weights(t, half)
    value, v, a = (_weigh(weights[:, k], near) for k in range(3))
    free = 1.0 - weights[:, 0, half].mean()  # the variance of a residual, in that of the noise
    residual = np.sqrt(np.mean(value**2, axis=0) / free)
    return Smoothed(np.asarray(robot.integrate(inner, value)), v, a, half), residual


def _weights(t: np.ndarray, half: int) -> np.ndarray:
    """(n - 2 half or 1, 3, window): what takes samples to value, first and second derivative at the middle."""
    around = np.lib.stride_tricks.sliding_window_view(t, 2 * half + 1) - t[half : len(t) - half, None]
    step = (t[-1] - t[0]) / (len(t) - 1)
    if np.abs(np.diff(t) - step).max() < 1e-6 * step:
        around = step * np.arange(-half, half + 1.0)[None]
    reach = around[:, -1].max()
    powers = (around / reach)[..., None] ** np.arange(DEGREE + 1)
    inverse = np.linalg.pinv(powers)[:, :3]
    return np.asarray(inverse * np.array([factorial(k) / reach**k for k in range(3)])[:, None])


def _weigh(weights: np.ndarray, near: np.ndarray) -> np.ndarray:
    return np.asarray((weights[..., None] * near).sum(axis=1))


def _windows(x: np.ndarray, half: int) -> np.ndarray:
    return np.lib.stride_tricks.sliding_window_view(x, 2 * half + 1, axis=0)


def _shifted(q: np.ndarray, half: int, k: int) -> np.ndarray:
    return q[half + k : len(q) - half + k]


_NARROWER = 0.7  # of the widest window that the noise allows: errors of a fall with its fourth power
LIKELY = {180 / np.pi: "is v in degrees?", np.pi / 180: "is q in degrees?", 1e3: "is t in milliseconds?"}


@dataclass(frozen=True)
class Measurements:
    """Samples t (n,), q (n, nq), v, a, tau (n, nv).

    half_window: samples on each side of the filter's window; 0 where v and a were measured.
    coarse: the same samples with velocities and accelerations by a wider window, for the filter's error.
    """

    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    tau: np.ndarray
    half_window: int = 0
    coarse: Measurements | None = None

    def states(self, size: int = 2_000) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """(q, v, a) in parts of at most `size` samples."""
        for i in range(0, len(self.t), size):
            yield self.q[i : i + size], self.v[i : i + size], self.a[i : i + size]


def measurements(
    robot: Robot, t: ArrayLike, q: ArrayLike, v: ArrayLike | None, tau: ArrayLike, a: ArrayLike | None, half: int | None
) -> Measurements:
    """Checked samples. Without a, v is differentiated; without v, q is filtered and differentiated twice.

    Raises
    ------
    QueryError
        For wrong shapes or values that are not finite; codes "times", "too-few-samples", "constant-data" and "units".
    """
    times = checked_times(t)
    if half is not None and (not isinstance(half, int | np.integer) or half < SMALLEST):
        what, remedy = (
            f"expected a whole number from {SMALLEST} on, got {half!r}",
            "leave it out to choose by the noise",
        )
        raise QueryError(what, argument="half_window", remedy=remedy)
    given = {"q": configuration("q", q, robot.nq, robot.joints), "tau": array("tau", tau, robot.nv)}
    given |= {name: array(name, x, robot.nv) for name, x in (("v", v), ("a", a)) if x is not None}
    for name, x in given.items():
        if x.shape != (len(times), x.shape[-1]):
            what = f"expected shape ({len(times)}, {x.shape[-1]}), got {x.shape}"
            raise QueryError(what, argument=name, remedy="give one row for each of the times t")
    if v is None and a is not None:
        raise QueryError("accelerations came without velocities", argument="v", remedy="give v, or leave a out too")
    if np.ptp(given["q"], axis=0).max() == 0.0 and not any(np.ptp(given[k]) for k in ("v", "a") if k in given):
        what, remedy = "the robot never moves: all samples are the same", "measure motions, or several poses"
        raise QueryError(what, argument="q", remedy=remedy, code="constant-data")
    if a is not None:
        return Measurements(times, given["q"], given["v"], given["a"], given["tau"])
    if v is not None:
        return _with_rate_of_v(robot, times, given, half or SMALLEST)
    wide = _filtered(robot, times, given, None if half is None else max(half + 1, round(half / _NARROWER)))
    chosen = _filtered(robot, times, given, half or max(SMALLEST, round(_NARROWER * wide.half_window)))
    if wide.half_window == chosen.half_window:
        wide = _filtered(robot, times, given, wide.half_window + 1)
    return replace(_cut(chosen, wide.half_window - chosen.half_window), coarse=wide)


def checked_times(t: ArrayLike) -> np.ndarray:
    """Increasing times (n,), s. Raises QueryError, codes "times" and "too-few-samples"."""
    times = array("t", t, np.shape(t)[-1] if np.ndim(t) else 1)
    if times.ndim != 1:
        raise QueryError(
            f"expected shape (n,), got {times.shape}", argument="t", remedy="give one time for each sample"
        )
    if not len(times):
        raise QueryError("there are no samples", argument="t", remedy="give some", code="too-few-samples")
    steps = np.diff(times)
    if np.any(steps <= 0):
        row = int(np.argmax(steps <= 0)) + 1
        what = f"t[{row}] = {times[row]:.9g} s does not come after t[{row - 1}] = {times[row - 1]:.9g} s"
        raise QueryError(what, argument="t", remedy="sort the samples by time and drop repeated ones", code="times")
    if len(steps) and not 1e-12 < steps.min() <= steps.max() < 1e12:
        what = f"steps are between {steps.min():.3g} s and {steps.max():.3g} s"
        raise QueryError(what, argument="t", remedy="give seconds", code="times")
    return times


def _with_rate_of_v(robot: Robot, t: np.ndarray, given: dict[str, np.ndarray], half: int) -> Measurements:
    """Accelerations by differentiating measured velocities."""
    wide = max(half + 1, round(half / _NARROWER))
    if len(t) < 2 * wide + 1:
        what = f"{len(t)} samples are too few to differentiate v, expected at least {2 * wide + 1}"
        raise QueryError(what, argument="t", remedy="give more samples, or a", code="too-few-samples")
    check_units(robot, t, given["q"], given["v"])
    part, inner = slice(wide, len(t) - wide), slice(wide - half, len(t) - wide - half)
    q, v, tau = (given[name][part] for name in ("q", "v", "tau"))
    m = Measurements(t[part], q, v, rate(t, given["v"], half)[inner], tau, half)
    return replace(m, coarse=replace(m, a=rate(t, given["v"], wide)))


def check_units(robot: Robot, t: np.ndarray, q: np.ndarray, v: np.ndarray) -> None:
    """Refuse velocities that are a multiple of the rate of the positions. Raises QueryError (code "units")."""
    moved = robot.difference(q[:-1], q[1:])
    expected = (v[1:] + v[:-1]) / 2 * np.diff(t)[:, None]
    for joint in robot.joints:
        x, y = moved[:, joint.v].ravel(), expected[:, joint.v].ravel()
        alike = abs(x @ y) / max(np.linalg.norm(x) * np.linalg.norm(y), 1e-300)
        ratio = float(x @ y / max(x @ x, 1e-300))
        if alike > 0.9 and not 1 / 3 < abs(ratio) < 3:
            what = f"v of joint {joint.name!r} is {ratio:.4g} times the rate of its q"
            raise wrong_units(what, "v", ratio)


def wrong_units(what: str, argument: str, ratio: float, guesses: Mapping[float, str] = LIKELY) -> QueryError:
    """The error for values that are `ratio` times what they must be, with a guess at the reason."""
    guess = next((f"; {text}" for scale, text in guesses.items() if abs(np.log(abs(ratio) / scale)) < 0.1), "")
    return QueryError(what + guess, argument=argument, remedy="give rad, m and s throughout", code="units")


def require_reach(robot: Robot, t: np.ndarray, q: np.ndarray) -> None:
    """Refuse angles and speeds that are beyond the limits of a joint and within them as degrees.

    Raises QueryError (code "units").
    """
    model, speed = robot.model, np.abs(robot.difference(q[:-1], q[1:]) / np.diff(t)[:, None]).max(axis=0, initial=0.0)
    for joint in robot.joints:
        if joint.kind != "vector" or not turns(model, joint):
            continue
        i, fastest, limit = joint.q.start, float(speed[joint.v.start]), float(model.velocityLimit[joint.v.start])
        reach = max(abs(float(model.lowerPositionLimit[i])), abs(float(model.upperPositionLimit[i])))
        far = float(np.abs(q[:, i]).max())
        if np.radians(far) < reach < far / 1.5 and np.radians(fastest) < limit < fastest:
            what = (f"joint {joint.name!r} turns to {far:.4g} rad at {fastest:.4g} rad/s; its limits are {reach:.4g} "
                    f"rad and {limit:.4g} rad/s; is q in degrees?")  # fmt: skip
            raise QueryError(what, argument="q", remedy="give radians", code="units")


def _filtered(robot: Robot, t: np.ndarray, given: dict[str, np.ndarray], half: int | None) -> Measurements:
    smoothed = smooth(robot, t, given["q"], half)
    part = slice(smoothed.half_window, len(t) - smoothed.half_window)
    return Measurements(t[part], smoothed.q, smoothed.v, smoothed.a, given["tau"][part], smoothed.half_window)


def _cut(m: Measurements, drop: int) -> Measurements:
    part = slice(drop, len(m.t) - drop)
    return Measurements(m.t[part], m.q[part], m.v[part], m.a[part], m.tau[part], m.half_window)


def read_measurements(robot: Robot, path: Path) -> dict[str, Any]:
    """t, q, v, a and tau from a .csv, .parquet or .npz file: the arguments of `identify`.

    Columns are t, then q0, q1, ... or q.JOINT, and so on for v, a and tau. v and a may be missing. An .npz file may
    hold whole arrays t, q, v, a, tau instead.

    Raises
    ------
    TwolinkError
        The file cannot be read.
    QueryError
        A column is missing (code "column-missing").
    """
    return measurements_of(robot, read_table(path)[0], str(path))


def measurements_of(robot: Robot, content: Mapping[str, np.ndarray], where: str) -> dict[str, Any]:
    """The same from columns by name; `where` they are from, for messages."""
    out: dict[str, Any] = {"t": content.get("t")}
    for name in ("q", "v", "a", "tau"):
        out[name], lacking = read_columns(content, robot.joints, name)
        if lacking and (name in ("q", "tau") or len(lacking) < robot.nv):
            raise _missing(where, lacking[0], list(content))
    if out["t"] is None:
        raise _missing(where, "t", list(content))
    return out


def _missing(where: str, column: str, there: list[str]) -> QueryError:
    what = f"column {column!r} is missing; there are {', '.join(there[:12])}"
    remedy = "name the columns t, q0, q1, ... or q.JOINT, and so on for tau, v and a"
    return QueryError(what, where=where, remedy=remedy, code="column-missing")
