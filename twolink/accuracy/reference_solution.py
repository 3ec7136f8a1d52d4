"""The solution that a study's errors are measured against, and its own error.

It is Taylor's method in numbers of 19 digits, or of 33 where 19 do not suffice, and verified as every run is. Numbers
of so many digits are kept as the sum of two doubles, q + rest.
"""

import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from twolink.accuracy.study_data import Reference
from twolink.dynamics.kernels import heyoka
from twolink.errors import AccuracyError
from twolink.integrate.compile_time import MAX_COMPILING, taylor_seconds
from twolink.integrate.equations import Equations
from twolink.integrate.method_choice import MethodChoice
from twolink.integrate.methods import METHODS
from twolink.integrate.solution import Solution
from twolink.integrate.state import Array, StateSpace
from twolink.integrate.taylor_code import Precision
from twolink.simulation.time_limit import OutOfTime, TimeLimit
from twolink.simulation.verification import Verification

MAX_SECONDS = 60.0  # for a solution in quadruple precision
TOLERANCES: dict[Precision, float] = {"double": 2.3e-13, "extended": 1e-18, "quad": 1e-25}
EPSILON = {"double": 2.2e-16, "extended": 1.1e-19, "quad": 1e-32}  # of quad, what two doubles keep
DIGITS = {"extended": "19", "quad": "33"}


@dataclass(frozen=True)
class ReferenceSolution:
    """A reference with its samples: q (n, nq) on its manifold, and `rest` (n, nq), its digits beyond a double.

    digits_error: its error without the rounding that a comparison on a curved manifold adds. precision: of its numbers.
    """

    about: Reference
    q: Array
    rest: Array
    digits_error: float
    precision: Precision

    def error_of(self, space: StateSpace, q: Array) -> float:
        """max over samples of |difference(q, reference)| for q (n, nq) on the manifold, rad or m."""
        if space.curved:
            return float(space.distance(q, self.q).max(initial=0.0))
        return float(np.abs((q - self.q) - self.rest).max(initial=0.0))


def first_reference(equations: Equations, times: Array) -> ReferenceSolution:
    """The quickest good reference at the samples `times` (n,). Raises AccuracyError where the motion cannot be solved.

    Without heyoka, or where Taylor's method would take too long to compile, it is SciPy's at its tightest tolerance.
    """
    if heyoka() is None:
        return _by_scipy(equations, times, "heyoka is not installed")
    seconds = taylor_seconds(equations)
    if seconds > MAX_COMPILING:
        return _by_scipy(equations, times, f"Taylor's method would take about {seconds:.0f} s to compile")
    if np.finfo(np.longdouble).eps < 1e-18:
        return _by_taylor(equations, times, "extended")
    return better_reference(equations, times) or _by_scipy(equations, times, "numbers of more digits are not there")


def better_reference(equations: Equations, times: Array) -> ReferenceSolution | None:
    """A reference of 33 digits; None where there is none, or where it takes too long."""
    if not hasattr(heyoka(), "real128"):
        return None
    try:
        return _by_taylor(equations, times, "quad", MAX_SECONDS)
    except OutOfTime:
        return None


def _by_taylor(
    equations: Equations, times: Array, precision: Precision, seconds: float | None = None
) -> ReferenceSolution:
    how = f"Taylor's method in {precision} precision ({DIGITS[precision]} digits)"
    return _verified(equations, times, MethodChoice(METHODS["taylor"], TOLERANCES[precision], how, precision), seconds)


def _by_scipy(equations: Equations, times: Array, why: str) -> ReferenceSolution:
    how = f"SciPy's DOP853 in double precision, as {why},"
    return _verified(equations, times, MethodChoice(METHODS["scipy-dop853"], TOLERANCES["double"], how))


def _verified(
    equations: Equations, times: Array, choice: MethodChoice, seconds: float | None = None
) -> ReferenceSolution:
    """A solution, with its error by the solutions beside it, as that of every run."""
    start, space = time.perf_counter(), equations.space
    limit = None if seconds is None else TimeLimit(seconds)
    run = Verification(equations, times, np.arange(len(times)), 0.0, limit)(choice)
    if run.truncation is None or run.rounding is None:  # Ctrl-C has cut it short: half a reference is of no use
        raise KeyboardInterrupt
    if not np.isfinite(run.solution.x).all():
        raise AccuracyError("the reference is not finite", where="reference", remedy="a shorter duration")
    q, rest = _parts(run.solution, space)
    # Two solutions may agree by chance, or be the start itself.
    error = digits_error = max(float((run.truncation + run.rounding).max()), EPSILON[choice.precision])
    if space.curved:
        q = space.rows(np.pad(q.T, ((0, space.nv), (0, 0))))[0]
        # The difference of two rotations is computed in doubles, and so is that of two places.
        error += 2.0 * float(np.finfo(float).eps * (1.0 + np.abs(q).max(initial=0.0)))
    text = f"{choice.why} at tolerance {choice.setting:.2g}, its error by a finer solution and disturbed ones"
    about = Reference(text, error, time.perf_counter() - start, tuple(q[-1].tolist()))
    return ReferenceSolution(about, q, rest, digits_error, choice.precision)


def _parts(solution: Solution, space: StateSpace) -> tuple[Array, Array]:
    """q (n, nq) as a sum of two doubles: of 32 digits, all that 19 have and all that matter of 33."""
    digits: Any = solution.precise
    if digits is None:
        q = space.rows(solution.x)[0]
        return q, np.zeros_like(q)
    digits = digits[:, : space.nq]
    q = digits.astype(float)
    return q, (digits - q.astype(digits.dtype)).astype(float)
