"""Solving a scene's equations by any method: one door to the solvers."""

from __future__ import annotations

import functools
import itertools
import math
from dataclasses import replace

import numpy as np

from twolink.errors import AccuracyError, SceneError
from twolink.integrate.core.smooth import solve_smooth
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.state import Array
from twolink.integrate.solution import Progress, Segment, Solution, in_segments
from twolink.integrate.solvers import scipy_solver, taylor
from twolink.integrate.solvers.taylor import Precision
from twolink.integrate.steps.methods import Method
from twolink.integrate.steps.perturbation import NO_PERTURBATION, Companions, Perturbation
from twolink.integrate.steps.stepping import SMALLEST_TOLERANCE
from twolink.native.programs import SPENT

SMALLEST = {"explicit": SMALLEST_TOLERANCE, "implicit": SMALLEST_TOLERANCE, "taylor": 1e-16,
            "scipy": scipy_solver.SMALLEST_TOLERANCE}  # fmt: skip
BY_STEPS = 'method="auto", or one of rk45, dop853, esdirk43'
SMALLEST_PRECISE = {"extended": 1e-31, "quad": 1e-46}


def smallest_tolerance(method: Method, precision: Precision = "double") -> float:
    """Below this the rounding of the numbers decides, not the tolerance. 0 for methods of fixed steps."""
    if precision != "double":
        return SMALLEST_PRECISE[precision]
    return SMALLEST[method.kind] if method.adaptive else 0.0


def solve(
    equations: Equations,
    method: Method,
    times: Array,
    setting: float,
    progress: Progress | None = None,
    precision: Precision = "double",
    perturbation: Perturbation = NO_PERTURBATION,
    companions: Companions | None = None,
) -> Solution:
    """Solve equations of motion from their start for samples.

    Parameters
    ----------
    equations : Equations
    method : Method
    times : ndarray (n,)
        Sample times, increasing, s; the first is that of the start.
    setting : float
        The tolerance of an adaptive method, or the step of another, s.
    progress : callable, optional
        Called with the simulated time now and then.
    precision : {"double", "extended", "quad"}
        Of the numbers; beyond "double" by Taylor's method only.
    perturbation : Perturbation
        Of this solution; its setting is divided by `finer`.
    companions : Companions, optional
        Solutions in the same batch, where `has_columns` says that there are batches.

    Returns
    -------
    Solution
        With one segment at least. No step goes across a time at which the equations are not smooth.

    Raises
    ------
    AccuracyError
        The motion cannot be solved (codes of `failures`), or the setting is no number above 0.
    SceneError
        The method cannot solve these equations, or not in this precision.
    """
    if not (isinstance(setting, (int, float)) and math.isfinite(setting) and setting > 0):
        name = "tolerance" if method.adaptive else "step"
        raise AccuracyError(f"expected a number above 0, got {setting!r:.60}", argument=name, remedy="such as 1e-6")
    if precision != "double" and method.kind != "taylor":
        raise SceneError(f"{method.name} works in double precision", argument="precision", remedy='method="taylor"')
    stepping, before = is_stepping(method), SPENT.seconds
    if equations.space.size == 0:  # nothing moves
        solution = Solution(times, np.empty((0, len(times))), 0, 0)
    elif equations.has_events and stepping:
        from twolink.integrate.hybrid.located import solve_located  # with it come the effects of modes

        solution = solve_located(equations, method, times, setting, progress, (perturbation,))[0]
    elif stepping:
        if not method.adaptive:
            _require_segments(equations, times, setting)
        solution = solve_smooth(equations, method, times, setting, progress, perturbation, companions)
    elif equations.switching is not None:
        raise SceneError(f"{method.name} does not locate events", argument="method", remedy=BY_STEPS)
    elif equations.sampling is not None:
        raise SceneError(f"{method.name} does not call controllers", argument="method", remedy=BY_STEPS)
    elif method.kind == "taylor":
        solution = taylor.solve(equations, times, setting, progress, precision=precision, perturbation=perturbation,
                                companions=companions)  # fmt: skip
    else:
        by_scipy = functools.partial(scipy_solver.solve, method=method, tolerance=setting, progress=progress,
                                     perturbation=perturbation)  # fmt: skip
        solution = in_segments(equations, times, lambda segment, part: by_scipy(segment, times=part))
    whole = Segment(equations, float(times[0]), len(solution.t))
    return replace(solution, segments=solution.segments or (whole,), compile_seconds=SPENT.seconds - before)


def has_columns(equations: Equations, method: Method, precision: Precision) -> bool:
    """True if solutions beside a run are columns of one batch."""
    if method.kind == "taylor" or (equations.sampling is not None and not equations.has_events):
        return precision == "double" and equations.space.size > 0
    return is_stepping(method) and not equations.has_events and equations.space.size > 0


def is_stepping(method: Method) -> bool:
    """True if a step map makes the method's steps."""
    return method.kind not in ("taylor", "scipy")


def _require_segments(equations: Equations, times: Array, step: float) -> None:
    """Refuse a step longer than a segment: half the step would be the same step, and their distance no error bar."""
    edges = [float(times[0]), *equations.breaks(float(times[-1])), float(times[-1])]
    shortest = min(b - a for a, b in itertools.pairwise(edges))
    if step > shortest * (1 + 1e-9):
        raise AccuracyError(f"steps of {step:.3g} s are longer than {shortest:.3g} s, what lies between two breaks",
                            argument="step",
                            remedy=f"step={shortest:.3g}, or a method that adapts its steps")  # fmt: skip
