"""Nonlinear least squares within linear bounds, by Levenberg and Marquardt's steps, each of a bounded problem.

    minimise |J d + r|^2 + mu |D d|^2   with   A d >= b

A step that leads nowhere, since the model has no answer there or residuals grow, is tried again shorter. One that comes
to a bound goes on along it.

References: Marquardt 1963; Nielsen 1999, "Damping parameter in Marquardt's method"; Lawson and Hanson 1974, "Solving
least squares problems", chapter 23.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, cast

import numpy as np
import scipy.linalg
from scipy.optimize import nnls

ENOUGH = 1e-8  # of the sum of squares: a step that promises less ends the search
SHORTEST = 1e-10  # of the length of u, or of 1
FIRST = 1e-3  # mu at first
CUTS = 20  # of the convex set
CLOSE = 1e-4  # of the sum of squares: what may be left to an undamped step at the end
NEAR = 1e-6  # or so long may that step be


class Bounds(NamedTuple):
    """A d >= b, of (m, n) and (m,)."""

    rows: np.ndarray
    least: np.ndarray


class Evaluated(NamedTuple):
    """Residuals, a function that gives their Jacobian, and what they are of."""

    residuals: np.ndarray
    jacobian: Callable[[], np.ndarray]
    of: Any


class StepLimits(NamedTuple):
    """The limits of a step: bounds, and a convex set, by a function that gives bounds that a step outside breaks."""

    bounds: Bounds
    cut: Callable[[np.ndarray], Bounds]


def step_within(jacobian: np.ndarray, residuals: np.ndarray, damping: np.ndarray, limits: StepLimits) -> np.ndarray:
    """d (n,) that minimises |J d + r|^2 + |damping d|^2 within limits, which d = 0 keeps."""
    q, triangle = scipy.linalg.qr(np.vstack([jacobian, np.diag(damping)]), mode="economic")
    toward = -q[: len(residuals)].T @ residuals
    d = free = scipy.linalg.solve_triangular(triangle, toward)
    bounds = limits.bounds
    for _ in range(CUTS):
        if (bounds.rows @ free < bounds.least).any():
            d = free + _back(triangle, bounds.rows, bounds.least - bounds.rows @ free)
        cut = limits.cut(d)
        if not len(cut.least):
            break
        bounds = Bounds(np.vstack([bounds.rows, cut.rows]), np.append(bounds.least, cut.least))
    return np.asarray(d)


def _back(triangle: np.ndarray, rows: np.ndarray, least: np.ndarray) -> np.ndarray:
    """The e with the least |R e| and A e >= h: its dual is least squares with multipliers that are not negative."""
    slopes = scipy.linalg.solve_triangular(triangle, rows.T, trans="T")
    lengths = np.linalg.norm(slopes, axis=0)
    least, slopes = (x[..., lengths > 0.0] / lengths[lengths > 0.0] for x in (least, slopes))
    size = least.max()  # |R e| is this or a little more
    dual, last = np.vstack([slopes, least / size]), np.eye(len(triangle) + 1)[-1]
    rest = dual @ nnls(dual, last)[0] - last
    return np.asarray(-size * scipy.linalg.solve_triangular(triangle, rest[:-1]) / rest[-1])


def least_squares(
    evaluate: Callable[[np.ndarray], Evaluated | None], size: int, limits: Callable[[np.ndarray], StepLimits], most: int
) -> tuple[np.ndarray, Any, bool | None]:
    """The u (size,) whose residuals are least, from u = 0, and what they are of; and whether that is the end.

    evaluate: None where there is no answer, but at 0. limits: of the step from a u. most: evaluations. Ctrl-C ends it
    with the best so far: None.
    """
    u, now = np.zeros(size), cast("Evaluated", evaluate(np.zeros(size)))
    try:
        residuals, jacobian = now.residuals, now.jacobian()
        scale, mu, grow = np.linalg.norm(jacobian, axis=0), FIRST, 2.0
        for _ in range(1, most):
            scale = np.maximum(scale, np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300))
            d = step_within(jacobian, residuals, np.sqrt(mu) * scale, limits(u))
            cost = float(residuals @ residuals)
            promised = cost - float(np.sum((residuals + jacobian @ d) ** 2))
            if promised <= ENOUGH * cost or np.linalg.norm(d) <= SHORTEST * max(1.0, float(np.linalg.norm(u))):
                break
            after = evaluate(u + d)
            gain = -1.0 if after is None else (cost - float(after.residuals @ after.residuals)) / promised
            if after is not None and gain > 0.0:
                u, now, residuals, jacobian = u + d, after, after.residuals, after.jacobian()
                mu, grow = mu * max(1 / 3, 1.0 - (2.0 * gain - 1.0) ** 3), 2.0
            else:
                mu, grow = mu * grow, 2.0 * grow
        d = step_within(jacobian, residuals, np.sqrt(ENOUGH) * scale, limits(u))
        left = float(residuals @ residuals) - float(np.sum((residuals + jacobian @ d) ** 2))
        return u, now.of, left <= CLOSE * float(residuals @ residuals) or float(np.linalg.norm(d)) <= NEAR
    except KeyboardInterrupt:
        return u, now.of, None
