"""Stiffness: the fastest rate of change of equations at a state, and whether that mode decays."""

import numpy as np

from twolink.integrate.equations import Equations
from twolink.integrate.pinocchio_rate import rate
from twolink.integrate.state import Array

ITERATIONS = 4
STEP = 1e-7  # relative, of differences
DECAYING = -0.99  # the cosine between a direction and what the Jacobian makes of it: below, the mode only decays


def fastest(equations: Equations, x: Array) -> tuple[Array, Array]:
    """(rates [1/s] (n,), whether that mode decays (n,)) at states x (size, n), by the power method on differences."""
    start = rate(equations, 0.0, x)
    largest, cosine = np.zeros(x.shape[1]), np.zeros(x.shape[1])
    direction = np.where(np.isfinite(start), start, 0.0) + 1e-3
    with np.errstate(all="ignore"):
        for _ in range(ITERATIONS):
            size = np.sqrt((direction**2).sum(axis=0))
            direction = direction / np.where(size > 0.0, size, 1.0)
            step = STEP * (1.0 + np.abs(x).max(axis=0))
            image = (rate(equations, 0.0, x + step * direction) - start) / step
            image = np.where(np.isfinite(image), image, 0.0)
            length = np.sqrt((image**2).sum(axis=0))
            cosine = (image * direction).sum(axis=0) / np.where(length > 0.0, length, 1.0)
            largest = np.fmax(largest, length)
            direction = image
    return largest, cosine < DECAYING
