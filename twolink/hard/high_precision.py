"""References by other equations and more digits than the runs they judge: `python -m twolink.hard.high_precision`.

Two rods: the hand-derived Lagrangian equations in numbers of 200 bits. Free bodies: Euler's equations with a quaternion
in 200 bits. Chains: the planar equations in absolute angles in long double, by extrapolation (order 14) with two step
sizes. None of them uses a URDF, Pinocchio or a recursion. The results are in references.json.
"""

import functools
import json
import sys
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy.linalg import lu_factor, lu_solve

from twolink.hard.truths import REFERENCES

BITS = 200
G = 9.81


def two_rods(masses: Sequence[float], theta0: Sequence[float], times: Sequence[float]) -> list[list[str]]:
    """theta1 (from the horizontal) and theta2 of rods of 1 m at the times [s]; released at rest under gravity."""
    import heyoka as hy

    from twolink.lagrange import formulas

    def exact(value: float) -> Any:
        return hy.expression(hy.real(float(value), BITS))

    theta, rate = hy.make_vars("a", "b"), np.array(hy.make_vars("c", "d"))
    sizes, kilos = (exact(1), exact(1)), (exact(masses[0]), exact(masses[1]))
    a, b, c, d = (np.array(entries, dtype=object) for entries in (
        formulas.mass_entries(sizes, kilos, theta, hy), formulas.product_entries(sizes, kilos, theta, hy),
        formulas.square_entries(sizes, kilos, theta, hy, "corrected"),
        formulas.gravity_entries(sizes, kilos, exact(G), theta, hy),
    ))  # fmt: skip
    torque = -(b.sum(axis=1) * rate[0] * rate[1] + c @ rate**2 + d)
    inverse = np.array([[a[1, 1], -a[0, 1]], [-a[1, 0], a[0, 0]]]) / (a[0, 0] * a[1, 1] - a[0, 1] * a[1, 0])
    system = [*zip(theta, rate, strict=True), *zip(rate, inverse @ torque, strict=True)]
    return _solved(system, [*theta0, 0.0, 0.0], times, 2)


def free_body(moments: Sequence[float], spin: Sequence[float], times: Sequence[float]) -> list[list[str]]:
    """Position (0, 0, 0) and quaternion (x, y, z, w) of a free body, by Euler's equations."""
    import heyoka as hy

    w, p = np.array(hy.make_vars("w1", "w2", "w3")), np.array(hy.make_vars("x", "y", "z"))
    s, half = hy.make_vars("s"), hy.expression(hy.real(0.5, BITS))
    i = np.array([hy.expression(hy.real(float(m), BITS)) for m in moments])
    rates = [*(np.cross(i * w, w) / i), *(half * (s * w + np.cross(p, w))), -half * (p @ w)]
    system = list(zip([*w, *p, s], rates, strict=True))
    rows = _solved(system, [*spin, 0.0, 0.0, 0.0, 1.0], times, 7)
    return [["0", "0", "0", *row[3:]] for row in rows]


def _solved(system: Any, start: Sequence[float], times: Sequence[float], count: int) -> list[list[str]]:
    import heyoka as hy

    state = [hy.real(float(x), BITS) for x in start]
    ta = hy.taylor_adaptive(system, state, fp_type=hy.real, prec=BITS, tol=hy.real(1e-45, BITS), compact_mode=True)
    out = []
    for t in times:  # from exactly symmetric rest the last coefficients may vanish: hence the longest step
        ta.propagate_until(hy.real(float(t), BITS), max_delta_t=hy.real(0.05, BITS))
        out.append([_digits(x) for x in ta.state[:count]])
    return out


def _digits(value: Any) -> str:
    digits, _, power = str(value).partition("e")
    return f"{digits[:27]}e{power}" if power else digits[:27]


