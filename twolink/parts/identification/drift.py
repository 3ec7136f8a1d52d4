"""The effect of slow disturbances of torques on an estimate: their spectrum by restricted maximum likelihood.

Residuals e = y - G x of a drifting sensor or friction tell less than the disturbance was, as the fit took a part of
it; neither their correlations nor blocks of time show it all. In the coefficients of a sine series of each run,

    phi_k(t) = sqrt(2 / n) sin((k - 1/2) pi t / T),    e_k ~ N(0, P + W / (k - 1/2)^2),    k = 1 ... K

a random walk from 0 has independent coefficients (Karhunen and Loeve), here of size W, and noise of short memory has
those of size P. For each joint P and W are those that make the likelihood of what the columns G leave greatest.

Sources: Patterson and Thompson 1971, "Recovery of inter-block information when block sizes are unequal", Biometrika 58;
Giesbrecht and Burns 1985, "Two-stage analysis based on a mixed model", Biometrics 41 (degrees of freedom).
"""

from collections.abc import Sequence

import numpy as np
from scipy.optimize import minimize

_FEWEST, _MOST = 20, 60  # coefficients of a run
_PER_SERIES = 4  # samples or blocks of a run for each of its coefficients
_BAND = 0.9  # of the columns' squares is within them
_RANGE = 14.0  # of the logarithms of P and W about the noise
_CLEARLY = 3.0  # by joint: twice the logarithm of a likelihood that is so much above white noise's is not by chance
_LEAST = 3.0  # degrees of freedom


def spans(ends: Sequence[int]) -> list[slice]:
    """The samples of each run or block, by where they end."""
    return [slice(start, end) for start, end in zip((0, *ends[:-1]), ends, strict=True)]


def slow_variances(
    columns: np.ndarray, residuals: np.ndarray, noise: np.ndarray, weights: np.ndarray, ends: Sequence[int],
    back: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, bool] | None:  # fmt: skip
    """The variances (r,) of back times the sum of w^2 G^T e, their degrees of freedom, and whether e is clearly slow.

    columns (n, nv, r), residuals (n, nv), noise (nv,), weights (nv,): by joint. ends: of the runs. back (r, r). None
    where there are too few coefficients.
    """
    runs = [run for run in spans(ends) if run.stop - run.start >= _PER_SERIES]  # others are too short for a series
    if not runs:
        return None
    sines = [_sines(run.stop - run.start, columns[run]) for run in runs]
    rows = np.concatenate([np.einsum("nk,njr->kjr", s, columns[run]) for s, run in zip(sines, runs, strict=True)])
    left = np.concatenate([s.T @ residuals[run] for s, run in zip(sines, runs, strict=True)])
    frequencies = np.concatenate([(np.arange(s.shape[1]) + 0.5) / len(s) for s in sines])
    shapes = np.stack([np.ones(len(frequencies)), (frequencies / frequencies.min()) ** -2.0])
    size, dofs, r = rows.shape
    if size * dofs < 2 * (r + 2 * dofs):
        return None

    def parts_of(logarithms: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """P and W (2, nv), and the variances (size, nv)."""
        parts = np.exp(logarithms.reshape(2, dofs)) * noise**2
        return parts, shapes.T @ parts

    def likelihood(logarithms: np.ndarray) -> tuple[float, np.ndarray]:
        """-2 times its logarithm, and the derivatives."""
        parts, variance = parts_of(logarithms)
        root = np.sqrt(variance)
        q, triangle = np.linalg.qr((rows / root[..., None]).reshape(-1, r))
        e = (left / root).ravel()
        squares = ((e - q @ (q.T @ e)) ** 2).reshape(size, dofs)
        free = 1 - np.sum(q**2, axis=1).reshape(size, dofs)
        volume = 2 * np.log(np.abs(np.diag(triangle)) + 1e-300).sum()
        slope = parts * (shapes @ ((free - squares) / variance))
        return float(np.log(variance).sum() + volume + squares.sum()), slope.ravel()

    white = np.repeat([0.0, -_RANGE], dofs)
    found = minimize(likelihood, np.zeros(2 * dofs), jac=True, method="L-BFGS-B", bounds=[(-_RANGE, _RANGE)] * 2 * dofs)
    variance = parts_of(found.x)[1]
    scores = rows * weights[:, None] ** 2 @ back.T
    # Fisher's information on P and W of each joint, and what a unit of them adds to each variance
    information = np.einsum("ak,bk,kj->jab", shapes, shapes, variance**-2.0) / 2
    added = np.einsum("ak,kjr->jar", shapes, scores**2)
    variances = np.einsum("kjr,kj->r", scores**2, variance)
    doubt = np.einsum("jar,jab,jbr->r", added, np.linalg.pinv(information, hermitian=True), added)
    free = np.maximum(2 * variances**2 / np.maximum(doubt, 1e-300), _LEAST)
    return variances, free, likelihood(white)[0] - found.fun > _CLEARLY * dofs


def _sines(n: int, columns: np.ndarray) -> np.ndarray:
    """The series (n, K) of a run, up to where most of its columns are."""
    at = (np.arange(n) + 0.5)[:, None]
    series = np.sqrt(2 / n) * np.sin(np.pi * at * (np.arange(min(_MOST, n // _PER_SERIES)) + 0.5) / n)
    energy = np.cumsum(np.einsum("nk,njr->kjr", series, columns).reshape(series.shape[1], -1) ** 2, axis=0).sum(axis=1)
    enough = int(np.searchsorted(energy, _BAND * np.sum(columns**2))) + 1
    return np.asarray(series[:, : max(_FEWEST, enough)])
