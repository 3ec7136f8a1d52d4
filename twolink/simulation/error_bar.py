"""Error bars: a bound on the global error from the distance of two solutions, for one world or for many.

The second solution is more accurate than the first, and perturbed (`integrate.perturbation`): it starts some roundings
away and takes other steps, so that the two do not have the same errors. Where rounding may be a large part of the
error, it has more digits, or there are two that are perturbed in opposite directions (`verification`).
"""

import numpy as np

from twolink.integrate.methods import Method
from twolink.integrate.solution import Solution
from twolink.integrate.state import Array, StateSpace

SAFETY = 2.0  # the second solution has errors of its own
# Of the largest distance to several: there rounding decides, and those of the second solutions are as large as that of
# the first. A factor of 2 was too small in 2 of 358 double pendulums over 5 to 60 s, by 1.7 at most; a factor of 4 in
# one of 1000 scenes of all kinds (scripts/honest_bars.py), by 1.12.
SAFETY_OF_SEVERAL = 6.0
# Of the accuracy, added to a bar. Where the first error is small by chance, it is still below what is usual for the
# second one, a hundredth of the usual first error: this covers it where that is below 0.4 of the accuracy.
SLACK = 4e-3
ROUNDING = 16 * np.finfo(float).eps  # of the model's constants, which is the same in both solutions


def error_bar(distance: Array, rounding: Array, safety: float | Array = SAFETY) -> Array:
    """A bound on the error at each sample that does not decrease in time.

    Parameters
    ----------
    distance : ndarray (n, ...)
        Distance of two solutions at each sample, rad or m.
    rounding : ndarray (n, ...)
        Bound on errors that both have, rad or m. The start has none.
    safety : float or ndarray (...)
        By which the distance is multiplied.

    Returns
    -------
    bar : ndarray (n, ...)
        safety distance + rounding, the largest so far and at a few samples later: one distance may be small by chance.
    """
    bar = safety * np.asarray(distance, dtype=float)
    bar[1:] += rounding[1:]
    last = len(bar) - 1
    reach = np.minimum(np.arange(len(bar)) + min(last - 1, 1 + len(bar) // 40), last)
    reach[0] = 0
    return np.asarray(np.maximum.accumulate(bar)[reach])


def distance_of_runs(space: StateSpace, method: Method, coarse: Solution, fine: Solution) -> Array:
    """Error of the coarse solution's q at each sample (n,), by the fine one, rad or m."""
    q, v = space.rows(coarse.x)
    if fine.precise is not None:
        ours = coarse.x.T if coarse.precise is None else coarse.precise
        off = np.abs(ours[:, : space.nq].astype(fine.precise.dtype) - fine.precise[:, : space.nq])
        rounded = np.abs(q).max(axis=1, initial=0.0) * np.finfo(float).eps if coarse.precise is None else 0.0
        # A rotation turns by twice what its quaternion differs by.
        return np.asarray((2.0 if space.curved else 1.0) * off.max(axis=1, initial=0.0).astype(float) + rounded)
    other = space.rows(fine.x)[0]
    if np.array_equal(coarse.t, fine.t):
        distance = space.distance(q, other)
    else:  # an event that ends both solutions ends each at a time of its own
        same = np.minimum(np.arange(len(coarse.t)), len(fine.t) - 1)
        late = np.abs(coarse.t - fine.t[same]) * np.abs(v).max(axis=1, initial=0.0)
        distance = space.distance(q, other[same]) + late
    return np.asarray(distance if method.adaptive else distance / (1.0 - 0.5**method.order))  # fine: half the step


def bar_of_run(space: StateSpace, coarse: Solution, looks: Array, distance: Array, safety: float = SAFETY) -> Array:
    """The error bar of the coarse solution at each sample (n,), rad or m.

    Parameters
    ----------
    space : StateSpace
    coarse : Solution
    looks : ndarray (k,)
        Numbers of the samples at which its error is estimated, with the first and the last.
    distance : ndarray (k,)
        The largest distance to second solutions there, rad or m.
    safety : float
        By which the distance is multiplied.
    """
    size = np.abs(coarse.x[: space.nq].take(looks, axis=1)).max(axis=0, initial=0.0)
    rounding = ROUNDING * size if coarse.precise is None else 0.0 * size
    bar = error_bar(distance, rounding, safety)
    return bar.repeat(np.diff(looks, prepend=-1))  # between two looks, that of the later one


def distance_of_worlds(space: StateSpace, coarse: Array, fine: Array) -> Array:
    """The distance of q (m, n), rad or m, of states (m, size, n) at m times; 0 where one is not finite."""
    moments, _, worlds = coarse.shape
    finite = np.isfinite(coarse + fine).all(axis=1)
    distance = np.zeros((moments, worlds))
    for i, good in enumerate(finite):
        distance[i, good] = space.distance(space.rows(coarse[i][:, good])[0], space.rows(fine[i][:, good])[0])
    return distance
