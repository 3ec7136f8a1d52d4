"""Assembly: states that close a robot's loops, and which of the loops' rows say all there is to say."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from twolink.algorithms.namespaces import Numbers
from twolink.errors import SceneError
from twolink.integrate.constraints import Loops
from twolink.integrate.state import Array

RANK = 1e-9  # singular values below it, relative, are rows that say nothing new
ASSEMBLED = 1e-12
TRIALS = 50
SPREADS = (1e-3, 1e-2, 0.3, 0.3)
WALK, STRIDE = 8, 0.35  # positions on each side, rad or m apart


def assembled(loops: Loops, x: Array) -> Array:
    """The nearest state (size,) that fulfils the constraints.

    Raises SceneError with the residual where there is none near.
    """
    v = x[loops.space.nq :].copy()
    every = range(len(loops.rows(loops.mech, list(x[: loops.space.nq]), Numbers)))
    q, residual = _closed(loops, x[: loops.space.nq], every)
    if not residual <= 100 * ASSEMBLED:
        raise SceneError(f"the loops cannot be closed: {residual:.2e} m or rad is left", where="effects",
                         remedy="check their points and axes, or start nearer to a closed position")  # fmt: skip
    jacobian = loops.numbers(q, every)
    v = v - np.linalg.lstsq(jacobian, jacobian @ v, rcond=RANK)[0]
    return np.concatenate([q, v])


def independent_rows(loops: Loops, q: np.ndarray) -> tuple[list[int], list[float]]:
    """Rows that say all there is to say, here and along the motion, and the size of A's diagonal for each.

    By pivoting, then by exchanging.
    """
    from scipy.linalg import qr

    every = range(len(loops.rows(loops.mech, list(q), Numbers)))
    random = np.random.default_rng(3)
    near = [q, *(pin.integrate(loops.model, q, s * random.standard_normal(loops.space.nv)) for s in SPREADS)]
    places = [_closed(loops, x, every)[0] for x in near]
    found = [loops.numbers(x, every) for x in places]
    largest = np.max([np.abs(j).max(axis=1, initial=0.0) for j in found], axis=0)
    rank = max((_rank(j) for j in found), default=0)
    if rank < (largest > RANK).sum():  # a choice: it must do along the whole motion
        places += _along_motion(loops, q, every, random)
        found = [loops.numbers(x, every) for x in places]
        rank = max(_rank(j) for j in found)
    if not rank:
        return [], []
    full = [j for j in found if _rank(j) == rank]
    chosen = sorted(int(i) for i in qr(full[0].T, pivoting=True, mode="economic")[2][:rank])

    def worst(rows: list[int]) -> float:
        return float(min(np.linalg.svd(j[rows], compute_uv=False)[-1] for j in full))

    others = [i for i in every if largest[i] > RANK]
    best, improved = worst(chosen), len(others) > rank
    while improved:
        trials = [sorted({*chosen} - {i} | {j}) for i in chosen for j in others if j not in chosen]
        tried = max(trials, key=worst)
        improved = worst(tried) > 1.01 * best
        chosen, best = (tried, worst(tried)) if improved else (chosen, best)
    scales = np.max([np.einsum("ij,ji->i", j, np.linalg.solve(_mass(loops, x), j.T))
                     for x, j in zip(places, found, strict=True)], axis=0)  # fmt: skip
    return chosen, (2.0 ** np.round(np.log2(scales[chosen]))).tolist()  # sizes: other starts need no other steps


def _along_motion(loops: Loops, q: np.ndarray, every: Sequence[int], random: np.random.Generator) -> list[np.ndarray]:
    """Closed positions on both sides of q, as the mechanism can move."""
    places = []
    start = random.standard_normal(loops.space.nv)
    for sign in (1.0, -1.0):
        x, way = q, sign * start
        for _ in range(WALK):
            _, s, rows = np.linalg.svd(loops.numbers(x, every))
            free = rows[_count(s) :]
            if not len(free):
                break
            way = free.T @ (free @ way)
            way *= STRIDE / max(1e-300, float(np.abs(way).max()))
            x = _closed(loops, pin.integrate(loops.model, x, way), every)[0]
            places.append(x)
    return places


def _mass(loops: Loops, q: np.ndarray) -> np.ndarray:
    """M(q) of one configuration, by Pinocchio."""
    return np.asarray(pin.crba(loops.model, loops.model.createData(), q))


def _closed(loops: Loops, q: np.ndarray, every: Sequence[int]) -> tuple[np.ndarray, float]:
    """The closed position near q, and what is left of g: by Newton's method, in strides of 0.5 at most."""
    residual = np.inf
    for _ in range(TRIALS):
        g = np.array([float(row) for row in loops.rows(loops.mech, list(q), Numbers)])
        residual = float(np.abs(g).max(initial=0.0))
        if residual <= ASSEMBLED:
            break
        change = np.linalg.lstsq(loops.numbers(q, every), g, rcond=RANK)[0]
        change *= min(1.0, 0.5 / max(1e-300, float(np.abs(change).max())))
        q = pin.integrate(loops.model, q, -change)
    return q, residual


def _rank(jacobian: np.ndarray) -> int:
    return _count(np.linalg.svd(jacobian, compute_uv=False))


def _count(sizes: np.ndarray) -> int:
    """How many singular values are not 0."""
    return int((sizes > RANK**0.5 * max(1e-300, sizes[0])).sum()) if sizes.size else 0
