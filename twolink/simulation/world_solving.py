"""Solving many worlds with error bars: each world is solved again, more accurately, until its bar is small enough."""

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twolink.integrate.method_choice import first_tolerance, second_tolerance, steps_ratio
from twolink.integrate.methods import Method
from twolink.integrate.perturbation import NO_PERTURBATION, Perturbation, second_solution
from twolink.integrate.solution import Progress
from twolink.integrate.solver import smallest_tolerance
from twolink.integrate.state import Array
from twolink.integrate.step_map import StepMap
from twolink.integrate.stepping import integrate_many
from twolink.simulation.error_bar import (
    ROUNDING,
    SAFETY,
    SAFETY_OF_SEVERAL,
    SLACK,
    distance_of_worlds,
    error_bar,
)
from twolink.simulation.refinement import rounding_tolerance
from twolink.simulation.verification import AT_ROUNDING, GROWN

LEAST = 4.0  # times the smallest tolerance: what a finer solution can judge
AIM = 0.3  # of the accuracy: where the next bar shall be, by the one that was too large


@dataclass(eq=False)
class SolvedWorlds:
    """Solutions of many worlds.

    x (m, size, n): states at the times. steps, rejected (n,): of what is in x. error (n,): the bars at the end, NaN
    for a lost world; None: not verified. tolerance: of the first solution. seconds: of that. verify_seconds: of all
    others.
    """

    x: Array
    steps: Array
    rejected: Array
    error: Array | None
    tolerance: float
    seconds: float
    verify_seconds: float = 0.0


Tried = tuple[Array, Array]  # solutions x (m, size, w), and their tolerances (w,)


@dataclass(frozen=True, eq=False)
class _Worlds:
    """Worlds to be solved: their starts (size, n) and parameters (p, n), for states at the times (m,)."""

    step_map: StepMap
    starts: Array
    times: Array
    parameters: Array | None
    progress: Progress | None

    def solved(
        self, worlds: Array, tolerance: Array, perturbation: Perturbation = NO_PERTURBATION
    ) -> tuple[Array, Array, Array]:
        """x (m, size, w), steps (w,) and rejected (w,) of some worlds, each with its tolerance."""
        values = None if self.parameters is None else self.parameters[:, worlds]
        starts = perturbation.shifted(self.starts[:, worlds])
        return integrate_many(self.step_map, starts, self.times, tolerance, values, self.progress,
                              perturbation.min_steps)  # fmt: skip

    def bars(self, worlds: Array, now: Tried, accuracy: float, earlier: Sequence[Tried] = ()) -> tuple[Array, Tried]:
        """The error bars (w,) of solutions at the end, by a finer one each, or two where rounding counts; a finer one.

        Where a motion comes near to a singular one, an error may be much smaller or larger than what the tolerance
        lets expect. Solutions from before show it: with an error proportional to the tolerance, the distance to one of
        a larger tolerance is larger than the error by the ratio of both tolerances, and to one of a smaller tolerance
        it is the error.
        """
        x, tolerance = now
        space, method = self.step_map.equations.space, self.step_map.method
        perturbation = second_solution(steps_ratio(method))
        finer = np.fmax(second_tolerance(method, 1.0) * tolerance, smallest_tolerance(method))
        fine, *_ = self.solved(worlds, finer, perturbation)
        distance, size = distance_of_worlds(space, x, fine), np.abs(np.nan_to_num(x[:, : space.nq])).max(axis=1)
        early = distance[: len(distance) // 4 + 1].max(axis=0)
        grown = (early < AT_ROUNDING * np.fmax(1.0, size.max(axis=0))) & (distance.max(axis=0) > GROWN * early)
        several = np.flatnonzero(grown | (tolerance < rounding_tolerance(method)))
        safety = np.full(len(worlds), SAFETY)
        if several.size:
            safety[several] = SAFETY_OF_SEVERAL
            other, *_ = self.solved(worlds[several], finer[several], perturbation.opposite)
            others = distance_of_worlds(space, x[:, :, several], other)
            distance[:, several] = np.fmax(distance[:, several], others)
        for other, theirs in earlier:
            distance = np.fmax(distance, distance_of_worlds(space, x, other) * np.fmin(1.0, tolerance / theirs))
        lost = ~np.isfinite(x[-1] + fine[-1]).all(axis=0)
        bar = np.where(lost, np.nan, error_bar(distance, ROUNDING * size, safety)[-1] + SLACK * accuracy)
        return bar, (fine, finer)


def can_be_finer(method: Method, accuracy: float) -> bool:
    """Whether a method's first solution for an accuracy can be verified by one of a smaller tolerance."""
    return first_tolerance(method, accuracy) > LEAST * smallest_tolerance(method)


def solve_worlds(
    step_map: StepMap,
    starts: Array,
    times: Array,
    accuracy: float,
    parameters: Array | None = None,
    progress: Progress | None = None,
    *,
    verify: bool = True,
) -> SolvedWorlds:
    """Solve worlds from starts (size, n), with parameters (p, n), for states at the times (m,).

    Every world is solved once, and with `verify` a second time for its error bar. Worlds whose bar is above the
    accuracy are solved again with tolerances by how much it is above. Those that would need less than the smallest
    tolerance keep the bar they have.
    """
    method, worlds, begin = step_map.method, np.arange(starts.shape[1]), time.perf_counter()
    given = _Worlds(step_map, starts, times, parameters, progress)
    tolerance = np.full(len(worlds), first_tolerance(method, accuracy))
    x, steps, rejected = given.solved(worlds, tolerance)
    result = SolvedWorlds(x, steps, rejected, None, float(tolerance[0]), time.perf_counter() - begin)
    if not verify:
        return result
    result.error = np.full(len(worlds), np.nan)
    earlier: list[Tried] = []
    while True:
        bar, fine = given.bars(worlds, (x, tolerance), accuracy, earlier)
        result.error[worlds], result.x[:, :, worlds] = bar, x
        result.steps[worlds], result.rejected[worlds] = steps, rejected
        wanted = tolerance * AIM * accuracy / np.fmax(bar, accuracy)
        again = (bar > accuracy) & (wanted > LEAST * smallest_tolerance(method))  # not the lost ones: their bar is NaN
        if not again.any():
            result.verify_seconds = time.perf_counter() - begin - result.seconds
            return result
        earlier = [(tried[:, :, again], t[again]) for tried, t in ((x, tolerance), fine)]
        worlds, tolerance = worlds[again], wanted[again]
        x, steps, rejected = given.solved(worlds, tolerance)
