"""Solving many worlds with error bars: each world is solved again, more accurately, until its bar is small enough."""

import itertools
import time
from dataclasses import dataclass, fields

import numpy as np

from twolink.integrate.motion.state import Array
from twolink.integrate.solution import Progress
from twolink.integrate.solver import first_tolerance, smallest_tolerance
from twolink.integrate.steps.methods import Method
from twolink.integrate.steps.perturbation import (
    NO_PERTURBATION,
    Perturbation,
    disturbed_finer,
    disturbed_solutions,
    finer_solution,
)
from twolink.integrate.steps.step_map import StepMap
from twolink.integrate.steps.stepping import integrate_many
from twolink.simulation.cost import Cost
from twolink.simulation.error_bar import (
    DISTURBED,
    ENOUGH,
    PARTED,
    SLACK,
    common_rounding,
    distances,
    error_bar,
    truncation_factor,
)

LEAST = 4.0  # times the smallest tolerance: what a finer solution can judge
MORE = 2.0  # times the rounding of a solution: at least what counts as that of one of more steps
FAIR = 0.5  # of the accuracy: less rounding leaves room for the truncation of the next solution
NOISE = 0.5  # of rounding: less truncation may be by rounding, too, so that no smaller tolerance helps
AIM = 0.3  # of the accuracy: where the next bar shall be, by the one that was too large


@dataclass(eq=False)
class _Tried:
    """Solutions of some worlds, each with its tolerance.

    worlds, tolerance, steps, rejected (w,), x (m, size, w): at the times. rounding (m, w): of their bars, inf where it
    is not known. error (w,): the bars at the end, NaN for a lost world, and where it is not known.
    """

    worlds: Array
    tolerance: Array
    x: Array
    steps: Array
    rejected: Array
    rounding: Array
    error: Array

    def of(self, few: Array) -> "_Tried":
        """The solutions of few (k,) of them, or of a mask (w,)."""
        return _Tried(*(getattr(self, field.name)[..., few] for field in fields(self)))

    def take(self, few: Array, others: "_Tried") -> None:
        """Take others in place of few (k,) of the solutions."""
        for field in fields(self):
            getattr(self, field.name)[..., few] = getattr(others, field.name)

    def beside(self, other: "_Tried") -> "_Tried":
        """The solutions of these and of other worlds."""
        pairs = ((getattr(self, field.name), getattr(other, field.name)) for field in fields(self))
        return _Tried(*(np.concatenate(pair, axis=-1) for pair in pairs))


