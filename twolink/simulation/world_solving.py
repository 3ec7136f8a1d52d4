"""Solving many worlds with error bars: each world is solved again, more accurately, until its bar is small enough."""

import time
from dataclasses import dataclass

import numpy as np

from twolink.integrate.motion.state import Array
from twolink.integrate.solution import Progress
from twolink.integrate.solver import smallest_tolerance
from twolink.integrate.solvers.method_choice import first_tolerance
from twolink.integrate.steps.many_worlds import integrate_many
from twolink.integrate.steps.methods import Method
from twolink.integrate.steps.perturbation import NO_PERTURBATION, Perturbation, disturbed_solutions, finer_solution
from twolink.integrate.steps.step_map import StepMap
from twolink.simulation.error_bar import (
    DISTURBED,
    ENOUGH,
    SLACK,
    common_rounding,
    distances,
    error_bar,
    truncation_factor,
)

ALONE = 2  # disturbed solutions of a world, at most
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


@dataclass(frozen=True, eq=False)
class _Worlds:
    """Worlds to be solved: their starts (size, n) and parameters (p, n), for states at the times (m,)."""

    step_map: StepMap
    starts: Array
    times: Array
    parameters: Array | None
    progress: Progress | None
    accuracy: float

    def solved(
        self, worlds: Array, tolerance: Array, perturbation: Perturbation = NO_PERTURBATION
    ) -> tuple[Array, Array, Array]:
        """x (m, size, w), steps (w,) and rejected (w,) of some worlds, each with its tolerance."""
        values = None if self.parameters is None else self.parameters[:, worlds]
        return integrate_many(self.step_map, self.starts[:, worlds], self.times, tolerance, values, self.progress,
                              perturbation)  # fmt: skip

    def parts(self, worlds: Array, x: Array, steps: Array, tolerance: Array) -> tuple[Array, Array]:
        """Of solutions x (m, size, w) of so many steps (w,), the bars (w,) at the end, and what of them is rounding."""
        space, method = self.step_map.equations.space, self.step_map.method

        def to(other: Perturbation, few: Array | slice = slice(None)) -> Array:
            """The distances to other solutions."""
            return distances(space, x[:, :, few], self.solved(worlds[few], tolerance[few], other)[0])

        first, second = disturbed_solutions(ALONE)
        truncation, once = (
            truncation_factor(method, steps) * to(finer_solution(method, float(tolerance.max()))),
            to(first),
        )
        rounding = DISTURBED[1] * once
        most = rounding.max(axis=0)
        more = np.flatnonzero((most >= ENOUGH * self.accuracy) & np.isfinite(most))
        if more.size:
            rounding[:, more] = DISTURBED[ALONE] * np.maximum(once[:, more], to(second, more))
        bar = error_bar(truncation + rounding, common_rounding(space, self.times, x, steps))[-1]
        return np.where(np.isfinite(bar), bar, np.nan), rounding.max(axis=0)


def can_be_finer(method: Method, accuracy: float) -> bool:
    """True if a method's first solution for an accuracy can be verified by one of a smaller tolerance."""
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

    With `verify` solutions beside each world give its error bar. Worlds whose bar is above the accuracy are solved
    again with tolerances by how much it is above, as long as that helps; each keeps the best bar it has had.
    """
    method, worlds, begin = step_map.method, np.arange(starts.shape[1]), time.perf_counter()
    given = _Worlds(step_map, starts, times, parameters, progress, accuracy)
    tolerance = np.full(len(worlds), first_tolerance(method, accuracy))
    x, steps, rejected = given.solved(worlds, tolerance)
    result = SolvedWorlds(x, steps, rejected, None, float(tolerance[0]), time.perf_counter() - begin)
    if not verify:
        return result
    result.error, result.x = np.full(len(worlds), np.nan), x.copy()
    while worlds.size:
        bar, rounding = given.parts(worlds, x, steps, tolerance)
        bar = bar + SLACK * accuracy
        better = ~(bar >= result.error[worlds])  # than none, too
        kept = worlds[better]
        result.error[kept], result.x[:, :, kept] = bar[better], x[:, :, better]
        result.steps[kept], result.rejected[kept] = steps[better], rejected[better]
        room = np.fmax(accuracy - rounding, 0.0)
        least = LEAST * smallest_tolerance(method)
        wanted = np.fmax(tolerance * np.fmin(0.5, AIM * room / np.fmax(bar - rounding, 1e-300)), least)
        again = (bar > accuracy) & (room > 0.0) & (tolerance > 1.01 * least)  # not the lost ones: their bar is NaN
        worlds, tolerance = worlds[again], wanted[again]
        if worlds.size:
            x, steps, rejected = given.solved(worlds, tolerance)
    result.verify_seconds = time.perf_counter() - begin - result.seconds
    return result
