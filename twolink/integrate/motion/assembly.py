"""Assembly: states that close a robot's loops, and constraint rows that are independent along the motion."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin

from twolink.algorithms.motion import KinematicState
from twolink.algorithms.namespaces import Numbers
from twolink.errors import SceneError
from twolink.integrate.motion.constraints import Constraints
from twolink.integrate.motion.state import Array

RANK = 1e-9  # relative: singular values below it belong to redundant rows
ASSEMBLED = 1e-12  # m or rad
TRIALS = 50  # of Newton's method
SPREADS = (1e-3, 1e-2, 0.3, 0.3)  # of random configurations near the start at which the rank is taken
SAME_SHARE = 1e-8  # a difference of shares at two positions below it is rounding
BESIDE_CONTACTS = 1e-2  # of both distances where bodies touch: farther away other sides of theirs do
PLACES, STRIDE = 8, 0.35  # closed positions on each side of the start, rad or m apart
HELD = 1e-6  # relative: what is left of a row beside held joints and other rows; below it the row is redundant
BETTER = 1.01  # how much larger the smallest singular value must become for an exchange of rows


def assembled(constraints: Constraints, x: Array) -> Array:
    """The nearest state (nq + nv,) that fulfils the constraints; what is behind it stays.

    Raises SceneError where there is none near, with the residual, or where it is not the one that is meant.
    """
    nq, v_rows = constraints.space.nq, constraints.space.v_rows
    (q,), (residual,) = _closed(constraints, x[None, :nq])
    if not residual <= 100 * ASSEMBLED:
        raise SceneError(f"the loops cannot be closed: {residual:.2e} m or rad is left", where="effects",
                         remedy="check their points and axes, or start nearer to a closed position",
                         code="loops-open", residual=float(residual))  # fmt: skip
    motion = KinematicState(constraints.model, constraints.mech, q.tolist(), [0.0] * constraints.space.nv, 0.0, Numbers)
    for loop in constraints.loops:
        loop.require_closed(motion)
    jacobian = constraints.jacobian_at(q, constraints.all_rows)
    v = x[v_rows] - np.linalg.lstsq(jacobian, jacobian @ x[v_rows], rcond=RANK)[0]
    return np.concatenate([q, v, x[v_rows.stop :]])


@np.errstate(all="ignore")
def independent(constraints: Constraints, q: np.ndarray) -> Constraints | None:
    """The constraints without redundant rows, here and along the motion; None where no row constrains anything."""
    random, model = np.random.default_rng(3), constraints.model
    far = BESIDE_CONTACTS if constraints.touching else 1.0
    near = [q, *(pin.integrate(model, q, far * s * random.standard_normal(constraints.space.nv))
                 for s in SPREADS)]  # fmt: skip
    places, jacobians = _with_rows(constraints, list(_closed(constraints, np.array(near))[0]))
    used = np.flatnonzero(np.max([np.abs(j).max(axis=1, initial=0.0) for j in jacobians], axis=0) > RANK)
    rank = max(_rank(j) for j in jacobians)
    if rank < len(used):  # rows must be chosen: the choice must do along the whole motion
        places, jacobians = _with_rows(constraints, places + _along_motion(constraints, q, random, far * STRIDE))
        rank = max(_rank(j) for j in jacobians)
    if not rank:
        return None
    kept = _chosen([j for j in jacobians if _rank(j) == rank], rank, used)
    diagonals = [np.einsum("ij,ji->i", j, np.linalg.solve(pin.crba(model, model.createData(), x), j.T))
                 for x, j in zip(places, jacobians, strict=True)]  # fmt: skip
    # Powers of two are exact, and equal for other starts, so that compiled steps serve them too.
    scales = 2.0 ** np.round(-0.5 * np.log2(np.max(diagonals, axis=0)[kept]))
    shares = _shares(jacobians, kept) if rank < len(used) else None
    return replace(constraints, kept=tuple(kept), scales=tuple(scales.tolist()), shares=shares)


def independent_rows(constraints: Constraints, q: np.ndarray, free: np.ndarray) -> list[int]:
    """The kept rows of loops, and those of contacts that are independent of the rows before them.

    free: 0 for degrees of freedom that are held, 1 for the others.
    """
    chosen, basis = list[int](), np.empty((0, len(free)))
    loops = sum(count for loop, count in zip(constraints.loops, constraints.counts, strict=True) if not loop.touches)
    for i, row in zip(constraints.kept, constraints.jacobian_at(q, constraints.kept), strict=True):
        left = row * free
        for _ in range(2):
            left = left - basis.T @ (basis @ left)
        new = np.linalg.norm(left) > HELD * np.linalg.norm(row)
        if new:
            basis = np.vstack([basis, left / np.linalg.norm(left)])
        if new or i < loops:
            chosen.append(i)
    return chosen


def _with_rows(constraints: Constraints, places: Sequence[Array]) -> tuple[list[Array], list[Array]]:
    """The positions at which the rows exist, and the rows: bodies that overlap deeply have no normal."""
    finite = np.array([q for q in places if np.isfinite(q).all()]).reshape(-1, constraints.space.nq)
    rows = constraints.jacobians_at(finite, constraints.all_rows)
    there = np.isfinite(rows).all(axis=(1, 2))
    return list(finite[there]), list(rows[there])


def _shares(jacobians: Sequence[np.ndarray], kept: list[int]) -> tuple[tuple[float, ...], ...] | None:
    """Shares of each row in the kept multipliers, as the smallest ones; None where they depend on the position.

    With J = C J_kept they are S = C (C^T C)^-1: then J^T S = J_kept^T.
    """
    ways = [np.linalg.lstsq(j[kept].T, j.T, rcond=None)[0].T for j in jacobians]
    if any(np.abs(way - ways[0]).max() > SAME_SHARE for way in ways):
        return None
    exact = np.where(np.abs(ways[0]) < SAME_SHARE, 0.0, ways[0])
    shares = np.linalg.solve(exact.T @ exact, exact.T).T
    # Rounded, they are equal for other starts, so that compiled steps serve them too.
    return tuple(tuple(float(x) for x in row) for row in np.round(shares, 12))


def _chosen(jacobians: Sequence[np.ndarray], rank: int, used: np.ndarray) -> list[int]:
    """`rank` rows whose smallest singular value over all places is large: by QR with pivoting, then by exchanges."""

    def smallest(rows: list[int]) -> float:
        return float(min(np.linalg.svd(j[rows], compute_uv=False)[-1] for j in jacobians))

    chosen = sorted(_pivots(jacobians[0], rank))
    best, improved = smallest(chosen), len(used) > rank
    while improved:
        others = [int(j) for j in used if j not in chosen]
        trial = max((sorted({*chosen} - {i} | {j}) for i in chosen for j in others), key=smallest)
        improved = smallest(trial) > BETTER * best
        chosen, best = (trial, smallest(trial)) if improved else (chosen, best)
    return chosen


def _pivots(matrix: np.ndarray, rank: int) -> list[int]:
    """The rows that QR with pivoting takes: the longest, then the longest beside those taken (SciPy imports 0.15 s)."""
    left, chosen = matrix.copy(), list[int]()
    for _ in range(rank):
        lengths = np.linalg.norm(left, axis=1)
        lengths[chosen] = -1.0
        chosen.append(int(np.argmax(lengths)))
        unit = left[chosen[-1]] / max(1e-300, lengths[chosen[-1]])
        left -= np.outer(left @ unit, unit)
    return chosen


def _along_motion(constraints: Constraints, q: np.ndarray, random: np.random.Generator, stride: float) -> list[Array]:
    """Closed positions on both sides of q, as the mechanism can move, a stride apart."""
    start = random.standard_normal(constraints.space.nv)
    x, direction, going = np.stack([q, q]), np.stack([start, -start]), [0, 1]
    places: tuple[list[Array], list[Array]] = ([], [])
    for _ in range(PLACES):
        for side, jacobian in zip(tuple(going), constraints.jacobians_at(x[going], constraints.all_rows), strict=True):
            _, s, rows = np.linalg.svd(jacobian)
            free = rows[_count(s) :]
            if not len(free):
                going.remove(side)
                continue
            direction[side] = free.T @ (free @ direction[side])
            direction[side] *= stride / max(1e-300, float(np.abs(direction[side]).max()))
            x[side] = pin.integrate(constraints.model, x[side], direction[side])
        x[going] = _closed(constraints, x[going])[0]
        going = [side for side in going if np.isfinite(x[side]).all()]
        for side in going:
            places[side].append(x[side].copy())
        if not going:
            break
    return [*places[0], *places[1]]


def _closed(constraints: Constraints, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The closed positions near q (n, nq) and what is left (n,), by Newton's method in strides of 0.5 at most."""
    q, residual, active = q.copy(), np.full(len(q), np.inf), np.arange(len(q))
    for _ in range(TRIALS):
        found = constraints.residuals(constraints.mech, list(q[active].T), Numbers)
        g = np.array([np.broadcast_to(np.asarray(row, dtype=float), len(active)) for row in found]).T
        residual[active] = np.abs(g).max(axis=1, initial=0.0)
        open_ = ~(residual[active] <= ASSEMBLED)
        active, g = active[open_], g[open_]
        if not len(active):
            break
        jacobians = constraints.jacobians_at(q[active], constraints.all_rows)
        good = np.isfinite(jacobians).all(axis=(1, 2)) & np.isfinite(residual[active])
        q[active[~good]], residual[active[~good]] = np.nan, np.inf
        active = active[good]
        for i, jacobian, row in zip(active.tolist(), jacobians[good], g[good], strict=True):
            change = np.linalg.lstsq(jacobian, row, rcond=RANK)[0]
            change *= min(1.0, 0.5 / max(1e-300, float(np.abs(change).max())))
            q[i] = pin.integrate(constraints.model, q[i], -change)
    return q, residual


def _rank(jacobian: np.ndarray) -> int:
    return _count(np.linalg.svd(jacobian, compute_uv=False))


def _count(sizes: np.ndarray) -> int:
    """The number of singular values that are not 0."""
    return int((sizes > RANK**0.5 * max(1e-300, sizes[0])).sum()) if sizes.size else 0
