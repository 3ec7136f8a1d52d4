"""Verification: a run with the solutions beside it that show its truncation and its rounding.

    motion                  solutions beside the run                 how they are solved
    smooth, loops           a finer one, 2 to 6 disturbed ones       columns of one batch with the run
    sampled                 pairs that mirror each other, finer      columns of one batch with the run
    sampled, with events    a finer one, 3 disturbed ones            side by side, each with events of its own
    events, in many digits  a finer one that is disturbed, or a      one after the other
                            finer one and 1 or 2 disturbed ones
    SciPy's                 a finer one, 1 or 2 disturbed ones       one after the other

Worlds are verified in `world_solving`, motions that go on without end in `motion_error`, stepped contacts in
`stepped_run`, and derivatives in `sensitivity_runs`, by the factors of `error_bar` too.
"""

from __future__ import annotations

import collections
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from twolink.errors import AccuracyError
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.state import Array
from twolink.integrate.solution import AMBIGUOUS, Progress, Solution
from twolink.integrate.solver import ATTEMPTS, MethodChoice, attempts_of, has_columns, is_stepping, solve
from twolink.integrate.solvers.taylor import ROUNDING_UNIT
from twolink.integrate.steps.failures import failure
from twolink.integrate.steps.perturbation import (
    LEAST_WIDE,
    NO_PERTURBATION,
    OFTEN,
    RESTARTED,
    SELDOM,
    WIDEST,
    Companions,
    Perturbation,
    disturbed_finer,
    disturbed_solutions,
    finer_solution,
)
from twolink.simulation.error_bar import CHANCE, DISTURBED, ENOUGH, SLACK, distances, truncation_factor
from twolink.simulation.verified import ALONE, Verified

# Disturbed solutions as columns of a batch with the run: more where rounding counts, as it does below FINE (rad or m).
IN_COLUMNS, FINE = (2, 6), 1e-9
BY_TAYLOR = 3
PAIRS = 1, 3  # of a sampled loop: more where rounding counts
EMBEDDED = Perturbation(embedded=True)
SHORTER = 2.0  # times shorter than by their tolerance: steps that ticks decide
WIDE = 50.0  # times rounding: their disturbances
LESS_FINE = 3  # times that the finer solution is tried, each time nearer to the run
LOST = "loops-singular", "steps-collapsed"  # codes of a solution that gets no farther
Far = Callable[..., Array]  # the distance (k,) of a solution with a perturbation from the run, or from another origin


