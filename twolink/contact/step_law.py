"""The laws of the points of a step: what touches, when in the step it meets, and by how much it bounces.

Newton's law of impact with friction may add energy (Kane, Levinson: Dynamics, 1985; Stronge, Proc. R. Soc. Lond. A 431
(1990) 169-181). Bodies then bounce by the largest share of their restitution that creates none.
"""

from typing import Any

import numpy as np

from twolink.contact.impulses import ContactProblem, Impulses, solve_impulses
from twolink.contact.joints import Laws, complete
from twolink.contact.steps import STILL, Memory
from twolink.geometry.points import CLOSED, TOUCHING, Points
from twolink.integrate.motion.state import Array

FACE = 4  # points of a pair that come to the contact problem at a time
ROUNDS = 20  # of adding contacts that the others push together
CREATED = 1e-6  # of the energy that impulses take: what counts as created
FELT = 1e-6  # of the largest impulse of an impact: what is passed on
HALVED = 10  # times, of the share of the restitution that is sought
Ending = tuple[Array, Array, Impulses, Array]  # what is active (n,), M^-1 J^T of it, its impulses, and v+ (nv,)


class StepLaw:
    """The laws of the points of a step. before, after: velocities (n, 3) at its begin, and at its end without impulses.

    rests: points at which bodies must not overlap at the end; dry friction has none. late: the time [s] by which
    impulses act before the middle of the step: as the gap is g = g_0 - u s - b s^2 / 2 bodies meet after s with the
    approach u + b s, and what presses after that does so for h - s. share: of the restitution that bodies bounce by.
    sums (n, 3): U- + U+ of an impact but for U at the end of the step. lasting (n, 3): impulses of the forces before.
    heights (n,): that are not followed, m: of bounces that are over before the step is, and by which what does not
    bounce is farther off than what meets first.
    """

    def __init__(self, laws: Laws, points: Points, before: Array, after: Array, h: float, memory: Memory) -> None:
        self.share = 1.0
        self.points, self.before, self.after, self.h = points, before, after, h
        u, b = -before[:, 2], (before[:, 2] - after[:, 2]) / h
        place = np.searchsorted(memory.keys, points.key)
        known, self.stuck, still = np.zeros((3, len(place)), dtype=bool)
        inside = place < len(memory.keys)
        known[inside] = memory.keys[place[inside]] == points.key[inside]
        self.known, kept = known, place[known]
        self.stuck[known], still[known] = memory.stuck[kept], memory.still[kept]
        # Gaps around a ring of bodies, and of a face's corners, ask for motions of which not all are possible.
        face = np.bincount(points.pair[still], minlength=len(laws.names))[points.pair] > 1
        still = still & (face | (points.gap < TOUCHING)) | (points.gap < CLOSED)
        self.hits = ~known & (u > np.maximum(b * h, STILL))
        start = np.maximum(points.gap + 0.5 * h * u, 0.0)
        u = np.where(self.hits, u, 1.0)
        s = np.clip(2.0 * start / (u + np.sqrt(np.maximum(u * u + 2.0 * b * start, 0.0))), 0.0, h)
        left, meets = h - s, u + b * s
        e = laws.restitution[points.pair]
        self.rebound = rebound = e * meets - b * left
        quick = (e > 0.0) & (meets > laws.threshold[points.pair])
        self.bounces = bounces = self.hits & quick & (rebound > 0.0)
        # Bounces lower than steps can follow begin and end within a step, or a step later the point counts as closed:
        # what leaves with w is back after the height w^2 / (2 b).
        w = np.where(
            self.hits, e * meets, np.where(known & (e > 0.0), np.maximum(before[:, 2], -e * before[:, 2]), 0.0)
        )
        low = ~bounces & (w > STILL) & (b > 0.0)
        self.heights = np.where(low, w * w / (2.0 * np.where(low, b, 1.0)), 0.0)
        # What meets later in the step than the first point of its pair does so as if at once.
        least, once = np.full(len(laws.names), np.inf), self.hits & ~bounces
        np.minimum.at(least, points.pair[self.hits], start[self.hits])
        self.heights[once] = np.maximum(self.heights, start - least[points.pair])[once]
        self.sums = before + np.where(bounces, 2.0 * s / h - 1.0, 0.0)[:, None] * (after - before)
        self.given, self.of_joints = h * laws.pressing[points.pair], laws.of_joints[points.pair]
        self.rests = self.given == 0.0
        self.open = np.where(self.hits | still, 0.0, 2.0 / h * np.maximum(points.gap, 0.0))
        pressing = (meets * left + 0.5 * b * left * left) / np.maximum(u + b * h, STILL) - 0.5 * h
        late = np.where(bounces, 0.5 * h - s, np.clip(pressing, -0.5 * h, 0.5 * h))
        self.late = np.where(self.hits, late, 0.0)
        self.guess = np.zeros_like(before)
        self.guess[known] = h * memory.forces[kept]
        self.lasting = self.guess.copy()
        self.slower = laws.friction[points.pair]
        self.mu = np.where(self.stuck, laws.static[points.pair], self.slower)
        self.active = known | self._lowest(points.gap + 0.5 * h * after[:, 2], CLOSED)

    def ends(self, velocities: Array) -> Array:
        """The gaps (n,) at the end of the step."""
        return np.asarray(self.points.gap + 0.5 * self.h * velocities.reshape(-1, 3)[:, 2])

    def blow(self, pressing: Array, p: Array) -> tuple[float, Array, Array] | None:
        """Impacts of a step: their time after its begin, s; the points that they reach, and their impulses (k, 3).

        None where no body hits another. pressing: the numbers of points with impulses p (k, 3).
        """
        hits = self.hits[pressing]
        if not hits.any():
            return None
        blows = p - self.lasting[pressing]
        sizes = np.linalg.norm(blows, axis=1)
        first = pressing[hits][sizes[hits].argmax()]
        felt = ~self.of_joints[pressing] & (sizes > FELT * sizes[hits].max())
        return 0.5 * self.h - float(self.late[first]), pressing[felt], blows[felt]

    def apart(self, pressing: Array) -> float:
        """The longest time between bounces of one pair at points (k,), of the step."""
        bounces = pressing[self.bounces[pressing]]
        spans = [np.ptp(self.late[bounces[self.points.pair[bounces] == pair]]) for pair in
                 np.unique(self.points.pair[bounces])]  # fmt: skip
        return float(max(spans, default=0.0)) / self.h

    def unfollowed(self, rows: Any, response: Array, active: Array, p: Array) -> float:
        """By how much the heights that are not followed would move a joint at most, rad or m.

        The normal impulse that raises a point by a height z moves the joints by M^-1 J_n^T z / G_nn.

        Parameters
        ----------
        rows : ndarray (3n, nv)
            J of the points.
        response : ndarray (nv, 3k)
            M^-1 J^T of the active ones.
        active : ndarray (k,)
        p : ndarray (k, 3)
            Their impulses.
        """
        low = np.flatnonzero((self.heights[active] > 0.0) & (p[:, 2] > 0.0))
        if not len(low):
            return 0.0
        moves = response[:, 3 * low + 2]
        moves = np.asarray(moves.toarray() if hasattr(moves, "toarray") else moves)
        ratio = np.array([(rows[[3 * active[k] + 2]] @ moves[:, [i]]).item() for i, k in enumerate(low.tolist())])
        return float(np.abs(moves * (self.heights[active[low]] / ratio)).max())

    def _lowest(self, ends: Array, limit: float) -> Array:
        """Of each pair the points that end lowest, below a limit: what these hold up needs no impulse of its own."""
        order = np.lexsort((ends, self.points.pair))
        pair = self.points.pair[order]
        rank = np.arange(len(pair)) - np.searchsorted(pair, pair)
        chosen = np.zeros(len(pair), dtype=bool)
        chosen[order[rank < FACE]] = True
        return chosen & (ends < limit)

    def without_gain(self, rows: Any, inverse: Any, free: Array) -> Ending | None:
        """As `solved`, with v+ (nv,): bodies bounce by as much of their restitution as creates no energy."""
        found = self._ending(rows, inverse, free, 1.0)
        if found is None or not self.bounces[found[0]].any() or self._gain(rows, found) <= CREATED:
            return found
        least, most, none = 0.0, 1.0, self._ending(rows, inverse, free, 0.0)
        limit = CREATED if none is None else max(CREATED, self._gain(rows, none))  # contacts that stick have a work too
        if none is None or self._gain(rows, found) <= limit:
            return found
        found = none
        for _ in range(HALVED):
            middle = 0.5 * (least + most)
            other = self._ending(rows, inverse, free, middle)
            if other is None or self._gain(rows, other) > limit:
                most = middle
            else:
                found, least = other, middle
        self.share = least
        return found

    def _ending(self, rows: Any, inverse: Any, free: Array, share: float) -> Ending | None:
        solution = self.solved(rows, inverse, free, share)
        return None if solution is None else (*solution, free + solution[1] @ solution[2].p.ravel())

    def _gain(self, rows: Any, ending: Ending) -> float:
        """The work of the impulses, P . (U- + U+) / 2 when they act, as a share of what they take."""
        active, _, impulses, ends = ending
        sums = self.sums[active] + (rows @ ends).reshape(-1, 3)[active]
        return float((impulses.p * sums).sum() / max(np.abs(impulses.p * self.before[active]).sum(), 1e-300))

    def solved(self, rows: Array, inverse: Array, free: Array, share: float) -> tuple[Array, Array, Impulses] | None:
        """The active points, M^-1 J^T of them, and their impulses; None where the laws are not reached.

        share: of the restitution.
        """
        limits = np.where(self.bounces, -share * self.rebound, self.open)
        for _ in range(ROUNDS):
            active = np.flatnonzero(self.active)
            own = rows[rows_of(active)]
            response = inverse @ own.T
            b = self.after[active].copy()
            b[:, 2] += limits[active]
            matrix = own @ response
            if self.of_joints.any():
                complete(matrix, b, np.flatnonzero(self.of_joints[active]), self.given[active])
            impulses = solve_impulses(ContactProblem(matrix, b, self.mu[active]), self.guess[active])
            if not impulses.solved:
                return None
            self.guess[active] = impulses.p
            slips = (self.mu[active] > self.slower[active]) & (np.hypot(*impulses.u[:, :2].T) > STILL)
            ends = self.ends(rows @ (free + response @ impulses.p.ravel()))
            missed = self._lowest(np.where(self.active, 0.0, ends), -CLOSED)
            if not (slips.any() or missed.any()):
                return active, response, impulses
            self.mu[active[slips]] = self.slower[active[slips]]
            self.active |= missed
        return None


def rows_of(points: Array) -> Array:
    """The numbers of the rows of the Jacobian of some points."""
    return (3 * points[:, None] + np.arange(3)).ravel()
