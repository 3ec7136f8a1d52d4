"""Linear regression of joint torques, y = G x + e, with covariances that hold for the residuals there are.

ordinary   all torques count alike
weighted   torques count by the noise of their joint, which the residuals show (Aitken 1935)
robust     weighted, and residuals beyond 1.345 standard deviations count less (Huber 1964)
total      weighted, and the regressor has errors of known covariance too (Golub and Van Loan 1980)
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from twolink.parts.identification.drift import slow_variances, spans

METHODS = ("ordinary", "weighted", "robust", "total")
CLEARLY = 4.0  # standard errors of an estimated noise, from which it counts more than a stated one
_BLOCKS = 20  # long beside the residuals' memory, and enough to tell a variance
_SLOWEST = 0.97  # correlation of neighbouring scores that is taken away first
_REST = 1e3  # of the square of the noise: the bound on torques at rest at first
HUBER = 1.345  # 95 % of the efficiency of least squares for normal errors
_EPSILON = float(np.finfo(float).eps)


@dataclass(frozen=True)
class Fit:
    """x (r,) with its covariance (r, r).

    residuals (n, nv): y - G x. noise (nv,): their standard deviation by joint.
    condition: of the weighted regressor, its columns scaled to length 1.
    rounding (r,): a bound on the error of x from rounding.
    metric (r, r): the covariance of least squares, had the residuals been independent: the inverse of the information.
    by_blocks (r, r): the covariance from leaving out one block of time after the other (jackknife), with `blocks` - 1
    degrees of freedom: it assumes nothing of the correlation within them (MacKinnon and White 1985; Bell and McCaffrey
    2002). What a model lacks is alike within a block and other in the next, and moves most what few blocks tell.
    length: samples over which residuals follow each other; the covariance takes it in.
    slow: variances (r,) that take in what drifts, with their degrees of freedom; None where residuals are white.
    share (n, nv): what the torques count, 1 but for those at rest.
    """

    x: np.ndarray
    covariance: np.ndarray
    residuals: np.ndarray
    noise: np.ndarray
    condition: float
    rounding: np.ndarray
    metric: np.ndarray
    by_blocks: np.ndarray
    blocks: int
    length: int
    slow: tuple[np.ndarray, np.ndarray] | None
    share: np.ndarray

    @property
    def correlated(self) -> bool:
        """True if residuals follow each other in time, as unmodelled forces and filters make them."""
        return self.length > 0


def fit(
    columns: np.ndarray, y: np.ndarray, method: str, error: np.ndarray | None = None, *,
    least: float = 0.0, sigma: np.ndarray | None = None, blocks: Sequence[int] | None = None,
    prior: tuple[np.ndarray, np.ndarray] | None = None, runs: Sequence[int] | None = None,
    rest: tuple[np.ndarray, np.ndarray] | None = None,
) -> Fit:  # fmt: skip
    """Fit y (n, nv) by columns (n, nv, r) of full rank; error (n, nv, r + 1): of columns and y, for "total".

    least: what the noise is at least. sigma (nv,): the noise, where it is known; residuals that are clearly larger
    count instead. blocks: where each ends; by default 20 of the same length. prior: x (r,) as it is
    expected, and the reciprocals of the standard deviations of that; "ordinary" and "total" have none. runs: where each
    ends. rest: samples (n, nv) for which a joint's friction is unknown within its size, and what is added up to that
    (nv, r): they count as the bound s^2 / (s^2 + samples size^2 / 3) of a torque with noise s.
    """
    r = columns.shape[-1]
    expected, sure = prior if prior is not None and method != "ordinary" else (np.zeros(r), np.zeros(r))
    noise, full = np.ones(y.shape[1]), np.ones(y.shape, dtype=bool)
    weights, given, share = np.ones(y.shape), (columns, y), np.ones(y.shape)
    if rest is not None:
        share = 1 / (1 + _REST * rest[0])
    for _ in range(40):
        columns, y = given[0] * np.sqrt(share)[..., None], given[1] * np.sqrt(share)
        x, leverage = _solve(columns, y, weights, expected, sure)
        residuals = y - columns @ x
        before, noise = noise, np.maximum(_noise(residuals, leverage, y, method == "robust", share), least)
        if sigma is not None:
            noise = np.where(noise > sigma * (1 + CLEARLY / np.sqrt(2 * len(y))), noise, sigma)
        if method == "ordinary" or np.allclose(before, noise, rtol=1e-6, atol=0):
            break
        if rest is not None:
            share = 1 / (1 + rest[0] * (rest[1] @ np.abs(x) / noise) ** 2 / 3)
        weights = np.broadcast_to(1 / noise, y.shape)
        if method == "robust":
            beyond = HUBER / np.maximum(np.abs(residuals / noise), 1e-300)
            full = beyond >= 1
            weights = weights * np.sqrt(np.minimum(1.0, beyond))
    if method == "total" and error is not None:
        x = _total(columns / noise[:, None], y / noise, error * (np.sqrt(share) / noise)[..., None], x)
        residuals = y - columns @ x
    lengths = np.linalg.norm(columns * weights[..., None], axis=(0, 1))
    scaled = columns / lengths
    length = correlation_length(residuals / noise)
    even = np.linspace(0, len(y), min(_BLOCKS, len(y)) + 1).round().astype(int)[1:]
    ends = even if blocks is None else np.asarray(blocks)
    covariance, by_blocks, slow = _covariance(
        scaled, residuals, weights, noise, full, sure / lengths, ends, length, runs or (len(y),), sigma
    )
    singular = np.linalg.svd(_triangle(scaled * weights[..., None]), compute_uv=False)
    information = _triangle(np.vstack([(scaled / noise[:, None]).reshape(-1, r), np.diag(sure / lengths)]))
    root = scipy.linalg.solve_triangular(information, np.eye(r))
    condition = float(singular[0] / singular[-1])
    # Golub and Van Loan, Matrix Computations, section 5.3.8
    left, size = np.linalg.norm(residuals * weights), np.linalg.norm(x * lengths)
    rounding = 4 * _EPSILON * (condition * size + condition**2 * left) / lengths
    sizes = np.outer(lengths, lengths)
    return Fit(x, covariance / sizes, given[1] - given[0] @ x, noise, condition, rounding,
               root @ root.T / sizes, by_blocks / sizes, len(ends), length,
               slow and (slow[0] / lengths**2, slow[1]), share)  # fmt: skip


def _solve(
    columns: np.ndarray, y: np.ndarray, weights: np.ndarray, expected: np.ndarray, sure: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The weighted least-squares solution with a ridge, and the leverages (n, nv) of the torques."""
    flat = rows_of(columns, weights)
    lengths = np.linalg.norm(flat, axis=0)
    ridge = [np.diag(sure / lengths)] if sure.any() else []
    right = np.concatenate([(y * weights).ravel(), *([sure * expected] if ridge else [])])
    q, r = scipy.linalg.qr(np.vstack([flat / lengths, *ridge]), mode="economic")
    x = scipy.linalg.solve_triangular(r, q.T @ right) / lengths
    return np.asarray(x), np.sum(q[: y.size] ** 2, axis=1).reshape(y.shape)


