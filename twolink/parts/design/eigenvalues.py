"""Eigenvalues of a matrix that is known with an error, and which states inputs can reach."""

from typing import Literal, NamedTuple

import numpy as np

from twolink.integrate.motion.state import Array

DIRECTIONS = 32  # of a circle around an eigenvalue
GROWTHS, HALVINGS = 60, 5  # of its radius, which doubles until it is large enough
EPS = float(np.finfo(float).eps)

Stability = Literal["asymptotically stable", "stable", "centre", "saddle", "unstable", "unknown"]


def eigenvalues(matrix: Array, error: float) -> tuple[Array, Array]:
    """Eigenvalues (n,), and how far those of a matrix at a distance of `error` in the 2-norm can be, (n,).

    A circle around an eigenvalue, on which the smallest singular value of (z I - A) is larger than the error, holds as
    many eigenvalues of every matrix so near to A as of A itself (Trefethen and Embree, Spectra and Pseudospectra, 2005,
    theorem 2.1). That bounds eigenvalues that coincide too, which move by the root of the error. The circle is looked
    at in 32 directions, with a factor of 2 for what lies between them. Sorted by their real parts, the largest first.
    """
    values = np.linalg.eigvals(matrix).astype(complex)
    values = values[np.lexsort((-values.imag, -values.real.round(12)))]
    n = len(values)
    limit = 2.0 * (error + n * EPS * float(np.linalg.norm(matrix, 2))) if n else 0.0
    circle = np.exp(2j * np.pi * np.arange(DIRECTIONS) / DIRECTIONS)

    def free(radii: Array) -> Array:
        """True for each of the radii (n,) whose circles keep the eigenvalues in."""
        z = values[:, None] + radii[:, None] * circle
        smallest = np.linalg.svd(z[..., None, None] * np.eye(n) - matrix, compute_uv=False)[..., -1]
        return np.asarray(smallest.min(axis=1) > limit)

    high = np.full(n, max(limit, 1e-300))
    low = np.zeros(n)
    for _ in range(GROWTHS):
        small = ~free(high)
        if not small.any():
            break
        low[small], high[small] = high[small], 2.0 * high[small]
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        enough = free(middle)
        low, high = np.where(enough, low, middle), np.where(enough, middle, high)
    return values, high


def stability_of(values: Array, errors: Array, mass: Array, derivatives: Array, error: float) -> Stability:
    """The stability of an equilibrium, by eigenvalues and the second-order form M a = -K dq - D dv.

    Where K is symmetric and positive definite and D = 0 exactly, all eigenvalues are imaginary, however they are
    rounded: a centre. With a symmetric part of D that is not negative, energy does not grow: stable.
    """
    nv = len(mass)
    if (values.real > errors).any():
        return "saddle" if (values.real < -errors).any() else "unstable"
    if (values.real < -errors).all():
        return "asymptotically stable"
    if len(derivatives) > nv:  # states of effects: no second-order form
        return "unknown"
    stiffness, damping = -mass @ derivatives[:, :nv], -mass @ derivatives[:, nv : 2 * nv]
    allowed = float(np.linalg.norm(mass, 2)) * error * nv + 8.0 * EPS * float(np.abs(stiffness).max(initial=0.0))
    symmetric = float(np.abs(stiffness - stiffness.T).max(initial=0.0)) <= 2.0 * allowed
    if symmetric and float(np.linalg.eigvalsh(stiffness + stiffness.T).min()) > 2.0 * allowed:
        if not damping.any():
            return "centre"
        if float(np.linalg.eigvalsh(damping + damping.T).min()) >= -2.0 * allowed:
            return "stable"
    return "unknown"


class Controllability(NamedTuple):
    """The number of directions of the state that the inputs reach, with the singular values that decide on it.

    rank: so many. size: of the state. kept: the smallest singular value that counted. dropped: the largest that did
    not. tolerance: between both.
    """

    rank: int
    size: int
    kept: float
    dropped: float
    tolerance: float

    def __str__(self) -> str:
        word = "controllable" if self.rank == self.size else "not controllable"
        return (f"{word}: rank {self.rank} of {self.size} (singular values: smallest kept {self.kept:.2g}, "
                f"largest dropped {self.dropped:.2g}, limit {self.tolerance:.1g})")  # fmt: skip


def controllability(a: Array, b: Array, error: float) -> Controllability:
    """The rank of [B AB A^2 B ...], by orthogonal steps that never form a power of A.

    Each step takes from the directions not yet reached those that the last ones drive, by a singular value
    decomposition (the staircase form: Van Dooren 1981, IEEE Trans. Autom. Control 26, 111-129).
    """
    size = len(a)
    scale = max(float(np.linalg.norm(a, 2)), float(np.linalg.norm(b, 2)) if b.size else 0.0, 1e-300)
    tolerance = size * (error + 8.0 * EPS * scale)
    rank, kept, dropped, a, block = 0, np.inf, 0.0, a.copy(), b
    while rank < size and block.shape[1]:
        u, s, _ = np.linalg.svd(block)
        reached = int((s > tolerance).sum())
        kept = min([kept, *s[:reached]])
        dropped = max([dropped, *s[reached:]])
        rank += reached
        a = u.T @ a @ u
        block, a = a[reached:, :reached], a[reached:, reached:]
    return Controllability(rank, size, float(kept), float(dropped), tolerance)
