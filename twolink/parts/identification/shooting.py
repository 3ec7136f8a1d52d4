"""Multiple shooting: a motion in segments, each simulated from a start of its own, with what is left at their ends.

    x_i' = f(t, x_i, p) from t_i to t_(i+1),  x_i(t_i) = s_i,   gap_i = x_i(t_(i+1)) - s_(i+1) = 0

The starts s_i of later segments are unknowns beside the parameters (Bock 1983): errors of a start grow over one segment
only. One segment is single shooting. Closing all gaps by the linearised equations leaves the parameters alone
(condensing, Bock and Plitt 1984).
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from twolink.errors import QueryError, SceneError
from twolink.integrate.motion.scene_equations import equations_of, require_no_states
from twolink.parts.identification.filtering import SMALLEST, smooth
from twolink.parts.identification.measured_motion import MeasuredMotion
from twolink.parts.identification.unknowns import Unknowns
from twolink.scenes import Scene
from twolink.simulation.sensitivities import Sensitivities, sensitivities_at

State = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True)
class ShootingInterval:
    """A simulated segment: residuals (m, c), their derivatives by z (m, c, k) and by its start (m, c, 2 nv).

    end: its last state, with derivatives by z (2 nv, k) and by its start (2 nv, 2 nv). error (m,): bound on the error
    of what was simulated, and of its derivatives by z (m, k). q (m, nq), v (m, nv).
    """

    q: np.ndarray
    v: np.ndarray
    residuals: np.ndarray
    by_z: np.ndarray
    by_start: np.ndarray
    end_by_z: np.ndarray
    end_by_start: np.ndarray
    error: np.ndarray
    error_by_z: np.ndarray


@dataclass(frozen=True)
class Shot:
    """All segments with the gaps between them (., 2 nv)."""

    scene: Scene
    segments: list[ShootingInterval]
    gaps: np.ndarray

    @property
    def residuals(self) -> np.ndarray:
        """Measured minus simulated (n, c)."""
        return np.concatenate([segment.residuals for segment in self.segments])

    def jacobian(self, basis: np.ndarray) -> np.ndarray:
        """Derivatives of what is simulated, then of the gaps, by y with dz = basis @ y, then by the starts."""
        later, (nx, k) = len(self.gaps), self.segments[0].end_by_z.shape
        along = [*(segment.by_z.reshape(-1, k) for segment in self.segments),
                 *(segment.end_by_z for segment in self.segments[:later])]  # fmt: skip
        of_values = block_diag(*(segment.by_start.reshape(-1, nx) for segment in self.segments))
        of_gaps = block_diag(*(segment.end_by_start for segment in self.segments))[: nx * later, nx:]
        by_starts = np.vstack([of_values[:, nx:], of_gaps - np.eye(nx * later)])
        return np.hstack([np.vstack([rows @ basis for rows in along]), by_starts])

    def condensed(self) -> tuple[np.ndarray, np.ndarray, list[np.ndarray], list[np.ndarray]]:
        """Residuals (n, c) with closed gaps and their derivatives by z (n, c, k), to first order.

        And the moves of the starts that close the gaps, with their derivatives by z: ds_(i+1) = gap_i + S_i ds_i + P_i
        dz.
        """
        first = self.segments[0]
        nx, k = first.end_by_z.shape
        move, along = np.zeros(nx), np.zeros((nx, k))
        residuals, derivatives, moves, alongs = [], [], [], []
        for number, segment in enumerate(self.segments):
            residuals.append(segment.residuals - segment.by_start @ move)
            derivatives.append(segment.by_z + segment.by_start @ along)
            if number < len(self.gaps):
                move = self.gaps[number] + segment.end_by_start @ move
                along = segment.end_by_z + segment.end_by_start @ along
                moves.append(move)
                alongs.append(along)
        return np.concatenate(residuals), np.concatenate(derivatives), moves, alongs


class MultipleShooting:
    """A measured motion in segments that begin at 0 and after the samples with the numbers `after`."""

    def __init__(self, unknowns: Unknowns, data: MeasuredMotion, after: Sequence[int], accuracy: float) -> None:
        self.unknowns, self.data, self.accuracy = unknowns, data, accuracy
        edges = [0, *(number + 1 for number in after), len(data.t)]
        self.rows = [slice(*pair) for pair in itertools.pairwise(edges)]
        self.begins = [0.0, *(float(data.t[number]) for number in after)]
        self.simulations = 0

    def __call__(self, z: np.ndarray, starts: Sequence[State], accuracy: float | None = None) -> Shot:
        """Simulate all segments. Raises TwolinkError where there is no such scene, or no such motion."""
        scene, robot = self.unknowns.scene_at(z), self.data.robot
        require_no_states(equations_of(scene), "fit")
        by_z = self.unknowns.derivatives(z)[1]
        segments = []
        for number, start in enumerate([(scene.q, scene.v), *starts]):
            segments.append(self._segment(scene, start, number, by_z, accuracy or self.accuracy))
        ends = zip(segments[:-1], starts, strict=True)
        gaps = [np.concatenate([robot.difference(q, one.q[-1]), one.v[-1] - v]) for one, (q, v) in ends]
        self.simulations += len(segments)
        return Shot(scene, segments, np.array(gaps).reshape(len(starts), 2 * robot.nv))

    def _segment(self, scene: Scene, start: State, number: int, by_z: np.ndarray, accuracy: float) -> ShootingInterval:
        """Simulate a segment."""
        begin, rows, unknowns = self.begins[number], self.rows[number], self.unknowns
        # Motions with events have one segment, which no other start leads into; at rest with friction there are none.
        by_start = () if equations_of(scene).has_events else ("q", "v")
        own, wrt = scene, [*unknowns.wrt, *by_start]
        if number:
            own = Scene(scene.base, *start, scene.effects, scene.duration)
            wrt = [*unknowns.wrt[: unknowns.constants], "q", "v"]
        times = self.data.t[rows]
        s = sensitivities_at(own, wrt, np.union1d([begin], times), accuracy, numbers_as_inputs=True)
        if s.run.interrupted:
            raise KeyboardInterrupt
        if s.run.t[-1] < times[-1]:
            raise SceneError(f"the motion ends at t = {s.run.t[-1]:.6g} s, before the last measurement", where="scene",
                             remedy="leave out the effect that ends it, or later measurements")  # fmt: skip
        kept = np.searchsorted(s.run.t, times)
        q, v, by, error = s.run.q[kept], s.run.v[kept], _stacked(s, wrt)[kept], _errors(s, wrt)[kept]
        nx = 2 * scene.robot.nv
        count = by.shape[2] - (nx if by_start else 0)
        along_z = by[:, :, :count] @ by_z[:count]
        along_start = by[:, :, count:] if by_start else np.zeros((len(by), nx, nx))
        return ShootingInterval(
            q, v, self.data.residuals(q, v, rows), self.data.derivatives(q, along_z, rows),
            self.data.derivatives(q, along_start, rows), along_z[-1], along_start[-1],
            np.zeros(len(times)) if s.run.error is None else s.run.error[kept],
            error[:, :count] @ np.abs(by_z[:count]),
        )  # fmt: skip


def _stacked(s: Sensitivities, wrt: Sequence[str]) -> np.ndarray:
    """Derivatives (n, 2 nv, .) of the state by these names."""
    return np.concatenate([np.concatenate([s.q[name], s.v[name]], axis=1) for name in wrt], axis=2)


def _errors(s: Sensitivities, wrt: Sequence[str]) -> np.ndarray:
    """Bounds (n, .) on their errors."""
    return np.concatenate([np.repeat(s.error[name][:, None], s.q[name].shape[2], axis=1) for name in wrt], axis=1)


GROWTH = 30.0  # of errors of a start within a segment
FEWEST = 4  # samples in a segment
UNKNOWN = 50  # samples in a segment, where the growth is not known
TRIED = (1, 4, 16)  # times as many segments, one after the other, until the motion is found


def can_be_cut(scene: Scene) -> bool:
    """True if a motion may be simulated in segments."""
    equations = equations_of(scene)
    return equations.constraints is None and not equations.has_events


def segment_counts(asked: int | None, growth: float, data: MeasuredMotion, scene: Scene) -> list[int]:
    """The numbers of segments to try. growth: of errors of the start along the scene's motion.

    Raises QueryError for a number that cannot be.
    """
    most = max(1, len(data.t) // FEWEST)
    smooth_motion = can_be_cut(scene)
    if asked is not None:
        if isinstance(asked, bool) or not isinstance(asked, int) or not 1 <= asked <= most:
            raise QueryError(f"expected a whole number from 1 to {most}, got {asked!r:.60}", argument="segments",
                             remedy=f"a segment has {FEWEST} samples at least")  # fmt: skip
        if asked > 1 and not smooth_motion:
            raise QueryError("motions with events or closed loops are simulated in one segment", argument="segments",
                             remedy="leave it out", code="one-segment")  # fmt: skip
        return [asked]
    if not smooth_motion:
        return [1]
    if math.isinf(growth):
        first = max(2, len(data.t) // UNKNOWN)
    else:
        first = 1 if growth < GROWTH**2 else math.ceil(math.log(growth) / math.log(GROWTH))
    return list(dict.fromkeys(min(most, first * factor) for factor in TRIED))


def segment_ends(count: int, data: MeasuredMotion) -> list[int]:
    """The numbers of the samples at which segments end, but the last."""
    times = np.linspace(0.0, float(data.t[-1]), count + 1)[1:-1]
    found = np.unique(np.searchsorted(data.t, times))
    return [int(number) for number in found if FEWEST - 1 <= number < len(data.t) - FEWEST]


def later_starts(ends: Sequence[int], data: MeasuredMotion, shot: Shot | None) -> list[State]:
    """States at the ends of segments: measured, filtered and differentiated; else of the first guess."""
    if not ends:
        return []
    robot, q, v = data.robot, data.q, data.v
    if shot is not None:
        q, v = (np.concatenate([getattr(segment, name) for segment in shot.segments]) for name in "qv")
    change = robot.difference(q, data.q)
    change[:, np.setdiff1d(np.arange(robot.nv), data.of_q)] = 0.0
    q = np.asarray(robot.integrate(q, change))
    if len(data.t) >= 2 * SMALLEST + 5:
        positions, velocities, _, half = smooth(robot, data.t, q)
        inner = slice(half, len(q) - half)
        q[inner] = positions
        v = v.copy()
        v[inner, data.of_q] = velocities[:, data.of_q]
    v[:, data.of_v] = data.v[:, data.of_v]
    return [(q[number], v[number]) for number in ends]
