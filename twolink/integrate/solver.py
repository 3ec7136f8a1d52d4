"""Solving a scene's equations by any method, one door to the solvers; and the choice of the method and its setting.

The figures were measured on the paper's arm over 10 s: attempted steps at a tolerance of 1e-3, the power of the
tolerance by which they grow, and seconds an attempt and an operation. They say which method is cheapest, not how long a
run takes. Where a mode decays fast, explicit steps are as short as their stability calls for, whatever the tolerance.
"""

from __future__ import annotations

import functools
import itertools
import math
from dataclasses import dataclass, replace
from weakref import WeakKeyDictionary

import numpy as np

from twolink.errors import AccuracyError, SceneError, shown
from twolink.integrate.core.smooth import solve_smooth
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.pinocchio_rate import fastest_decay
from twolink.integrate.motion.pinocchio_rate import rate as rate_by_pinocchio
from twolink.integrate.motion.state import Array
from twolink.integrate.solution import Progress, Segment, Solution, in_segments
from twolink.integrate.solvers import scipy_solver, taylor
from twolink.integrate.solvers.taylor import ROUNDING_UNIT, Precision
from twolink.integrate.steps.methods import METHODS, Method, known_as, method_named
from twolink.integrate.steps.perturbation import NO_PERTURBATION, Companions, Perturbation
from twolink.integrate.steps.stepping import SMALLEST_TOLERANCE
from twolink.native.library import library
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
        The method cannot solve these equations.
    """
    if not (isinstance(setting, (int, float)) and math.isfinite(setting) and setting > 0):
        name = "tolerance" if method.adaptive else "step"
        raise AccuracyError(f"expected a number above 0, got {setting!r:.60}", argument=name, remedy="such as 1e-6")
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


# How many times smaller than the accuracy the first tolerance is: the errors of steps add up, and an estimate of low
# order is that of the less accurate solution. On the arm, UR5 and Panda a run's error is below a third of the margin
# times its tolerance.
MARGINS = {"taylor": 3.0, "dop853": 30.0}
MARGIN = 100.0
MAX_TOLERANCE = 1e-4  # a larger one saves little, and does not predict a run's error
ATTEMPT, EVALUATION, OPERATION = 3e-7, 3e-8, 1.2e-9  # s: of an attempted step, an evaluation in it, an operation
SLOPE = 1.5  # operations of a column of the Jacobian, of those of the rate
# Attempts for the arm's 10 s at tolerance 1e-3, and the growth of attempts with 1 / tolerance.
ATTEMPTS = {"rk45": (87, 0.195), "dop853": (87, 0.105), "esdirk43": (146, 0.24)}
MEASURED = 10.0  # s, of the arm's motion
STABLE = {"rk45": 3.3, "dop853": 6.1}  # decay times that a step can be long: the real stability interval
SCIPY = {"rk45": "scipy-dop853", "dop853": "scipy-dop853", "esdirk43": "scipy-radau"}  # without the native library


@dataclass(frozen=True)
class MethodChoice:
    """A method, its setting (the tolerance of an adaptive method, or the step of another, s), and why it was chosen."""

    method: Method
    setting: float
    why: str
    precision: Precision = "double"


def choose(
    equations: Equations, accuracy: float, duration: float, name: str, precision: Precision = "double"
) -> MethodChoice:
    """The method and its setting for an accuracy.

    Parameters
    ----------
    equations : Equations
    accuracy : float
        Bound on the global error of q, rad or m.
    duration : float
        Simulated time, s.
    name : str
        A method; or "auto", the cheapest one.
    precision : {"double", "extended", "quad"}

    Returns
    -------
    MethodChoice

    Raises
    ------
    SceneError
        The method is unknown, or works in double precision only.

    Notes
    -----
    "auto" takes the cheapest of RK45, DOP853 and, where a mode decays, ESDIRK43, for which explicit steps may be too
    many. Without the native library it takes SciPy's DOP853 or Radau; for events and sampled controllers ours.
    """
    if precision not in ROUNDING_UNIT:
        remedy = f"""one of "auto", {", ".join(f'"{one}"' for one in ROUNDING_UNIT)}"""
        raise SceneError(f"{shown(precision)} is unknown", argument="precision", remedy=remedy)
    if precision != "double":
        if name not in ("auto", "taylor"):
            raise SceneError(f"{name} works in double precision", argument="method", remedy='method="taylor" or "auto"')
        return MethodChoice(METHODS["taylor"], accuracy / MARGINS["taylor"], f"{precision} precision", precision)
    if name != "auto":
        method = method_named(name)
        return MethodChoice(method, first_setting(equations, method, accuracy), f"asked for{known_as(name)}")
    return _cheapest(equations, accuracy, duration)


def _cheapest(equations: Equations, accuracy: float, duration: float) -> MethodChoice:
    """The cheapest method by the built-in figures."""
    decay = _decay(equations)
    costs = {name: _steps_seconds(equations, METHODS[name], accuracy, duration) for name in ATTEMPTS
             if name != "esdirk43" or decay > 0.0}  # fmt: skip
    best = min(costs, key=lambda name: costs[name])
    others = ", ".join(f"{name} {cost / costs[best]:.1f}x" for name, cost in costs.items() if name != best)
    why = f"cheapest by the built-in figures ({others})"
    if best == "esdirk43":
        why = f"stiff: a mode decays at {decay:.1g} 1/s, and explicit steps are as short ({others})"
    if library() is None and not equations.has_events and equations.sampling is None:
        best, why = SCIPY[best], "there is no native library"
    return MethodChoice(METHODS[best], first_tolerance(METHODS[best], accuracy), why)


_decays: WeakKeyDictionary[Equations, float] = WeakKeyDictionary()


def _decay(equations: Equations) -> float:
    """The fastest decay [1/s], kept as long as the equations."""
    if equations not in _decays:
        _decays[equations] = fastest_decay(equations)
    return _decays[equations]


def attempts_of(equations: Equations, method: Method, tolerance: float, duration: float) -> float:
    """Attempted steps of one solution by the built-in figures, of a method that they are of."""
    attempts, growth = ATTEMPTS[method.name]
    steps = attempts * (1e-3 / tolerance) ** growth * duration / MEASURED
    return float(max(steps, _decay(equations) * duration / STABLE.get(method.name, math.inf)))


def _steps_seconds(equations: Equations, method: Method, accuracy: float, duration: float) -> float:
    """Seconds of the steps of one solution by the built-in figures."""
    steps = attempts_of(equations, method, first_tolerance(method, accuracy), duration)
    if equations.sampling is not None:  # steps end at ticks
        steps = max(steps, equations.sampling.ticks_per_second * duration)
    operations, size = max(1, equations.operations), equations.moving
    work = (operations * OPERATION + EVALUATION) * method.evaluations
    if method.kind == "implicit":  # the Jacobian, its factors, and a solution an iteration
        work += (size * SLOPE * operations + size**3 / 3 + method.evaluations * size**2) * OPERATION
    return float(steps * (work + ATTEMPT))


def first_tolerance(method: Method, accuracy: float) -> float:
    """The tolerance to try first."""
    return max(min(accuracy / MARGINS.get(method.name, MARGIN), MAX_TOLERANCE), smallest_tolerance(method))


def first_setting(equations: Equations, method: Method, accuracy: float) -> float:
    """The tolerance, or step, to try first."""
    if method.adaptive:
        return first_tolerance(method, accuracy)
    start = equations.start[:, None]
    change = (np.abs(rate_by_pinocchio(equations, 0.0, start)) / (1.0 + np.abs(start))).max(initial=0.0)
    scale = 1.0 / max(1.0, float(change) if math.isfinite(change) else 1.0)
    return float(0.3 * scale * min(1.0, accuracy) ** (1 / method.order))
