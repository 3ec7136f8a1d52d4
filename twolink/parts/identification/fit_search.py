"""The search for parameters by simulation: least squares over z and the starts of later segments."""

import itertools
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg

from twolink.errors import AccuracyError, QueryError, TwolinkError
from twolink.io.progress import Report
from twolink.parts.identification import regression
from twolink.parts.identification.base_parameters import BaseParameters, independent
from twolink.parts.identification.bounded_least_squares import Bounds, Evaluated, StepLimits, least_squares, step_within
from twolink.parts.identification.measured_motion import MeasuredMotion
from twolink.parts.identification.shooting import MultipleShooting, Shot, State, later_starts, segment_ends
from twolink.parts.identification.unknowns import Unknowns

METHODS = ("weighted", "robust")
STANDS_OUT = 3.0  # times its own error bound, from which a derivative counts
WEAK = 1 / 3  # of the noise: a change by 1 of z that moves the measurements by less is not looked for
ROUNDS = 8  # of weights and of what can be told
GAPS = (1.0, 1e-3, 1e-6)  # what gaps may be, in noise, one after the other
CLOSING = 3  # steps that close the gaps
STILL = 0.7  # of the spread: changes from sample to sample that are noise alone
GUESS = 0.1  # of what is measured: the noise at first
SIMULATIONS = 60  # of each solve, at most
_ROUNDING = 1e-12


@dataclass(frozen=True)
class Point:
    """A point of a search: coordinates, starts of later segments, what was simulated there, and the noise (c,).

    shooting: what simulates. converged: whether the least squares ended before they had to.
    """

    shooting: MultipleShooting
    z: np.ndarray
    starts: list[State]
    shot: Shot
    noise: np.ndarray
    converged: bool = False

    def weights(self, robust: bool) -> np.ndarray:
        """Weights (n, c) of the residuals; robust: less for those beyond 1.345 standard deviations."""
        share = regression.HUBER * self.noise / np.maximum(np.abs(self.shot.residuals), 1e-300)
        return np.asarray((np.sqrt(np.minimum(share, 1.0)) if robust else np.ones_like(share)) / self.noise)


@dataclass(frozen=True)
class CondensedProblem:
    """The condensed problem at a point, in the values p of the names.

    residuals (n, c), columns (n, c, k) = d simulated/dp, error (n, k): bound on their errors. possible: what such a
    motion shows; shown: what stands out of the noise too. basis (k, r): the changes of z that are looked for.
    """

    residuals: np.ndarray
    columns: np.ndarray
    error: np.ndarray
    possible: BaseParameters
    shown: BaseParameters
    basis: np.ndarray
    moves: list[np.ndarray]
    alongs: list[np.ndarray]

    @property
    def of_members(self) -> np.ndarray:
        """The columns (n, c, r) of the combinations that are shown."""
        return self.columns[..., list(self.shown.members)]


def linearized(unknowns: Unknowns, point: Point, weights: np.ndarray) -> CondensedProblem:
    """The condensed problem. Raises QueryError where the measurements show nothing."""
    residuals, by_z, moves, alongs = point.shot.condensed()
    values_by_z = unknowns.derivatives(point.z)[0]
    inverse = np.linalg.inv(values_by_z)
    columns = by_z @ inverse
    error = np.concatenate([segment.error_by_z for segment in point.shot.segments]) @ np.abs(inverse)
    k = len(unknowns.names)
    flat = regression.rows_of(columns, weights)
    bound = np.linalg.norm(weights[..., None] * error[:, None], axis=(0, 1))
    bound += point.shooting.accuracy * np.linalg.norm(flat, axis=0)
    flat[:, np.linalg.norm(flat, axis=0) <= STANDS_OUT * bound] = 0.0
    possible = independent(unknowns.names, flat, _diagonal(flat, bound))
    members = list(possible.members)
    weak = WEAK / STANDS_OUT / np.linalg.norm(values_by_z, axis=1)[members]
    lengths = np.linalg.norm(flat[:, members], axis=0)
    own = np.where(lengths > STANDS_OUT * weak, 1.0, 0.0) * flat[:, members]
    shown = possible.within(own, _diagonal(own, np.maximum(weak, bound[members])))
    if not shown.members:
        raise QueryError(f"these measurements do not depend on {', '.join(unknowns.names[:6])}, beyond their noise",
                         argument="parameters", code="nothing-identifiable",
                         remedy="measure a motion that depends on them more, or look for others")  # fmt: skip
    basis = scipy.linalg.null_space((inverse @ shown.null_space).T) if len(shown.members) < k else np.eye(k)
    return CondensedProblem(residuals, columns, error, possible, shown, basis, moves, alongs)


