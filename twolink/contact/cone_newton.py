"""The contact problem of points that press, stick or slide, as a formula: steps of Newton's method from a guess.

    F(P) = P - proj(P - U / g) = 0,   U = G P + b

The same laws and method as `impulses`, of points that are known to press. A few steps suffice from the impulses of the
step before; whether they did is seen from g F.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from twolink.algorithms.dense_factors import factored, solved
from twolink.algorithms.spatial import Matrix, Scalar, minus, plus, times

STEPS = 5


def newton(g: Matrix, b: Sequence[Scalar], mu: Sequence[float], guess: Sequence[Scalar], xp: Any) -> list[Scalar]:
    """P (3k) of G (3k, 3k) and b (3k), the normal last of each point."""
    size, p = _sizes(g, xp), list(guess)
    for _ in range(STEPS):
        f, slopes = _misses(p, velocities(g, b, p), mu, size, xp)
        jacobian: Matrix = []
        for i, c in enumerate(slopes):
            rows = g[3 * i : 3 * i + 3]
            for j, own in enumerate(c):
                row = [times(plus(*(times(a, r[k]) for a, r in zip(own, rows, strict=True))), 1.0 / size[i])
                       for k in range(len(p))]  # fmt: skip
                for k, entry in enumerate(own):
                    row[3 * i + k] = plus(row[3 * i + k], minus(float(j == k), entry))
                jacobian.append(row)
        p = [minus(a, step) for a, step in zip(p, solved(*factored(jacobian), f), strict=True)]
    return p


def velocities(g: Matrix, b: Sequence[Scalar], p: Sequence[Scalar]) -> list[Scalar]:
    """U (3k)."""
    return [plus(x, *(times(c, y) for c, y in zip(row, p, strict=True))) for x, row in zip(b, g, strict=True)]


def missed(g: Matrix, u: Sequence[Scalar], p: Sequence[Scalar], mu: Sequence[float], xp: Any) -> list[Scalar]:
    """g F (3k), m/s."""
    size = _sizes(g, xp)
    f, _ = _misses(p, u, mu, size, xp)
    return [times(size[i // 3], x) for i, x in enumerate(f)]


def _sizes(g: Matrix, xp: Any) -> list[Scalar]:
    """g of each point: the largest of its diagonal."""
    out = []
    for i in range(0, len(g), 3):
        a, b, c = (g[k][k] for k in range(i, i + 3))
        most = xp.where(xp.less(a, b), b, a)
        out.append(xp.where(xp.less(most, c), c, most))
    return out


def _misses(
    p: Sequence[Scalar], u: Sequence[Scalar], mu: Sequence[float], size: Sequence[Scalar], xp: Any
) -> tuple[list[Scalar], list[Matrix]]:
    """F (3k), and of each point the derivative of proj (3, 3)."""
    f: list[Scalar] = []
    slopes: list[Matrix] = []
    for i, (share, g) in enumerate(zip(mu, size, strict=True)):
        own, speed = p[3 * i : 3 * i + 3], u[3 * i : 3 * i + 3]
        x, y, normal = (a - b / g for a, b in zip(own, speed, strict=True))
        length, limit = xp.sqrt(x * x + y * y), share * normal
        slips = xp.less(limit, length)
        inverse = 1.0 / xp.where(slips, length, 1.0)
        dx, dy, scale = x * inverse, y * inverse, xp.where(slips, limit * inverse, 1.0)
        across = xp.where(slips, -scale * dx * dy, 0.0)
        f += [own[0] - scale * x, own[1] - scale * y, own[2] - normal]
        slopes.append([
            [xp.where(slips, scale * (1.0 - dx * dx), 1.0), across, xp.where(slips, share * dx, 0.0)],
            [across, xp.where(slips, scale * (1.0 - dy * dy), 1.0), xp.where(slips, share * dy, 0.0)],
            [0.0, 0.0, 1.0],
        ])  # fmt: skip
    return f, slopes
