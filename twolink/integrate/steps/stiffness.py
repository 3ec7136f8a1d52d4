"""Stiffness: the fastest rate of change of equations at states, and whether that mode decays."""

import numpy as np

from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.pinocchio_rate import rate
from twolink.integrate.motion.state import Array

ITERATIONS = 4
STEP = 1e-7  # relative, of differences
DECAYING = -0.99  # the cosine between a direction and what the Jacobian makes of it: below, the mode only decays
NEIGHBOURS, SPREAD = 4, 0.5  # states near the start, and their distance in q, rad or m


def fastest_decay(equations: Equations) -> float:
    """The rate of the fastest mode [1/s] where it decays, else 0: at the start, or near it by the median.

    The median: beside a singular position a rate may be large that the motion never meets. Under constraints the start
    alone counts, as states near it do not fulfil them.
    """
    space, start = equations.space, equations.start
    if space.size == 0:
        return 0.0
    states, random = [start], np.random.default_rng(0)
    for _ in range(NEIGHBOURS if equations.constraints is None else 0):
        q = equations.robot.integrate(start[: space.nq], random.uniform(-SPREAD, SPREAD, space.nv))
        states.append(np.concatenate([q, start[space.nq :]]))
    rates, decays = fastest(equations, np.stack(states, axis=1))
    rates = np.where(decays, rates, 0.0)
    return float(max(rates[0], np.median(rates)))


def fastest(equations: Equations, x: Array) -> tuple[Array, Array]:
    """(rates [1/s] (n,), whether that mode decays (n,)) at states x (size, n), by the power method on differences."""
    start = rate(equations, 0.0, x)
    largest, cosine = np.zeros(x.shape[1]), np.zeros(x.shape[1])
    direction = np.where(np.isfinite(start), start, 0.0) + 1e-3
    with np.errstate(all="ignore"):
        for _ in range(ITERATIONS):
            size = np.sqrt((direction**2).sum(axis=0))
            direction = direction / np.where(size > 0.0, size, 1.0)
            step = STEP * (1.0 + np.abs(x).max(axis=0, initial=0.0))
            image = (rate(equations, 0.0, x + step * direction) - start) / step
            image = np.where(np.isfinite(image), image, 0.0)
            length = np.sqrt((image**2).sum(axis=0))
            cosine = (image * direction).sum(axis=0) / np.where(length > 0.0, length, 1.0)
            largest = np.fmax(largest, length)
            direction = image
    return largest, cosine < DECAYING
