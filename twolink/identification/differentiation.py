"""Velocities and accelerations from sampled positions: local polynomials, which filter as they differentiate.

Around each sample a polynomial of degree 4 is fitted by least squares to the samples of a window; its value and
derivatives at the sample are q, v and a. For even times this is Savitzky and Golay's filter. Samples nearer to an end
than half a window are left out. Positions are differences in the tangent space, so that quaternions and angles that
pass pi are treated as they should be.

Source: Savitzky and Golay 1964, "Smoothing and differentiation of data by simplified least squares procedures",
Analytical Chemistry 36.
"""

from dataclasses import dataclass
from math import factorial

import numpy as np

from twolink.dynamics import Robot
from twolink.dynamics.configurations import difference_rows
from twolink.errors import QueryError

DEGREE = 4
SMALLEST = 3  # half a window: 7 samples for the 5 coefficients of the polynomial
_EXCESS = 1.1  # residuals of a window that is not too wide exceed those of the narrowest by less, and by chance


@dataclass(frozen=True)
class Smoothed:
    """q (m, nq), v, a (m, nv) at samples `half` to n - half; half: samples on each side in the window."""

    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    half: int


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
