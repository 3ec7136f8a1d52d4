"""Choice of the method and its setting for an accuracy.

The figures were measured on the paper's arm over 10 s: attempted steps at a tolerance of 1e-3, the power of the
tolerance by which they grow, and seconds an attempt and an operation. They say which method is cheapest, not how long a
run takes. Where a mode decays fast, explicit steps are as short as their stability calls for, whatever the tolerance.
"""

import math
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from twolink.errors import SceneError, shown
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.pinocchio_rate import fastest_decay
from twolink.integrate.motion.pinocchio_rate import rate as rate_by_pinocchio
from twolink.integrate.solver import smallest_tolerance
from twolink.integrate.solvers.taylor import ROUNDING_UNIT, Precision
from twolink.integrate.steps.methods import METHODS, Method, known_as, method_named
from twolink.native.library import library

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