def planar_chain(masses: Sequence[float], angle: float, end: float, steps: int, samples: int) -> np.ndarray:
    """q (samples + 1, n) of n uniform rods of 1 m, straight and at rest at `angle` from hanging, in long double.

    Absolute angles th from hanging: sum_j M_ij cos(th_i - th_j) th_j'' + M_ij sin(th_i - th_j) th_j'^2 + g_i sin th_i
    = 0, with M_ij = m_k l_i l_j sums. q: the first is th_1, the others are relative.
    """
    n, real = len(masses), np.longdouble
    m = np.array(masses, real)
    beyond = np.concatenate([np.cumsum(m[::-1])[::-1][1:], [real(0)]])  # the mass that each rod's end carries
    later = np.maximum.outer(np.arange(n), np.arange(n))
    coupling = (m / 2 + beyond)[later]
    coupling[np.arange(n), np.arange(n)] = m / 3 + beyond
    weight = real(G) * (m / 2 + beyond)

    def rate(x: np.ndarray) -> np.ndarray:
        th, w = x[:n], x[n:]
        off = th[:, None] - th
        right = -(coupling * np.sin(off)) @ (w * w) - weight * np.sin(th)
        return np.concatenate([w, _solve(coupling * np.cos(off), right)])

    x = np.concatenate([np.full(n, real(angle)), np.zeros(n, real)])
    out, h = [x[:n].copy()], real(end) / steps
    for k in range(1, steps + 1):
        x = _step(rate, x, h)
        if k % (steps // samples) == 0:
            out.append(x[:n].copy())
    th = np.array(out)
    return np.concatenate([th[:, :1], np.diff(th, axis=1)], axis=1)


def _solve(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Refined in long double from LAPACK's factors in double: each pass gains 6 digits or more up to condition 1e10."""
    factors, x = lu_factor(matrix.astype(float)), np.zeros_like(right)
    for _ in range(5):
        x += lu_solve(factors, (right - matrix @ x).astype(float))
    return x


def _step(rate: Any, x: np.ndarray, h: Any) -> np.ndarray:
    """One step of Gragg's extrapolated midpoint rule, order 14: its coefficients are whole numbers in any precision."""
    table: list[np.ndarray] = []
    sizes = (2, 4, 6, 8, 10, 12, 14)
    for j, n in enumerate(sizes):
        s = h / n
        before, now = x, x + s * rate(x)
        for _ in range(n - 1):
            before, now = now, before + 2 * s * rate(now)
        row = [(before + now + s * rate(now)) / 2]
        for k in range(1, j + 1):
            ratio = (np.longdouble(n) / sizes[j - k]) ** 2
            row.append(row[k - 1] + (row[k - 1] - table[j - 1][k - 1]) / (ratio - 1))
        table.append(row)  # type: ignore[arg-type]
    return np.asarray(table[-1][-1])


BOX = (0.8083333333333335, 0.6833333333333335, 0.1416666666666667)
CHAINS = (
    ("chain-10", [1.0] * 10, 0.5),
    ("chain-50", [1.0] * 50, 0.5),
    ("chain-100", [1.0] * 100, 0.5),
    ("chain-200", [1.0] * 200, 0.5),
    ("chain-outward", [10.0**k for k in range(10)], 0.5),
    ("chain-inward", [10.0**-k for k in range(10)], 0.5),
)


def main(names: Sequence[str]) -> None:
    """Compute the references named, or all, and write them into the file."""
    stored: dict[str, Any] = json.loads(REFERENCES.read_text(encoding="utf-8"))
    references: dict[str, tuple[list[float], Callable[[list[float]], Any]]] = {
        "arm-swing": (_times(1.0, 10), functools.partial(two_rods, (3, 1), (0, 0))),
        "chaos": (_times(0.5, 60), functools.partial(two_rods, (1, 1), (0, 0))),
        "light-tip": (_times(1.0, 5), functools.partial(two_rods, (1, 1e-9), (0.3, -0.5))),
        "heavy-tip": (_times(1.0, 5), functools.partial(two_rods, (1e-9, 1), (0.3, -0.5))),
        "dzhanibekov": (_times(5.0, 20), functools.partial(free_body, BOX, (0.1, 5.0, 0.1))),
    }
    for name, masses, angle in CHAINS:
        references[name] = (_times(0.1, 10), functools.partial(_chain, name, masses, angle))
    for name in names or references:
        times, compute = references[name]
        stored[name] = {"t": times, "q": compute(times)}
        REFERENCES.write_text(json.dumps(stored, indent=0) + "\n", encoding="utf-8")


def _times(interval: float, count: int) -> list[float]:
    return [interval * k for k in range(1, count + 1)]


def _chain(name: str, masses: Sequence[float], angle: float, times: Sequence[float]) -> list[list[str]]:
    sizes = (200, 300) if len(masses) <= 100 else (50, 80)  # long double is slow
    if masses[-1] > masses[0]:  # light links that hold heavy ones oscillate at 1e5 rad/s
        sizes = (30_000, 40_000)
    coarse, fine = (planar_chain(masses, angle, times[-1], steps, len(times)) for steps in sizes)
    print(f"{name}: two step sizes differ by {float(np.abs(coarse - fine).max()):.1e}", flush=True)
    return [[str(x) for x in row] for row in fine[1:]]


if __name__ == "__main__":
    main(sys.argv[1:])