def rows_of(columns: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """The rows (n nv, r) of columns (n, nv, r), by weights (n, nv) of theirs."""
    return np.asarray((columns * weights[..., None]).reshape(-1, columns.shape[-1]))


def _triangle(columns: np.ndarray) -> np.ndarray:
    return np.asarray(np.linalg.qr(columns.reshape(-1, columns.shape[-1]), mode="r"))


def _noise(residuals: np.ndarray, leverage: np.ndarray, y: np.ndarray, robust: bool, share: np.ndarray) -> np.ndarray:
    """The standard deviation (nv,) of each joint's torques; not below their rounding."""
    count = share.sum(axis=0)
    free = np.maximum(count - leverage.sum(axis=0), 1.0)
    if robust:
        moving = np.where(share > 0.5, np.abs(residuals), np.nan)
        spread = np.nan_to_num(np.nanmedian(moving, axis=0)) / 0.6745 * np.sqrt(count / free)
    else:
        spread = np.sqrt(np.sum(residuals**2, axis=0) / free)
    return np.asarray(np.maximum(spread, 16 * _EPSILON * max(np.abs(y).max(), 1e-100)))


def _total(columns: np.ndarray, y: np.ndarray, error: np.ndarray, first: np.ndarray) -> np.ndarray:
    """x that makes |G x - y|^2 / ((x, -1)^T (C + diag(0, s^2)) (x, -1)) least.

    C is the covariance of the errors of a row of (G, y). The solution is a generalised eigenvector. s^2, the noise of
    the torques, is what C leaves of the variance of the residuals (1 here) that a first solution has.
    """
    both = _triangle(np.concatenate([columns, y[..., None]], axis=-1))
    flat = error.reshape(-1, len(both))
    spread = flat.T @ flat / len(flat)
    change = np.append(first, -1.0)
    spread[-1, -1] += max(1.0 - float(change @ spread @ change), 0.01)
    lengths = np.linalg.norm(both, axis=0)
    inverse = scipy.linalg.inv(both / lengths)
    ratio = inverse.T @ (spread / np.outer(lengths, lengths)) @ inverse
    vector = inverse @ np.linalg.eigh(ratio)[1][:, -1] / lengths
    return np.asarray(-vector[:-1] / vector[-1])


def _covariance(
    columns: np.ndarray, residuals: np.ndarray, weights: np.ndarray, noise: np.ndarray, full: np.ndarray,
    sure: np.ndarray, ends: np.ndarray, length: int, runs: Sequence[int], sigma: np.ndarray | None,
) -> tuple[np.ndarray, np.ndarray, tuple[np.ndarray, np.ndarray] | None]:  # fmt: skip
    """The covariance A^-1 B A^-1 of x, the same by blocks, and variances with what drifts.

    A = sum of w^2 G^T G over residuals of full weight, and the prior's information, which B has too. B = sum of w^4
    s_k^2 G^T G for independent residuals of joint k; for correlated ones, or some of less weight, the long-run
    covariance of the scores w^2 G^T e (Newey and West 1987). Where sigma is stated it is no less, in any direction,
    than that of independent residuals of this size: small residuals do not refute it.
    """
    n, dofs, r = columns.shape
    # Scores are taken in coordinates in which A is 1: forming A would square the condition number.
    rows = rows_of(columns, weights * full)
    inverse = scipy.linalg.solve_triangular(_triangle(np.vstack([rows, np.diag(sure)])), np.eye(r))
    columns = columns @ inverse
    score = np.einsum("nkr,nk->nr", columns, weights**2 * residuals)
    whole = columns * weights[..., None]
    sums = np.stack([_left_out(whole[rows].reshape(-1, r), score[rows]) for rows in spans(ends.tolist())])

    def independent(size: np.ndarray) -> np.ndarray:
        flat = rows_of(columns, weights**2 * size)
        return np.asarray(flat.T @ flat)

    if length == 0 and full.all():
        middle = independent(noise)
    else:
        middle = _long_run(score, length) * n * dofs / (n * dofs - r)
        if sigma is not None:
            middle = _wider(independent(sigma), middle)
    of_prior, count = inverse.T @ np.diag(sure**2) @ inverse, max(len(ends) - 1, 1)
    first, second = (inverse @ (part + of_prior) @ inverse.T for part in (middle, sums.T @ sums * count / len(ends)))
    few = np.where(full, residuals, np.clip(residuals, -HUBER * noise, HUBER * noise))
    slow = slow_variances(columns, few, noise, weights.max(axis=0), runs, inverse)
    seen = slow is not None and (length > 0 or slow[2])
    drifting = (slow[0] + np.diag(inverse @ of_prior @ inverse.T), slow[1]) if slow is not None and seen else None
    return (first + first.T) / 2, (second + second.T) / 2, drifting


def _wider(least: np.ndarray, other: np.ndarray) -> np.ndarray:
    """A covariance that is no less than either of two, in any direction: least + the positive part of the rest."""
    sizes, along = np.linalg.eigh(other - least)
    return np.asarray(least + (along * np.maximum(sizes, 0.0)) @ along.T)


def _left_out(block: np.ndarray, score: np.ndarray) -> np.ndarray:
    """The change (r,) of x without a block, in coordinates in which A is 1: (1 - G^T G)^-1 times its scores' sum."""
    rest = (1 + _EPSILON) * np.eye(block.shape[1]) - block.T @ block
    return np.asarray(np.linalg.lstsq(rest, score.sum(axis=0), rcond=None)[0])


def _long_run(score: np.ndarray, length: int) -> np.ndarray:
    """n times the long-run covariance (r, r) of scores (n, r), prewhitened where they follow each other.

    Newey and West's weights alone take too little of slow correlations; what is left of a score after the one before it
    has hardly any (Andrews and Monahan 1992).
    """
    if length == 0:
        return np.asarray(score.T @ score)
    share = np.sum(score[1:] * score[:-1], axis=0) / np.maximum(np.sum(score**2, axis=0), 1e-300)
    share = np.clip(share, -_SLOWEST, _SLOWEST)
    lags = int(np.ceil(4 * (len(score) / 100) ** (2 / 9)))
    moving = moving_sums(score[1:] - share * score[:-1], lags)
    return np.asarray(moving.T @ moving / (lags + 1) / np.outer(1 - share, 1 - share))


def moving_sums(score: np.ndarray, length: int) -> np.ndarray:
    """Sums (n + length, r) over a moving window of scores (n, r).

    Weights 1 - lag / (length + 1) of the lags in Newey and West's covariance are those of the squares of these.
    """
    n, r = score.shape
    sums = np.cumsum(np.vstack([score, np.zeros((length, r))]), axis=0)
    return np.asarray(sums - np.vstack([np.zeros((length + 1, r)), sums])[: n + length])


def correlation_length(residuals: np.ndarray) -> int:
    """Samples over which residuals (n, nv) follow each other, 0 where their correlation is that of white noise."""
    n = len(residuals)
    if n < 20:
        return 0
    total = np.sum(residuals**2)
    if abs(np.sum(residuals[1:] * residuals[:-1])) < 4 * total / np.sqrt(residuals.size):
        return 0
    for lag in range(1, n // 8):
        if np.sum(residuals[lag:] * residuals[:-lag]) < 0.1 * total:
            return 3 * lag
    return n // 4
