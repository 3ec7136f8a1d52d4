"""Zeros and minima of functions that cost less in batches: each evaluation takes several points at once."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np

from twolink.integrate.state import Array

Function = Callable[[Array], Array]

AROUND = np.array([-3e-2, -1e-3, -1e-6, 0.0, 1e-6, 1e-3, 3e-2])  # of the bracket, about an estimate of the zero
SHRUNK = 1e-6  # of the first bracket of a minimum
BATCHES = 60


def crossing(f: Function, a: float, b: float, fa: float, fb: float, resolution: float) -> float:
    """Where f passes from above 0 at a to 0 or below at b, to the resolution; the end at which it is not above 0.

    A batch is the middle, and an estimate by inverse interpolation with points around it, at distances that shrink
    faster than its error. Where f is not a finite number it counts as above 0.
    """
    points, values = np.array([a, b]), np.array([fa, fb])
    for _ in range(BATCHES):
        if b - a <= resolution:
            break
        batch = _estimate(points, values, a, b) + (b - a) * AROUND
        batch = np.append(batch, 0.5 * (a + b))
        batch = np.sort(batch[(batch > a) & (batch < b)])
        if not batch.size:
            break
        points, values = np.array([a, *batch, b]), np.array([fa, *f(batch), fb])
        end = int(np.argmax(values <= 0.0))
        a, b, fa, fb = float(points[end - 1]), float(points[end]), float(values[end - 1]), float(values[end])
        near = slice(max(0, end - 2), end + 2)
        points, values = points[near], values[near]
    return b


def _estimate(points: Array, values: Array, a: float, b: float) -> float:
    """The zero in [a, b] of the polynomial that gives the points for the values; the middle where there is none."""
    finite = np.isfinite(values)
    x, y = points[finite].tolist(), values[finite].tolist()
    if len(x) < 2 or any(later >= before for before, later in itertools.pairwise(y)):
        return 0.5 * (a + b)
    for k in range(1, len(x)):  # Neville's scheme at y = 0
        x = [(y[i] * x[i + 1] - y[i + k] * x[i]) / (y[i] - y[i + k]) for i in range(len(x) - 1)]
    return x[0] if a < x[0] < b else 0.5 * (a + b)


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
