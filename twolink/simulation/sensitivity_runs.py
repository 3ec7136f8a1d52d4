"""Derivatives along a run, and their distance to those along second solutions."""

from collections.abc import Sequence

import numpy as np

from twolink.integrate.equations import Equations
from twolink.integrate.method_choice import MethodChoice
from twolink.integrate.perturbation import Perturbation
from twolink.integrate.variational_legs import Leg
from twolink.simulation.error_bar import SAFETY, SAFETY_OF_SEVERAL
from twolink.simulation.nominal_solutions import NominalSolution, NominalSolutions
from twolink.simulation.sensitivity_names import Wanted
from twolink.simulation.trajectory import Trajectory

INTERPOLATED = 1 / 64  # of an interpolation's error, what is left of it with twice the nodes: 1 / 4096 by its order
# Of the distance, where the derivatives are those along the second solution: their steps are halved, of order 8, and
# its motion is 10 times or more as accurate, so that a tenth of the distance would do. Not so where the motions differ
# by where the second one starts: then it is as far off as the distance says.
OF_FINER, BY_START = 0.25, 0.1
SMALLER = 100.0  # tolerance of the steps along a second solution of other pieces


class SensitivityRun:
    """The derivatives along a run, with steps to a tolerance.

    Attributes: t (m,), the times between steps; distance (m, k), of each column to second solutions, times a factor of
    safety; s (n, 2 nv, k), at the samples of the run.
    """

    def __init__(
        self, run: Trajectory, equations: Equations, wanted: Wanted, accuracy: float, tolerance: float
    ) -> None:
        self.run, self.wanted, self.tolerance, self._rows = run, wanted, tolerance, 2 * equations.space.nv
        self._nominals = NominalSolutions(run, equations, wanted.neighbours, accuracy, tolerance)
        self._nominal = nominal = self._nominals.first
        self.s, legs, states = self._along(nominal, run.t if nominal.jumps else run.t[:0], tolerance)
        self.t = np.concatenate([leg.t for leg in legs])
        self._fine: list[tuple[Leg, np.ndarray]] = []
        self.distance = self._distance(legs, states)
        if not nominal.jumps:
            self.s = self._interpolated(run.t)

    def _start(self, nominal: NominalSolution) -> np.ndarray:
        """S at the start."""
        start = self.wanted.start
        return start if nominal.begun is None else self._nominals.saltation.start(nominal.begun, start)

    def _after(self, nominal: NominalSolution, number: int, s: np.ndarray) -> np.ndarray:
        """S after the end of a piece."""
        if not nominal.jumps or number + 1 == len(nominal.edges):
            return s
        return self._nominals.saltation(nominal.jumps[number], s)

    def _along(
        self, nominal: NominalSolution, samples: np.ndarray, tolerance: float
    ) -> tuple[np.ndarray, list[Leg], list[np.ndarray]]:
        """S at sample times (n,), the legs, and S (., 2 nv + p, k) at their times."""
        start, times = self._start(nominal), self._nominals.times(nominal)
        legs, states, out = list[Leg](), list[np.ndarray](), np.empty((len(samples), self._rows, start.shape[1]))
        piece = np.maximum(np.searchsorted([begin for begin, _ in nominal.edges], samples, side="right") - 1, 0)
        for number in range(len(nominal.edges)):
            leg = self._nominals.leg(nominal, number, times, tolerance)
            s = leg.along(start)
            here = piece == number
            out[here] = leg.at(samples[here], s)
            legs.append(leg)
            states.append(s)
            start = self._after(nominal, number, s[-1])
        return out, legs, states

    def _distance(self, legs: Sequence[Leg], states: Sequence[np.ndarray]) -> np.ndarray:
        """The largest distance to second solutions of each column at the times of all legs, (m, k), times a factor."""
        choice, perturbations = self._nominals.second_ones()
        distances = [self._distance_to(legs, states, choice, one) for one in perturbations]
        safety: float | np.ndarray = SAFETY if len(distances) == 1 else SAFETY_OF_SEVERAL
        if len(distances) == 1 and not self._nominal.jumps:
            safety = SAFETY * np.where(self._differs_by_start(legs, perturbations[0]), 1.0, OF_FINER)[:, None]
        return np.asarray(safety * np.max(distances, axis=0))

    def _differs_by_start(self, legs: Sequence[Leg], perturbation: Perturbation) -> np.ndarray:
        """Whether the first of the second solutions differs from the run as its start does, at the times of all legs.

        The shift of the start is followed along the run's own derivatives.
        """
        rows, out = self._rows, []
        moved = (
            np.eye(legs[0].matrices.shape[2], rows) * perturbation.start_shift * max(1.0, np.abs(legs[0].x[:, 0]).max())
        )
        for leg, (fine, _) in zip(legs, self._fine, strict=False):
            along = leg.along(moved)
            off = np.abs(fine.x[:, ::2] - leg.x).max(axis=0)
            out.append(np.abs(along[:, :rows]).sum(axis=2).max(axis=1) > BY_START * off)
            moved = along[-1]
        return np.concatenate(out)

    def _distance_to(
        self, legs: Sequence[Leg], states: Sequence[np.ndarray], choice: MethodChoice, perturbation: Perturbation
    ) -> np.ndarray:
        """The distance to one second solution."""
        nominal = self._nominals.second(legs, choice, perturbation)
        out, start, rows, paired = [], self._start(nominal), self._rows, self._nominals.paired(nominal)
        for number, (leg, coarse) in enumerate(zip(legs[:paired], states[:paired], strict=True)):
            fine = self._nominals.halved(leg, nominal, number)
            s = fine.along(start)
            out.append(np.abs(s[::2, :rows] - coarse[:, :rows]).max(axis=1))
            if not nominal.jumps:
                between = np.abs(s[1::2, :rows] - leg.at(fine.t[1::2], coarse, interpolating=True)).max(axis=1)
                out[-1][1:] = np.maximum(out[-1][1:], INTERPOLATED * between)
                self._fine.append((fine, s))
            start = self._after(nominal, number, s[-1])
        if paired < len(legs):
            out.append(self._distance_in_time(legs[paired:], states[paired:], nominal))
        return np.concatenate(out)

    def _interpolated(self, samples: np.ndarray) -> np.ndarray:
        """S (n, 2 nv, k) at sample times, from that along the first of the second solutions, at twice as many times."""
        fine = self._fine[: len(self._nominal.edges)]
        piece = np.maximum(np.searchsorted([leg.t[0] for leg, _ in fine], samples, side="right") - 1, 0)
        return np.concatenate([leg.at(samples[piece == number], s, interpolating=True)
                               for number, (leg, s) in enumerate(fine)])  # fmt: skip

    def _distance_in_time(
        self, legs: Sequence[Leg], states: Sequence[np.ndarray], nominal: NominalSolution
    ) -> np.ndarray:
        """The distance to a second solution that follows bounces farther, at the times of the legs.

        Not at events, nor while only one of the two follows bounces: there velocities differ by what an impact changes.
        """
        times = np.concatenate([leg.t for leg in legs])
        other, _, _ = self._along(nominal, times, self.tolerance / SMALLER)
        distance = np.abs(other - np.concatenate(states)[:, : other.shape[1]]).max(axis=1)
        for jump in (*self._nominal.jumps[:-1], *nominal.jumps[:-1]):
            distance[(times == jump.before.t) | ((times > jump.before.t) & (times < jump.rest))] = 0.0
        return np.asarray(distance)