class Verification:
    """Solves the equations of a scene for samples, with the solutions beside each run.

    Parameters
    ----------
    equations : Equations
    times : ndarray (n,)
        Sample times, s.
    checks : ndarray (k,)
        Numbers of those at which solutions are compared, with the first and the last.
    accuracy : float
        For which the run is, rad or m; 0: none.
    progress : callable, optional
        Called with the simulated time now and then.
    """

    def __init__(
        self, equations: Equations, times: Array, checks: Array, accuracy: float, progress: Progress | None = None
    ) -> None:
        self._equations, self._times, self._checks = equations, times, checks
        self._accuracy, self._progress = accuracy, progress
        self._few = not 0.0 < accuracy < FINE  # disturbed solutions, until a run shows that rounding counts

    def unverified(self, choice: MethodChoice) -> Verified:
        """A run alone."""
        solution, seconds = self._solved(choice, self._times)
        return Verified(choice, solution, seconds, self._numbers(solution))

    def __call__(self, choice: MethodChoice) -> Verified:
        """A run with the parts of its error bar. Raises AccuracyError where it cannot be solved."""
        finer = finer_solution(choice.method, choice.setting)
        for trial in range(LESS_FINE):
            # Steps across a singular position of loops have an error of their own, which a smaller tolerance may not
            # admit.
            one = self._tried(choice, replace(finer, finer=finer.finer ** (0.5**trial)))
            if one.truncation is None or math.isfinite(one.truncation[-1]):
                return one
            if not choice.method.adaptive:
                break
        try:  # by itself it says why
            self._solved(choice, self._times[self._checks], finer)
        except AccuracyError as error:
            return replace(one, lost=error)
        return one

    def _tried(self, choice: MethodChoice, finer: Perturbation) -> Verified:
        if has_columns(self._equations, choice.method, choice.precision):
            return self._in_batches(choice, finer)
        if self._equations.sampling is not None and self._equations.has_events and is_stepping(choice.method):
            return self._from_tick_to_tick(choice, finer)
        return self._one_by_one(choice, finer)

    def _in_batches(self, choice: MethodChoice, finer: Perturbation) -> Verified:
        """The run and others as columns of one batch: more of them, until they are enough."""
        spent = 0.0
        for others in self._columns(choice, finer):
            run, own, x, companions = self._batch(choice, others)
            if run.solution.interrupted:
                return run
            each = self._distances(choice, own, x, companions)
            enough = self._is_enough(run, each)
            run = replace(run, verify_seconds=run.verify_seconds + spent).with_parts(_in_doubt(run, each))
            if self._is_negligible(run) if others[0].embedded else enough:
                break
            spent, self._few = run.seconds + run.verify_seconds, False
        return run

    def _columns(self, choice: MethodChoice, finer: Perturbation) -> Iterator[tuple[Perturbation, ...]]:
        """The solutions beside the run, for one batch after the other.

        A finer one, and disturbed ones; by Taylor's method, whose order all have, as fine as that one. Of a sampled
        loop, in which each calls the controllers, pairs whose disturbances mirror each other, so much larger than
        rounding that a threshold which is near to the motion lies between two solutions.

        A pair by the embedded formula takes the steps of the run, at no more evaluations; its error is that of a lower
        order. Where steps end at ticks, that is often as good as none; else pairs are finer.
        """
        if self._equations.sampling is None:
            taylor = choice.method.kind == "taylor"
            for count in (BY_TAYLOR,) if taylor else IN_COLUMNS if self._few else IN_COLUMNS[-1:]:
                yield finer, *disturbed_solutions(count, finer.finer if taylor else 1.0)
            return
        embedded = [(1, EMBEDDED)] if self._steps_are_ticks(choice) else []
        for pairs, beside in (*embedded, *((pairs, finer) for pairs in PAIRS)):
            yield tuple(replace(one, rounding=WIDE * one.rounding, sign=sign, embedded=beside.embedded)
                        for one in disturbed_solutions(pairs, beside.finer) for sign in (1.0, -1.0))  # fmt: skip

    def _distances(self, choice: MethodChoice, own: Array, x: Array, companions: Companions) -> Array:
        """The distances (k, n) that show truncation, the first, and rounding.

        The middle of a pair shows truncation, the distance from it rounding.
        """
        space, taylor = self._equations.space, choice.method.kind == "taylor"
        if self._equations.sampling is not None:
            one, other = x[:, :, ::2], x[:, :, 1::2]
            truncation = distances(space, own, 0.5 * (one + other)).max(axis=1, keepdims=True)
            return np.concatenate([truncation, 0.5 / WIDE * distances(space, one, other)], axis=1)
        undisturbed = x[:, :, :1] if taylor else own
        each = np.concatenate([distances(space, own, x[:, :, :1]), distances(space, undisturbed, x[:, :, 1:])], axis=1)
        if not taylor:  # between two checks, what the later one shows
            seen = each[companions.seldom, OFTEN:].repeat(companions.stride, axis=0)
            each[1:, OFTEN:] = seen[-len(each) + 1 :]
        return each

    def _is_enough(self, run: Verified, each: Array) -> bool:
        """True if so many disturbed solutions suffice: more of them could not lessen the bar by much, or not enough."""
        finer, far = each[:, 0].max(), each[:, 1:].max()
        least = truncation_factor(run.choice.method, run.solution.steps) * finer + DISTURBED[max(IN_COLUMNS)] * far
        count = each.shape[1] - 1
        return bool(DISTURBED[count] * far <= max(ENOUGH * self._accuracy, finer) or least > self._accuracy > 0.0)

    def _steps_are_ticks(self, choice: MethodChoice) -> bool:
        """True if ticks, not the tolerance, decide how long the steps of a method with one error estimate are."""
        ticks, tableau = self._equations.sampling, choice.method.tableau
        if ticks is None or tableau is None or len(tableau.errors) != 1 or choice.method.name not in ATTEMPTS:
            return False
        duration = float(self._times[-1] - self._times[0])
        by_tolerance = attempts_of(self._equations, choice.method, choice.setting, duration)
        return ticks.ticks_per_second * duration > SHORTER * by_tolerance

    def _is_negligible(self, run: Verified) -> bool:
        """True if the bar of a run is below what is added to each."""
        parts = run.truncation, run.rounding
        return all(one is not None and one.max() <= 0.5 * SLACK * self._accuracy for one in parts)

    def _from_tick_to_tick(self, choice: MethodChoice, finer: Perturbation) -> Verified:
        """The run and the others side by side, each with its own events and controllers.

        Of two disturbed ones that mirror each other, one is on the other side of a threshold that is near to the run.
        """
        from twolink.integrate.hybrid.located import solve_located  # with it come the effects of modes

        one, two = disturbed_solutions(ALONE)
        start, perturbations = time.perf_counter(), (NO_PERTURBATION, finer, one, replace(one, sign=-1.0), two)
        solution, *others = solve_located(self._equations, choice.method, self._times, choice.setting, self._progress,
                                          perturbations, self._times[self._checks])  # fmt: skip
        seconds = time.perf_counter() - start - solution.compile_seconds
        run = Verified(choice, solution, seconds, self._numbers(solution))
        if solution.interrupted:
            return run
        finer_off, *mirrored, rounded = (run.distance(self._equations.space, other) for other in others)
        # What mirrors another tells no more of the size of rounding.
        return run.with_parts(_in_doubt(run, np.stack([finer_off, np.max(mirrored, axis=0), rounded], axis=1)))

    def _batch(
        self, choice: MethodChoice, others: tuple[Perturbation, ...]
    ) -> tuple[Verified, Array, Array, Companions]:
        """The run with others as columns: its states (k, nq + nv, 1), and theirs (k, nq + nv, n) there."""
        equations = self._equations
        stride = SELDOM if equations.sampling is None and len(others) <= 1 + IN_COLUMNS[0] else 1
        companions = Companions.of(others, self._times[self._checks], equations.start[: equations.moving], stride)
        solution, seconds = self._solved(choice, self._times, companions=companions)
        tried = solution.steps + solution.rejected
        others_own = solution.companion_steps  # steps that were made for the others alone
        more = seconds * others_own / max(1, tried + others_own)
        run = Verified(choice, solution, seconds - more, self._numbers(solution), verify_seconds=more)
        own = solution.x[: equations.moving, run.checks].T[:, :, None]
        return run, own, companions.x.swapaxes(1, 2), companions

    def _one_by_one(self, choice: MethodChoice, finer: Perturbation) -> Verified:
        """The run, then the others."""
        run = self.unverified(choice)
        if run.solution.interrupted:
            return run
        begin, others = time.perf_counter(), list[Solution]()

        def far(perturbation: Perturbation, origin: Verified = run) -> Array:
            """The distance of another solution from the run or another origin, infinite where it is lost.

            It is larger where the other one has other events: whether a stop is hit may be chance.
            """
            try:
                other = self._solved(choice, self._times[self._checks], perturbation)[0]
            except AccuracyError as error:
                if error.code not in LOST:
                    raise
                return np.full(len(run.checks), np.inf)
            others.append(other)
            if other.interrupted:
                raise KeyboardInterrupt
            distance = origin.distance(self._equations.space, other)
            return distance if _kinds(other) == _kinds(run.solution) else CHANCE * distance

        try:
            one = run.with_parts(np.stack(self._apart(run, finer, far, others), axis=1))
        except KeyboardInterrupt:
            return replace(run, solution=replace(run.solution, interrupted=True))
        compiling = sum(other.compile_seconds for other in others)
        solution = replace(run.solution, compile_seconds=run.solution.compile_seconds + compiling)
        return replace(one, solution=solution, verify_seconds=time.perf_counter() - begin - compiling)

    def _apart(self, run: Verified, finer: Perturbation, far: Far, others: list[Solution]) -> list[Array]:
        """The distances (k,) to a finer solution, and to disturbed ones: another where the first says much.

        A finer solution that is disturbed shows both errors, where what it shows of rounding is little. What becomes
        of a disturbance is in proportion to it; to its square root where a stop or a contact may just be missed, so
        that the disturbance is small there.
        """
        kind, undisturbed, events = run.choice.method.kind, run, self._equations.has_events
        both, wide = disturbed_finer(finer, run.choice.setting, ROUNDING_UNIT[run.choice.precision],
                                     LEAST_WIDE if events else WIDEST)  # fmt: skip
        if kind == "scipy" or not (wide and self._accuracy > 0.0):
            both, wide = finer, 0.0
        each = [far(both)]
        if wide:
            rounding = each[0] / (math.sqrt(wide) if events else wide)
            if DISTURBED[1] * rounding.max() < ENOUGH * self._accuracy:
                return [*each, rounding]
        # The steps of a disturbed solution may end elsewhere than those of the run. It is compared with one of its own
        # steps: by Taylor's method the finer one, by SciPy's one that begins anew as often.
        if wide and kind == "taylor":
            each = [far(finer)]
        same_steps = each[0] if kind != "scipy" else far(RESTARTED)
        if kind in ("taylor", "scipy") and np.isfinite(same_steps).all():  # it is not lost
            own = others[-1]
            undisturbed = replace(run, solution=own, checks=np.arange(len(own.t)))
        for disturbed in disturbed_solutions(ALONE, finer.finer if kind == "taylor" else 1.0):
            each.append(far(disturbed, undisturbed))
            if len(each) == 2 and DISTURBED[1] * each[1].max() < ENOUGH * self._accuracy:
                break
        return each

    def _solved(
        self,
        choice: MethodChoice,
        times: Array,
        perturbation: Perturbation = NO_PERTURBATION,
        companions: Companions | None = None,
    ) -> tuple[Solution, float]:
        start = time.perf_counter()
        solution = solve(self._equations, choice.method, times, choice.setting, self._progress, choice.precision,
                         perturbation, companions)  # fmt: skip
        seconds = time.perf_counter() - start - solution.compile_seconds
        finite = np.isfinite(solution.x[: self._equations.space.z_rows.start]).all(axis=0)
        if perturbation == NO_PERTURBATION and not finite.all():  # a part of an implicit step, which has no solution
            last = float(solution.t[max(0, int(finite.argmin()) - 1)])
            raise failure("not-finite" if choice.method.adaptive else "step-too-large", last, step=choice.setting)
        return solution, seconds

    def _numbers(self, solution: Solution) -> Array:
        """The numbers of the samples that are compared, and of the last one of a solution that ended before."""
        last = len(solution.t) - 1
        return self._checks if self._checks[-1] == last else np.append(self._checks[self._checks < last], last)


def _kinds(solution: Solution) -> collections.Counter[str]:
    """The number of events of each kind."""
    return collections.Counter(event.kind for event in solution.events)


def _in_doubt(run: Verified, each: Array) -> Array:
    """Distances (k, n), larger behind an ambiguous tick."""
    doubtful = [event.t for event in run.solution.events if event.kind == AMBIGUOUS]
    if doubtful:  # which branch the motion takes is chance, as where solutions have parted
        each[run.solution.t[run.checks] > doubtful[0]] *= CHANCE
    return each
