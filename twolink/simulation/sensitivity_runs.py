"""Derivatives along a run, and their distance to those along second solutions."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from twolink.integrate.derivatives.variational_legs import Leg
from twolink.integrate.motion.equations import Equations
from twolink.simulation.error_bar import DISTURBED, ENOUGH
from twolink.simulation.nominal_solutions import NominalSolution, NominalSolutions, Second, bound
from twolink.simulation.sensitivity_names import Wanted
from twolink.simulation.trajectory import Trajectory

INTERPOLATED = 1 / 64  # of an interpolation's error, what is left of it with twice the nodes: 1 / 4096 by its order
# Of the distance, where the derivatives are those along the finer solution: their steps are halved, of order 8, and
# its motion is 10 times or more as accurate, so that a tenth of the distance would do.
OF_FINER = 0.25
SMALLER = 100.0  # tolerance of the steps along a second solution of other segments
Piece = tuple[Leg, np.ndarray]  # with S (m, tangent + p, k) at its times


class SensitivityRun:
    """The derivatives along a run, with steps to a tolerance.

    Attributes: t (m,), the times between steps; distance (m, k), of each column to second solutions, times a factor of
    safety; s (n, 2 nv, k), at the samples of the run.
    """

    def __init__(
        self, run: Trajectory, equations: Equations, wanted: Wanted, tolerance: float, accuracy: float
    ) -> None:
        self.run, self.wanted, self.tolerance = run, wanted, tolerance
        self._little = ENOUGH * accuracy  # rounding for which one disturbed solution tells enough
        self._compared = 2 * equations.space.nv  # rows of q and v, not those of states of effects
        self._nominals = NominalSolutions(run, equations, wanted)
        self._nominal = nominal = self._nominals.first
        pieces = self._along(nominal, tolerance)
        self.t = np.concatenate([leg.t for leg, _ in pieces])
        self._fine: list[Piece] = []
        self.distance = self._distance(pieces)
        s = _at(pieces, run.t) if nominal.jumps else _at(self._fine, run.t, interpolating=True)
        self.s = s[:, : self._compared]

    def _along(self, nominal: NominalSolution, tolerance: float) -> list[Piece]:
        """The legs with S."""
        legs = self._nominals.legs(nominal, self._nominals.times(nominal), tolerance)
        return list(self._nominals.along(nominal, legs))

    def _distance(self, pieces: Sequence[Piece]) -> np.ndarray:
        """The largest distance to second solutions of each column at the times of all legs, (m, k), times a factor."""
        distances = list[np.ndarray]()
        for one in self._nominals.second_ones():
            distances.append(self._distance_to(pieces, one))
            if len(distances) == 2 and not self._nominal.jumps:
                finer, disturbed = (one.max(axis=0) for one in distances)
                if (DISTURBED[1] * disturbed <= np.maximum(self._little, OF_FINER * finer)).all():
                    break
        return bound(distances, 1.0 if self._nominal.jumps else OF_FINER)

    def _distance_to(self, pieces: Sequence[Piece], second: Second) -> np.ndarray:
        """The distance to one second solution."""
        nominal = self._nominals.second([leg for leg, _ in pieces], second)
        out, rows, paired = [], self._compared, self._nominals.paired(nominal)
        beside = (self._nominals.beside(leg, nominal, number) for number, (leg, _) in enumerate(pieces[:paired]))
        others = self._nominals.along(nominal, beside)
        for (leg, coarse), (other, s) in zip(pieces[:paired], others, strict=True):
            out.append(np.abs(s[:: second.parts, :rows] - coarse[:, :rows]).max(axis=1))
            if not nominal.jumps and second.parts > 1:
                between = np.abs(s[1::2, :rows] - leg.at(other.t[1::2], coarse, interpolating=True)[:, :rows])
                between = between.max(axis=1)
                out[-1][1:] = np.maximum(out[-1][1:], INTERPOLATED * between)
                self._fine.append((other, s))
        if paired < len(pieces):
            out.append(self._distance_in_time(pieces[paired:], nominal))
        return np.concatenate(out)

    def _distance_in_time(self, pieces: Sequence[Piece], nominal: NominalSolution) -> np.ndarray:
        """The distance to a second solution that follows bounces farther, at the times of the legs.

        Not at events, nor while only one of the two follows bounces: there velocities differ by what an impact changes.
        """
        times = np.concatenate([leg.t for leg, _ in pieces])
        other = _at(self._along(nominal, self.tolerance / SMALLER), times)
        own = np.concatenate([s for _, s in pieces])
        distance = np.abs(other - own[:, : other.shape[1]])[:, : self._compared].max(axis=1)
        for jump in (*self._nominal.jumps[:-1], *nominal.jumps[:-1]):
            distance[(times == jump.before.t) | ((times > jump.before.t) & (times < jump.rest))] = 0.0
        return np.asarray(distance)


def _at(pieces: Sequence[Piece], samples: np.ndarray, *, interpolating: bool = False) -> np.ndarray:
    """S (n, tangent, k) at sample times (n,), increasing."""
    segment = _segments([leg for leg, _ in pieces], samples)
    return np.concatenate([leg.at(samples[segment == number], s, interpolating=interpolating)
                           for number, (leg, s) in enumerate(pieces)])  # fmt: skip


def _segments(legs: Sequence[Leg], samples: np.ndarray) -> np.ndarray:
    """The numbers (n,) of the legs that times (n,) are in."""
    return np.maximum(np.searchsorted([leg.t[0] for leg in legs], samples, side="right") - 1, 0)


def along_solutions(
    run: Trajectory, equations: Equations, wanted: Wanted, tolerance: float, samples: np.ndarray
) -> list[tuple[NominalSolution, np.ndarray]]:
    """The solution of a run and second ones, each with S (n, tangent, k) at some samples of the run, else 0.

    samples: their numbers (m,). Raises AccuracyError where a second solution has other segments.
    """
    own = NominalSolutions(run, equations, wanted)
    times = np.union1d(own.times(own.first), run.t[samples])
    legs = list(own.legs(own.first, times, tolerance))
    segment, found = _segments(legs, run.t[samples]), list[tuple[NominalSolution, np.ndarray]]()
    for nominal in [own.first, *(own.second(legs, one, run.t) for one in own.second_ones())]:
        own.require_alike(nominal)
        out = np.zeros((len(run.t), equations.space.tangent, wanted.start.shape[1]))
        beside = [own.beside(leg, nominal, number) for number, leg in enumerate(legs)] if found else legs
        for number, (leg, (_, s)) in enumerate(zip(legs, own.along(nominal, beside), strict=True)):
            here = samples[segment == number]
            out[here] = s[nominal.second.parts * np.searchsorted(leg.t, run.t[here]), : out.shape[1]]
        found.append((nominal, out))
    return found


def with_states(run: Trajectory, nominal: NominalSolution) -> Trajectory:
    """The run with the states of a second solution at its samples."""
    x, space = nominal.dense.states(np.minimum(run.t, nominal.edges[-1][1])), nominal.dense.segments[0].equations.space
    q, v = space.rows(x)
    states = dict(zip(space.states, x[space.z_rows], strict=True))
    return replace(run, q=q, v=v, states=states, error=None, precise=None, recorded_energy=None, solution=nominal.dense)