def _diagonal(like: np.ndarray, bound: np.ndarray) -> np.ndarray:
    """Errors (n, k) of columns that are independent of each other and as long as the bounds (k,)."""
    out = np.zeros_like(like)
    np.fill_diagonal(out, bound)
    return out


class LeastSquaresSearch:
    """The search for one measured motion: by least squares in z and the starts of later segments.

    interrupted: Ctrl-C or the end of its time ended it; what it gives then is the best so far. limits: of z.
    """

    def __init__(
        self, unknowns: Unknowns, data: MeasuredMotion, known: np.ndarray | None, method: str, accuracy: float, *,
        limits: tuple[np.ndarray, np.ndarray], patience: float, in_segments: bool = True,
        progress: Report | None = None,
    ) -> None:  # fmt: skip
        values, count = len(data.t) * len(data.channels), len(unknowns.names)
        if values <= count:
            raise QueryError(f"{values} measured values are too few for {count} parameters", argument="measurements",
                             remedy="measure more, or look for fewer parameters", code="too-few-samples")  # fmt: skip
        self.unknowns, self.data, self.known, self.accuracy = unknowns, data, known, accuracy
        self.robust, self.progress, self.interrupted = method == "robust", progress, False
        (self.low, self.high), self.deadline = limits, time.monotonic() + patience
        self.simulations = 1
        self.first: Shot | None = None
        try:
            self.first = MultipleShooting(unknowns, data, [], accuracy)(np.zeros(len(unknowns.names)), [])
        except AccuracyError:  # errors grow too fast for one piece; segments can start where all joints were measured
            if not in_segments or len(data.of_q) < data.robot.nv:
                raise
            return
        q, v = (np.concatenate([getattr(one, name) for one in self.first.segments]) for name in "qv")
        data.require_units(q, v)

    def point_with(self, count: int) -> Point:
        """The point at which the search ends with so many segments."""
        ends = segment_ends(count, self.data)
        shooting = MultipleShooting(self.unknowns, self.data, ends, self.accuracy)
        z, starts = np.zeros(len(self.unknowns.names)), later_starts(ends, self.data, self.first)
        noise = GUESS * self.spread if self.known is None else self.known
        first = shooting(z, starts) if ends or self.first is None else self.first
        point = Point(shooting, z, starts, first, noise)
        for number in range(ROUNDS):
            before, rank = point.noise, 0
            for gap in GAPS if starts and not number else GAPS[-1:]:
                if not self.interrupted:
                    point, rank = self._solved(point, gap)
            now = self.at(point)
            point = replace(point, noise=self.statistics(point, now).noise)
            same = np.allclose(before, point.noise, rtol=0.02, atol=0.0) and len(now.shown.members) == rank
            if self.interrupted or (same and (number or not self.robust)):
                break
        for _ in range(CLOSING if starts and not self.interrupted else 0):
            point = self._closed(point)
        self.simulations += shooting.simulations
        return point

    @property
    def growth(self) -> float:
        """Growth of the start's errors along the scene's own motion; infinite where it could not be simulated."""
        return math.inf if self.first is None else float(np.abs(self.first.segments[0].end_by_start).max(initial=1.0))

    def at(self, point: Point) -> CondensedProblem:
        """The condensed problem there."""
        return linearized(self.unknowns, point, point.weights(self.robust))

    def statistics(self, point: Point, now: CondensedProblem) -> regression.Fit:
        """The step that is left, its covariance, and the noise, which is no smaller than numerical errors."""
        floor = float(np.mean(np.concatenate([segment.error for segment in point.shot.segments])))
        method = "robust" if self.robust else "weighted"
        return regression.fit(now.of_members, now.residuals, method, least=max(floor, 1e-300), sigma=self.known)

    @property
    def spread(self) -> np.ndarray:
        """The standard deviation (c,) of what is measured; for a channel that stands still, that of its kind.

        What stands still but for noise changes from sample to sample as much as over all of them.
        """
        measured = self.data.values
        own = measured.std(axis=0)
        still = np.diff(measured, axis=0).std(axis=0) > STILL * np.sqrt(2.0) * own
        own[still & ~still.all()] = 0.0
        kinds = np.array([name[0] for name in self.data.channels])
        return np.array([x or own[kinds == kind].max() or own.max() for x, kind in zip(own, kinds, strict=True)])

    def _solved(self, point: Point, gap: float) -> tuple[Point, int]:
        """The least squares of residuals and gaps from a point, with its weights; and the number of directions."""
        nx, later = 2 * self.data.robot.nv, len(point.starts)
        weights, now = point.weights(self.robust), self.at(point)
        basis, per_gap = now.basis, 1.0 / (gap * float(point.noise.min()))
        r = basis.shape[1]
        rows = np.concatenate([-weights.ravel(), np.full(nx * later, per_gap)])
        tried = itertools.count(1)

        def moved(u: np.ndarray) -> tuple[np.ndarray, list[State]]:
            return self._moved(point, basis @ u[:r], list(u[r:].reshape(later, nx)))

        def evaluate(u: np.ndarray) -> Evaluated | None:
            shot = point.shot
            if u.any():
                self._report(point, next(tried))
                try:
                    shot = point.shooting(*moved(u))
                except TwolinkError:  # no such motion, or none so accurate: a step too far
                    return None
            residuals = np.concatenate([(shot.residuals * weights).ravel(), (shot.gaps * per_gap).ravel()])
            return Evaluated(residuals, lambda: shot.jacobian(basis) * rows[:, None], shot)

        def limits(u: np.ndarray) -> StepLimits:
            return self._limits(moved(u)[0], basis, nx * later)

        best, shot, converged = least_squares(evaluate, r + nx * later, limits, SIMULATIONS)
        self.interrupted |= converged is None
        z, starts = moved(best)
        return replace(point, z=z, starts=starts, shot=shot, converged=bool(converged)), r

    def _limits(self, z: np.ndarray, basis: np.ndarray, more: int = 0) -> StepLimits:
        """The limits of moves of z along a basis, with `more` unknowns that have no limits."""
        rows, least = np.vstack([basis, -basis]), np.concatenate([self.low - z, z - self.high])
        kept, r = np.isfinite(least), basis.shape[1]

        def cut(u: np.ndarray) -> Bounds:
            values, by_z = self.unknowns.lacking(z + basis @ u[:r])
            by_u = by_z @ basis
            return Bounds(np.pad(by_u, ((0, 0), (0, more))), by_u @ u[:r] - values)

        return StepLimits(Bounds(np.pad(rows[kept], ((0, 0), (0, more))), np.minimum(least[kept], 0.0)), cut)

    def _moved(self, point: Point, dz: np.ndarray, changes: Sequence[np.ndarray]) -> tuple[np.ndarray, list[State]]:
        """z and starts, moved; z within its bounds, which rounding may pass."""
        integrate, nv = self.data.robot.integrate, self.data.robot.nv
        starts = [(np.asarray(integrate(q, change[:nv])), v + change[nv:])
                  for (q, v), change in zip(point.starts, changes, strict=True)]  # fmt: skip
        return np.clip(point.z + dz, self.low, self.high), starts

    def _report(self, point: Point, done: int) -> None:
        """Tell how far a solve from a point is, and end it like Ctrl-C where its time is up."""
        if time.monotonic() > self.deadline:
            raise KeyboardInterrupt
        if self.progress is not None:
            left = float(np.sqrt(np.mean((point.shot.residuals / point.noise) ** 2)))
            pieces = len(point.starts) + 1
            self.progress(done, SIMULATIONS, f"{pieces} segment{'s' * (pieces > 1)}, residuals {left:.3g} x the noise")

    def _closed(self, point: Point) -> Point:
        """A step of the condensed equations, which closes the gaps; the point itself where that fails."""
        now, weights = self.at(point), point.weights(self.robust)
        columns = now.columns @ self.unknowns.derivatives(point.z)[0] @ now.basis
        flat = regression.rows_of(columns, weights)
        undamped = _ROUNDING * np.linalg.norm(flat, axis=0)
        limits = self._limits(point.z, now.basis)
        change = now.basis @ step_within(flat, -(now.residuals * weights).ravel(), undamped, limits)
        moves = [move + along @ change for move, along in zip(now.moves, now.alongs, strict=True)]
        z, starts = self._moved(point, change, moves)
        try:
            shot = point.shooting(z, starts)
        except TwolinkError:
            return point
        closer = np.abs(shot.gaps).max() <= np.abs(point.shot.gaps).max()
        return replace(point, z=z, starts=starts, shot=shot) if closer else point
