"""Solutions beside a run, one after the other."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from twolink.errors import AccuracyError
from twolink.integrate.motion.state import Array, StateSpace
from twolink.integrate.solution import Solution
from twolink.integrate.solvers.taylor import ROUNDING_UNIT
from twolink.integrate.steps.perturbation import RESTARTED, Perturbation, disturbed_finer, disturbed_solutions
from twolink.simulation.error_bar import DISTURBED, ENOUGH, SLACK
from twolink.simulation.verified import ALONE, Verified

LOST = "loops-singular", "steps-collapsed"  # codes of a solution that gets no farther


class OneByOne:
    """The solutions beside a run.

    Parameters
    ----------
    run : Verified
        The run alone.
    space : StateSpace
        Of its states.
    accuracy : float
        For which it is, rad or m; 0: none.
    solve : callable
        A perturbation -> the solution at the samples that are compared.
    """

    def __init__(
        self, run: Verified, space: StateSpace, accuracy: float, solve: Callable[[Perturbation], Solution]
    ) -> None:
        self._run, self._space, self._accuracy, self._solve = run, space, accuracy, solve
        self._others: list[Solution] = []

    def verified(self, finer: Perturbation) -> Verified:
        """The run with the parts of its bar. Raises KeyboardInterrupt where a solution was interrupted.

        A finer solution that is disturbed shows both errors, if what becomes of disturbances is in proportion to them:
        not where a stop, a contact or a halt may just be missed. Where its bar is above the accuracy, each error has a
        solution of its own.
        """
        begin, smooth = time.perf_counter(), self._run.choice.method.kind == "taylor"
        one = (smooth and self._together(finer)) or self._run.with_parts(np.stack(self._apart(finer), axis=1))
        compiling = sum(other.compile_seconds for other in self._others)
        solution = replace(one.solution, compile_seconds=one.solution.compile_seconds + compiling)
        return replace(one, solution=solution, verify_seconds=time.perf_counter() - begin - compiling)

    def _together(self, finer: Perturbation) -> Verified | None:
        """The run by a solution that shows both errors, where that is enough."""
        choice = self._run.choice
        disturbed, wide = disturbed_finer(finer, choice.setting, ROUNDING_UNIT[choice.precision])
        if not (wide and self._accuracy > 0.0):
            return None
        far = self._far(disturbed)
        one = self._run.with_parts(np.stack([far, far / wide], axis=1))
        bar = one.bar(self._space, SLACK * self._accuracy)
        return one if bar is not None and bar[-1] <= self._accuracy else None

    def _apart(self, finer: Perturbation) -> list[Array]:
        """The distances (k,) to a finer solution, and to disturbed ones: another where the first says much."""
        # The steps of a disturbed solution may end elsewhere than those of the run. It is compared with one of its own
        # steps: by Taylor's method the finer one, by SciPy's one that begins anew as often.
        kind = self._run.choice.method.kind
        each, undisturbed = [self._far(finer)], self._run
        same_steps = each[0] if kind != "scipy" else self._far(RESTARTED)
        if kind in ("taylor", "scipy") and np.isfinite(same_steps).all():  # it is not lost
            own = self._others[-1]
            undisturbed = replace(self._run, solution=own, checks=np.arange(len(own.t)))
        for disturbed in disturbed_solutions(ALONE, finer.finer if kind == "taylor" else 1.0):
            each.append(self._far(disturbed, undisturbed))
            if len(each) == 2 and DISTURBED[1] * each[1].max() < ENOUGH * self._accuracy:
                break
        return each

    def _far(self, perturbation: Perturbation, origin: Verified | None = None) -> Array:
        """The distance of another solution from the run or another origin, infinite where it is lost."""
        try:
            other = self._solve(perturbation)
        except AccuracyError as error:
            if error.code not in LOST:
                raise
            return np.full(len(self._run.checks), np.inf)
        self._others.append(other)
        if other.interrupted:
            raise KeyboardInterrupt
        return (origin or self._run).distance(self._space, other)