@dataclass(frozen=True, eq=False)
class _Worlds:
    """Worlds to be solved: their starts (size, n) and parameters (p, n), for states at the times (m,)."""

    step_map: StepMap
    starts: Array
    times: Array
    parameters: Array | None
    progress: Progress | None
    accuracy: float

    def solved(self, worlds: Array, tolerance: Array, perturbation: Perturbation = NO_PERTURBATION) -> _Tried:
        """The solutions of some worlds (w,), each with its tolerance."""
        values = None if self.parameters is None else self.parameters[:, worlds]
        x, steps, rejected = integrate_many(self.step_map, self.starts[:, worlds], self.times, tolerance, values,
                                            self.progress, perturbation)  # fmt: skip
        unknown, none = np.full((len(x), len(worlds)), np.inf), np.full(len(worlds), np.nan)
        return _Tried(worlds, tolerance / perturbation.finer, x, steps, rejected, unknown, none)

    def first_bars(self, one: _Tried) -> _Tried:
        """As `bars`, of first solutions: by finer ones that show rounding, too, of a tolerance for which they can.

        These are disturbed by more than rounding, so that none is to be returned: their tolerance is inf.
        """
        method, tolerance = self.step_map.method, float(one.tolerance[0])
        disturbed, wide = disturbed_finer(finer_solution(method, tolerance), tolerance)
        if not wide:
            return self.bars(one, 0)
        finer = self.solved(one.worlds, one.tolerance, disturbed)
        far = distances(self.step_map.equations.space, one.x, finer.x)
        truncation = truncation_factor(method, one.steps) * far
        one.error = self._bar(one, truncation, DISTURBED[1] / wide * far)
        finer.tolerance = np.full(len(finer.worlds), np.inf)
        parted = np.flatnonzero(one.error > PARTED)  # by truncation or by rounding
        few = one.of(parted)
        self._look_at_rounding(few, truncation.max(axis=0)[parted])
        one.take(parted, few)
        return finer

    def bars(self, one: _Tried, before: int) -> _Tried:
        """Find the bars of solutions. Returns the finer solutions.

        before: how often these worlds have been looked at before. Some of the solutions are finer ones of then: their
        longest step is shorter, and that of their own finer solutions must be shorter again.
        """
        equations, method = self.step_map.equations, self.step_map.method
        ratio = finer_solution(method, first_tolerance(method, self.accuracy)).finer  # whatever other worlds need
        finer = self.solved(one.worlds, one.tolerance * ratio**before, Perturbation(finer=ratio ** (before + 1)))
        truncation = truncation_factor(method, one.steps) * distances(equations.space, one.x, finer.x)
        self._look_at_rounding(one, truncation.max(axis=0))
        self.take_over(one, finer)
        one.error = self._bar(one, truncation, one.rounding)
        return finer

    def agreeing(self, one: _Tried, other: _Tried) -> tuple[Array, Array]:
        """The bars (w,) of solutions of the same worlds, which do not contradict each other.

        The error of a solution may by chance be as small as that of a finer one, and their distance smaller. Where two
        are farther apart than the sum of their bars, each bar is widened to the distance plus the other one.
        """
        far = distances(self.step_map.equations.space, one.x, other.x).max(axis=0)
        apart = far > one.error + other.error  # not of lost ones
        return (np.where(apart, far + other.error, one.error), np.where(apart, far + one.error, other.error))

    def _bar(self, one: _Tried, truncation: Array, rounding: Array) -> Array:
        """The bars (w,) at the end, NaN of worlds that are lost, from their parts (m, w)."""
        alike = common_rounding(self.step_map.equations.space, self.times, one.x, one.steps)
        bar = error_bar(truncation + rounding, alike)[-1] + SLACK * self.accuracy
        return np.where(np.isfinite(bar), bar, np.nan)

    def _look_at_rounding(self, one: _Tried, truncation: Array) -> None:
        """Solve disturbed solutions of worlds whose rounding is not known; more where few are too coarse."""
        space, unknown = self.step_map.equations.space, np.flatnonzero(~np.isfinite(one.rounding[-1]))
        far = np.zeros((len(self.times), len(one.worlds)))
        for count, disturbed in enumerate(disturbed_solutions(max(DISTURBED)), 1):
            if not unknown.size:
                return
            other = self.solved(one.worlds[unknown], one.tolerance[unknown], disturbed)
            far[:, unknown] = np.maximum(far[:, unknown], distances(space, one.x[:, :, unknown], other.x))
            if count in DISTURBED:
                one.rounding[:, unknown] = DISTURBED[count] * far[:, unknown]
                unknown = unknown[self._decides(one.rounding[:, unknown], truncation[unknown])]
            if count > 1:  # those that are to be solved again will have another rounding
                unknown = unknown[truncation[unknown] < self.accuracy]

    def _decides(self, rounding: Array, truncation: Array) -> Array:
        """A mask (w,) of the worlds in which less rounding (m, w) would be a better bar, or less to do, by much."""
        most, left = rounding.max(axis=0), self.accuracy - truncation
        fair = np.where(left > 0.0, np.fmin(truncation, left), FAIR * self.accuracy)
        return np.asarray((most >= np.fmax(fair, ENOUGH * self.accuracy)) & np.isfinite(most))

    def take_over(self, one: _Tried, other: _Tried) -> None:
        """Take the rounding of solutions for that of others of more steps, where it hardly counts."""
        more = one.rounding * np.fmax(MORE, other.steps / np.fmax(one.steps, 1))
        other.rounding = np.where(more.max(axis=0) < ENOUGH * self.accuracy, more, np.inf)


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
) -> tuple[Array, Array | None, Array, Cost]:
    """Solve worlds from starts (size, n), with parameters (p, n), for states at the times (m,).

    With `verify` solutions beside each world give its error bar. Worlds whose bar is above the accuracy are solved
    again with tolerances by how much it is above, as long as that helps; each keeps the best bar it has had.

    Returns
    -------
    x : ndarray (m, size, n)
        States at the times.
    error : ndarray (n,) or None
        The bars at the end, NaN for a lost world; None: not verified.
    steps : ndarray (n,)
        Steps of what is in x.
    cost : Cost
        Of all.
    """
    method, begin = step_map.method, time.perf_counter()
    given = _Worlds(step_map, starts, times, parameters, progress, accuracy)
    count, tolerance = starts.shape[1], first_tolerance(method, accuracy)
    one = given.solved(np.arange(count), np.full(count, tolerance))
    seconds, best = time.perf_counter() - begin, one.of(one.worlds) if verify else one
    least = LEAST * smallest_tolerance(method)
    for before in itertools.count():
        if not (verify and one.worlds.size):
            break
        finer = given.bars(one, before) if before else given.first_bars(one)
        one.error, best.error[one.worlds] = given.agreeing(one, best.of(one.worlds))
        better = ~(one.error >= best.error[one.worlds])  # than none, too
        best.take(one.worlds[better], one.of(better))
        rounding = np.where(np.isfinite(one.rounding), one.rounding, 0.0).max(axis=0)  # 0: not known
        truncation, room = np.fmax(one.error - rounding, 1e-300), accuracy - rounding
        # The rounding of solutions that are far off may be another one, unless disturbed ones have parted from them.
        hopeless = (room <= 0.0) & ((truncation < NOISE * rounding) | (rounding > PARTED))
        wanted = one.tolerance * np.fmin(0.5, AIM * np.where(room > 0.0, room, accuracy) / truncation)
        wanted = np.fmax(wanted, least)
        again = (one.error > accuracy) & ~hopeless & (one.tolerance > 1.01 * least)  # not the lost ones
        fine = (finer.tolerance <= wanted) & (finer.tolerance >= least)  # enough, so that they are there already
        anew = again & ~fine
        before_them, one = one.of(anew), finer.of(again & fine)
        if anew.any():
            solved = given.solved(before_them.worlds, wanted[anew])
            given.take_over(before_them, solved)
            one = one.beside(solved)
    verify_seconds = time.perf_counter() - begin - seconds if verify else 0.0
    steps, rejected = int(best.steps.sum()), int(best.rejected.sum())
    cost = Cost(method.name, tolerance, steps, (steps + rejected) * method.evaluations, seconds, verify_seconds,
                rejected=rejected, compiled=step_map.compiled, why="a batch")  # fmt: skip
    return best.x, best.error if verify else None, best.steps, cost
