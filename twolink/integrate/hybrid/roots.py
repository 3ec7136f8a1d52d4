"""Zeros and minima of functions that cost less in batches: each evaluation takes several points at once."""

import itertools
import math
from collections.abc import Callable

import numpy as np

from twolink.integrate.motion.state import Array

Function = Callable[[Array], Array]

POWERS = np.array([0.0, 0.1, 0.3, 0.5, 0.65, 0.8])
NEAR = 0.4  # of the resolution: where the nearest points to an estimate lie
QUARTERS = np.array([0.25, 0.5, 0.75])
SHRUNK = 1e-6  # of the first bracket of a minimum
BATCHES = 60
LAST = 64  # times the resolution: a bracket that one batch resolves, and a secant near enough to an estimate
AGREEING = 4  # points of an estimate that may be compared with the secant: two give the secant itself
REACH = (4, 2, 1)  # points on each side for the estimate of each batch: nearer ones differ by rounding


def crossing(f: Function, points: Array, values: Array, resolution: float) -> float:
    """Zero at which f passes from above 0 to 0 or below: by the secant of a bracket no longer than the resolution.

    An end of the bracket would be wrong by half the resolution on average, always to the same side, and the energies of
    many impacts would all be too large. Where the secant of a longer bracket is near an estimate from more points, that
    estimate is much nearer to the zero, and ends the search.

    points, values: increasing points and f there; the first value that is not above 0 ends the bracket. A batch
    quarters the bracket, and has an estimate by inverse interpolation with points around it, at distances from the
    resolution to the bracket, evenly by their logarithms. Where f is not a finite number it counts as above 0.
    """
    for batches in range(BATCHES):
        end = int(np.argmax(values <= 0.0))
        a, b = float(points[end - 1]), float(points[end])
        if b - a <= resolution:
            break
        estimate, count = _estimate(points, values, end, REACH[min(batches, len(REACH) - 1)])
        if batches and count >= AGREEING and abs(estimate - _secant(points, values, end)) <= LAST * resolution:
            return estimate
        if b - a <= LAST * resolution:  # f may be rounding here, which no estimate helps with
            batch = np.arange(a, b, 2 * NEAR * resolution)
        else:  # A good estimate ends the search: the zero lies between its two nearest neighbours.
            around = NEAR * resolution * ((b - a) / resolution) ** POWERS
            batch = np.concatenate([estimate - around, estimate + around, a + (b - a) * QUARTERS])
        batch = batch[(batch > a) & (batch < b)]
        batch.sort()
        if not batch.size:
            break
        points = np.concatenate([points[:end], batch, points[end:]])
        values = np.concatenate([values[:end], f(batch), values[end:]])
    return _secant(points, values, end)


def _secant(points: Array, values: Array, end: int) -> float:
    """The zero of the line through points[end - 1] and points[end]; the latter where the values have none."""
    a, b = float(points[end - 1]), float(points[end])
    before, after = float(values[end - 1]), float(values[end])
    return a + (b - a) * before / (before - after) if math.isfinite(before - after) else b


def _estimate(points: Array, values: Array, end: int, reach: int) -> tuple[float, int]:
    """The zero between points[end - 1] and points[end], where the values pass it, and from how many points it is.

    It is that of the polynomial which gives the points for the values (Neville's scheme), of `reach` points on each
    side if their values decrease, else of fewer; where there is none, the middle. A side may have none that is finite.
    """
    a, b = float(points[end - 1]), float(points[end])
    for r in range(reach, 0, -1):
        near = slice(max(0, end - r), end + r)
        x, y = points[near].tolist(), values[near].tolist()
        while y[0] == math.inf:
            del x[0], y[0]
        if any(not later < before for before, later in itertools.pairwise(y)):
            continue
        for k in range(1, len(x)):
            x = [(y[i] * x[i + 1] - y[i + k] * x[i]) / (y[i] - y[i + k]) for i in range(len(x) - 1)]
        if a <= x[0] <= b:
            return float(x[0]), len(y)
    return 0.5 * (a + b), 0


def lowest(f: Function, a: float, b: float) -> tuple[float, float]:
    """(point, value) of a minimum between a and b: by batches, about the vertex of the parabola through the lowest."""
    points = np.linspace(a, b, 7)
    values = f(points)
    first = b - a
    for _ in range(BATCHES):
        i = int(np.nanargmin(values[1:-1])) + 1
        points, values = points[i - 1 : i + 2], values[i - 1 : i + 2]
        a, b = points[0], points[-1]
        if b - a <= SHRUNK * first:
            break
        vertex = _vertex(points, values)
        batch = np.concatenate([vertex + (b - a) * np.array([-1e-2, 0.0, 1e-2]), np.linspace(a, b, 5)[1:-1]])
        batch = np.setdiff1d(batch[(batch > a) & (batch < b)], points)
        if not batch.size:
            break
        order = np.argsort(every := np.concatenate([points, batch]))
        points, values = every[order], np.concatenate([values, f(batch)])[order]
    best = int(np.nanargmin(values))
    return float(points[best]), float(values[best])


def _vertex(points: Array, values: Array) -> float:
    """The lowest point of the parabola through three points; the middle one where they lie on a line."""
    (a, b, c), (fa, fb, fc) = points, values
    p, q = (b - a) * (fb - fc), (b - c) * (fb - fa)
    with np.errstate(all="ignore"):
        vertex = b - 0.5 * ((b - a) * p - (b - c) * q) / (p - q)
    return float(vertex if np.isfinite(vertex) else b)
