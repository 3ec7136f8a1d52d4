"""Verification: the second solutions whose distances from a solution bound its error."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

import numpy as np

from twolink.errors import AccuracyError
from twolink.integrate.equations import Equations
from twolink.integrate.method_choice import MethodChoice, steps_ratio
from twolink.integrate.perturbation import NO_PERTURBATION, START_SHIFT, Perturbation, second_solution
from twolink.integrate.solution import Solution
from twolink.integrate.state import Array
from twolink.simulation.error_bar import SAFETY, SAFETY_OF_SEVERAL, SLACK, distance_of_runs
from twolink.simulation.refinement import ROUNDING_MEASURED, finer, more_digits, rounding_tolerance

# Of the steps that a smaller tolerance should take, where it decides: DOP853 should take 1.78 times as many. It takes
# 1.5 to 1.76 times as many where a mass hits a stop, and 1.2 where a ball bounces on parabolas: they are exact.
MORE_STEPS = 0.8
AT_ROUNDING = 1e-12  # relative distance that perturbation and rounding may cause in the first quarter of a run
GROWN = 1e3
ROUNDING_A_STEP = 1e-12  # of fixed size: below this mean error a step, rounding may be a tenth of it

SMALL_SHARE = 0.1  # of the error, up to which rounding does not count
LESS_FINE = 2  # times that a finer solution is tried nearer to the coarse one: with DOP853, to 1 / 10 and 1 / 3.2


@dataclass(frozen=True, eq=False)
class Solved:
    """A solution with what it was asked for and its seconds."""

    choice: MethodChoice
    solution: Solution
    seconds: float


class Solve(Protocol):
    """What solves by a choice of method, perturbed or not."""

    def __call__(self, choice: MethodChoice, perturbation: Perturbation = NO_PERTURBATION) -> Solved: ...


class SecondSolutions(NamedTuple):
    """More accurate solutions, and the largest distance of the coarse one from them at its samples (n,), rad or m."""

    solutions: list[Solved]
    distance: Array

    @property
    def interrupted(self) -> bool:
        """Whether one was, so that there is no distance."""
        return any(solved.solution.interrupted for solved in self.solutions)

    @property
    def safety(self) -> float:
        """The factor between the distance and the error bar."""
        return SAFETY if len(self.solutions) == 1 else SAFETY_OF_SEVERAL


def second_solutions(
    coarse: Solved, solve: Solve, equations: Equations, accuracy: float, earlier: Sequence[Solved] = ()
) -> SecondSolutions:
    """More accurate solutions beside a coarse one.

    Parameters
    ----------
    coarse : Solved
        With the samples at which its error is looked at.
    solve : Solve
        Solves for the same samples.
    equations : Equations
    accuracy : float
        The accuracy asked for, rad or m.
    earlier : sequence of Solved
        The second solutions of a coarser one: what has more digits than both is not solved again.

    Returns
    -------
    SecondSolutions
        One solution, perturbed, where the truncation of steps decides about the error. Where rounding may, one that has
        more digits; or two, perturbed in opposite directions, where there are no more digits.

    Raises
    ------
    AccuracyError
        Nothing solves more accurately.

    Notes
    -----
    Solutions of as many digits have rounding errors e2 and e2' as large as that of the coarse one, e1, and the effect p
    of the perturbation may cancel e1 in e1 - e2 - p. It cannot in both directions, of which the second is k times as
    far: the larger of |e1 - e2 - p| and |e1 - e2' + k p| is at least |e1 - (k e2 + e2') / (k + 1)|.
    """
    choice = finer(coarse.choice, equations, accuracy, coarse.solution.steps, digits_below=ROUNDING_MEASURED)
    if choice.precision != "double":
        return _with_more_digits(choice, coarse, solve, equations, earlier)
    # Steps across a singular position of loops have an error of their own, which a smaller tolerance may not admit.
    for _ in range(LESS_FINE):
        try:
            return _of_as_many_digits(choice, coarse, solve, equations, accuracy, earlier)
        except AccuracyError as error:
            if error.code != "loops-singular":
                raise
        choice = replace(choice, setting=math.sqrt(choice.setting * coarse.choice.setting))
    return _of_as_many_digits(choice, coarse, solve, equations, accuracy, earlier)


def _of_as_many_digits(
    choice: MethodChoice,
    coarse: Solved,
    solve: Solve,
    equations: Equations,
    accuracy: float,
    earlier: Sequence[Solved],
) -> SecondSolutions:
    """One finer solution of a choice, or where rounding counts two, or one that has more digits."""
    margin = coarse.choice.setting if coarse.choice.method.adaptive else 0.0
    perturbation = second_solution(steps_ratio(choice.method), margin)
    first = solve(choice, perturbation)
    one = _with_distance([first], coarse, equations)
    if one.interrupted:
        return one
    method, tolerance = coarse.choice.method, coarse.choice.setting
    near = method.adaptive and tolerance < rounding_tolerance(method)
    grown = _rounding_grows(equations, coarse, one.distance, accuracy)
    if not (grown or _rounding_counts(coarse, first, one.distance)):
        if not near:
            return one
        if tolerance >= ROUNDING_MEASURED:
            same = solve(coarse.choice, Perturbation(START_SHIFT))
            if same.solution.interrupted:
                return _with_distance([same], coarse, equations)
            first = replace(first, seconds=first.seconds + same.seconds)
            if _rounding_is_small(equations, coarse, same, one.distance, accuracy):
                return one._replace(solutions=[first])
    exact = grown or near or not method.adaptive
    more = more_digits(equations, coarse.solution.steps) if exact else None
    if more is not None:
        return _with_more_digits(more, coarse, solve, equations, earlier)
    return _with_distance([first, solve(choice, perturbation.opposite)], coarse, equations)


def _with_distance(solutions: list[Solved], coarse: Solved, equations: Equations) -> SecondSolutions:
    """Solutions with the largest distance from them; no distance where one is interrupted."""
    second = SecondSolutions(solutions, np.empty(0))
    if second.interrupted:
        return second
    method = coarse.choice.method
    each = [distance_of_runs(equations.space, method, coarse.solution, one.solution) for one in solutions]
    return second._replace(distance=np.max(each, axis=0))


def _with_more_digits(
    choice: MethodChoice, coarse: Solved, solve: Solve, equations: Equations, earlier: Sequence[Solved]
) -> SecondSolutions:
    same = [one for one in earlier if one.choice == choice]
    return _with_distance(same or [solve(choice)], coarse, equations)


def _rounding_grows(equations: Equations, coarse: Solved, distance: Array, accuracy: float) -> bool:
    """Whether an unstable motion has made rounding errors large.

    Beside an equilibrium truncation may be none for long, and both solutions round alike: their distance is as small as
    rounding in the first quarter of the samples, and grows to what counts.
    """
    early = distance[: len(distance) // 4 + 1].max()
    size = max(1.0, np.abs(coarse.solution.x[: equations.space.nq]).max(initial=0.0))
    return bool(early < AT_ROUNDING * size and distance[-1] > max(GROWN * early, SLACK / 2 * accuracy))


def _rounding_counts(coarse: Solved, fine: Solved, distance: Array) -> bool:
    """Whether rounding may be a large part of the error.

    It may where a smaller tolerance takes few more steps: then events, breaks or an exact method decide about the
    steps, and truncation may be less than the tolerance by any factor.
    """
    method, steps = coarse.choice.method, coarse.solution.steps
    if not method.adaptive:
        return bool(distance[-1] < ROUNDING_A_STEP * steps)
    return method.kind != "taylor" and fine.solution.steps < MORE_STEPS * steps_ratio(method) * steps


def _rounding_is_small(equations: Equations, coarse: Solved, same: Solved, distance: Array, accuracy: float) -> bool:
    """Whether rounding is a small part of the error so far at each sample.

    By a solution of the same tolerance that starts roundings away: it has the same truncation, and other roundings.
    """
    rounding = distance_of_runs(equations.space, coarse.choice.method, coarse.solution, same.solution)
    largest, error = np.maximum.accumulate(rounding), np.maximum.accumulate(distance)
    return bool((largest <= SMALL_SHARE * error + SLACK / 2 * accuracy).all())
