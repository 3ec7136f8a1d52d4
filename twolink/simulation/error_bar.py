"""Error bars: a bound on the global error of a run from solutions beside it, for one world or for many.

    bar = SAFETY |run - finer| + factor max |run - disturbed| + the rounding that all have alike

The finer solution is not disturbed, and shows truncation. The disturbed ones have the run's own setting, and show
rounding (`integrate.perturbation`). The bar is the largest value so far.
"""

import numpy as np

from twolink.integrate.motion.state import Array, StateSpace
from twolink.integrate.steps.methods import Method

SAFETY = 2.5  # of the distance to a finer solution, which has an error of its own
STEPPED = 4.0  # the same of stepped contacts: where in a step an impact falls changes its error by chance
FEW = 16.0  # steps, of which the errors do not yet follow the tolerance
# Of the largest distance to disturbed solutions, by their number. One distance may be small by chance, all of them
# hardly: if rounding is all of the error, and normal, and disturbances are three times as large, a bar of 6, 3, 2 or 1
# solutions is too small once in 14,000, 1,500, 700 or 700 motions.
DISTURBED = {6: 1.5, 3: 3.0, 2: 6.0, 1: 150.0}
ENOUGH = 0.05  # of the accuracy: with less rounding by its bar, one disturbed solution suffices
DECIDES = 0.1  # of rounding: with less truncation, no smaller setting helps
# Of the accuracy, added to a bar: where the first error is small by chance, it is still below what is usual.
SLACK = 4e-3
# rad or m: solutions of a larger distance have parted, and how far is chance, by which the error may be larger.
PARTED, CHANCE = 1.0, 4.0
ROUNDING = 16 * np.finfo(float).eps  # of the model's constants, relative to q
# Of a step, on the mean, relative to the state: a swing of 46,000 steps of DOP853 lost 0.09 eps in each.
BIAS = 0.1 * np.finfo(float).eps


def error_bar(distance: Array, rounding: Array, safety: float = 1.0) -> Array:
    """A bound on the error at each sample that does not decrease in time.

    Parameters
    ----------
    distance : ndarray (n, ...)
        Distance to other solutions at each sample, rad or m.
    rounding : ndarray (n, ...)
        Bound on errors that all have, rad or m. The start has none.
    safety : float
        By which the distance is multiplied.

    Returns
    -------
    bar : ndarray (n, ...)
        safety distance + rounding, the largest so far and at a few samples later: one distance may be small by chance.
    """
    bar = widened(safety * np.asarray(distance, dtype=float))
    bar[1:] += rounding[1:]
    last = len(bar) - 1
    reach = np.minimum(np.arange(len(bar)) + min(last - 1, 1 + len(bar) // 40), last)
    reach[0] = 0
    return np.asarray(np.maximum.accumulate(bar)[reach])


def widened(distance: Array) -> Array:
    """Distances that count as errors: of solutions that have parted, how far is chance."""
    return np.where(distance > PARTED, CHANCE * distance, distance)


def distances(space: StateSpace, x: Array, others: Array) -> Array:
    """Distances between states x (m, size, n) and others (m, size, n), (m, n); inf where not finite.

    Those of q, rad or m; and of states of effects, in their own units, relative to 1 + |z|.
    """
    x, others = np.broadcast_arrays(x, others)
    with np.errstate(invalid="ignore"):  # inf - inf
        z, other_z = x[:, space.z_rows], others[:, space.z_rows]
        inner = (np.abs(z - other_z) / (1.0 + np.abs(z))).max(axis=1, initial=0.0)
    return np.where(np.isfinite(inner), np.fmax(_distances(space, x, others), inner), np.inf)


def _distances(space: StateSpace, x: Array, others: Array) -> Array:
    """Distances of q, (m, n)."""
    if not space.curved:
        with np.errstate(invalid="ignore"):  # inf - inf
            far = np.abs(x[:, : space.nq] - others[:, : space.nq]).max(axis=1, initial=0.0)
        return np.where(np.isfinite(far), far, np.inf)
    x, others = (np.moveaxis(one, 1, 2) for one in (x, others))
    good = np.isfinite(x).all(axis=2) & np.isfinite(others).all(axis=2)
    out = np.full(good.shape, np.inf)
    out[good] = space.distance(space.rows(x[good].T)[0], space.rows(others[good].T)[0])
    return out


def truncation_factor(method: Method, steps: Array | int) -> Array:
    """The factor of the distance to a finer solution of a run of so many steps, of which few tell less.

    With half the step its error is 2^-order of the run's.
    """
    factor = SAFETY * (1.0 + FEW / np.fmax(steps, 1.0))
    return np.asarray(factor if method.adaptive else factor / (1.0 - 0.5**method.order))


def common_rounding(space: StateSpace, t: Array, x: Array, steps: Array | int) -> Array:
    """A bound on the rounding that all solutions have alike: of constants, and of steps, whose mean is not 0.

    Parameters
    ----------
    space : StateSpace
    t : ndarray (m,)
        Times, s, the last one that of the end.
    x : ndarray (m, size, ...)
        States.
    steps : int or ndarray (...)
        Steps to the end.

    Returns
    -------
    rounding : ndarray (m, ...)
        rad or m.
    """
    return rounding_after(space, x, np.multiply.outer((t - t[0]) / max(t[-1] - t[0], 1e-300), steps))


def rounding_after(space: StateSpace, x: Array, done: Array) -> Array:
    """As `common_rounding`, of states x (m, size, ...) after so many steps (m, ...)."""
    size = np.abs(np.nan_to_num(x[:, : space.z_rows.start]))
    return np.asarray(ROUNDING * size[:, : space.nq].max(axis=1, initial=0.0)
                      + BIAS * done * size.max(axis=1, initial=0.0))  # fmt: skip
