"""Which method, at which setting, for an accuracy: from what studies measured here, else from a built-in calibration.

The built-in figures were measured on the paper's arm over 10 s: attempted steps at a tolerance of 1e-3, the power of
the tolerance by which they grow, and seconds a call and an operation. They say which method is cheapest, not how long a
run takes. Where a mode decays fast, explicit steps are as short as their stability calls for, whatever the tolerance.
"""

import functools
import math
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from twolink.dynamics.kernels import heyoka
from twolink.errors import SceneError
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.pinocchio_rate import rate as rate_by_pinocchio
from twolink.integrate.solver import smallest_tolerance
from twolink.integrate.solvers import calibration, taylor_code
from twolink.integrate.solvers.taylor import ROUNDING_UNIT
from twolink.integrate.steps.compile_time import (
    EVALUATION,
    MAX_COMPILING,
    MAX_IN_PARTS,
    in_parts,
    is_reproducible,
    parts_seconds,
    step_seconds,
)
from twolink.integrate.steps.methods import METHODS, Method, method_named
from twolink.integrate.steps.stiffness import fastest_decay

# How many times smaller than the accuracy the first tolerance is: the errors of steps add up, and an estimate of low
# order is that of the less accurate solution. On the arm, UR5 and Panda a run's error is below a third of the margin
# times its tolerance.
MARGINS = {"taylor": 3.0, "dop853": 30.0}
MARGIN = 100.0
MAX_TOLERANCE = 1e-4  # a larger one saves little, and does not predict a run's error
CALL, OPERATION = 2.5e-6, 4e-10  # s: calling a step map, and an operation in it
# Attempts for the arm's 10 s at tolerance 1e-3, and the growth of attempts with 1 / tolerance.
ATTEMPTS = {"rk45": (87, 0.195), "dop853": (87, 0.105), "esdirk43": (146, 0.24), "taylor": (370, 0.0)}
EXPLICIT = ("rk45", "dop853")
MEASURED = 10.0  # s, of the arm's motion
SOLUTIONS = 3  # behind an answer with its error bar, about
STABLE = {"rk45": 3.3, "dop853": 6.1, "taylor": 4.0}  # decay times that a step can be long: the real stability interval
TAYLOR_OPERATION = 1.5e-10  # s, times the order squared, and twice that when compiled compactly


@dataclass(frozen=True)
class MethodChoice:
    """A method, its setting (the tolerance of an adaptive method, or the step of another, s), and why it was chosen."""

    method: Method
    setting: float
    why: str
    precision: taylor_code.Precision = "double"


def choose(
    equations: Equations, accuracy: float, duration: float, name: str, precision: taylor_code.Precision = "double"
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
    "auto" takes the fastest method that a study of this scene measured, or else the cheapest by the built-in
    calibration: ESDIRK43 where stability makes explicit steps too many. Where whole steps take long to compile it takes
    DOP853 or ESDIRK43 in parts. Without heyoka, and where the rate takes long to compile, it takes SciPy's DOP853 or
    Radau; for events and sampled controllers ours.
    """
    if precision not in ROUNDING_UNIT:
        remedy = f"""one of "auto", {", ".join(f'"{one}"' for one in ROUNDING_UNIT)}"""
        raise SceneError(f"{precision!r} is unknown", argument="precision", remedy=remedy)
    if precision != "double":
        if name not in ("auto", "taylor"):
            raise SceneError(f"{name} works in double precision", argument="method", remedy='method="taylor" or "auto"')
        return MethodChoice(METHODS["taylor"], accuracy / MARGINS["taylor"], f"{precision} precision", precision)
    if name != "auto":
        method = method_named(name)
        return MethodChoice(method, first_setting(equations, method, accuracy), "asked for")
    entry = None if heyoka() is None or is_reproducible() else calibration.cheapest(equations, duration, accuracy)
    if entry is not None:
        return MethodChoice(METHODS[entry.method], entry.setting, "measured on this scene by an accuracy study")
    return _cheapest(equations, accuracy, duration)


def _cheapest(equations: Equations, accuracy: float, duration: float) -> MethodChoice:
    """The cheapest explicit method by the built-in calibration, or ESDIRK43 where its first answer comes sooner."""
    portable = heyoka() is None or parts_seconds(equations) > (MAX_IN_PARTS if _is_bound(equations) else MAX_COMPILING)
    whole = not (portable or in_parts(equations, METHODS["dop853"]))
    names = [*EXPLICIT, *(["taylor"] if equations.analytic else [])] if whole else ["dop853"]
    decay = _decay(equations)
    costs = {name: _steps_seconds(equations, METHODS[name], accuracy, duration, decay) for name in names}
    best = min(costs, key=lambda name: costs[name])
    others = ", ".join(f"{name} {cost / costs[best]:.1f}x" for name, cost in costs.items() if name != best)
    why = f"cheapest by the built-in calibration ({others})"
    if not whole:
        why = f"whole steps would compile for over {MAX_COMPILING:g} s; "
        why += f"the rate alone takes about {parts_seconds(equations):.0f} s, once"
    if decay > 0.0:
        explicit, implicit = (_first_answer(equations, METHODS[name], accuracy, duration, decay)
                              for name in (best, "esdirk43"))  # fmt: skip
        if implicit < explicit:
            cost = f"{best} {explicit / implicit:.1f}x"
            best, why = "esdirk43", f"stiff: a mode decays at {decay:.1g} 1/s, and explicit steps are as short ({cost})"
    if portable and not equations.has_events and equations.sampling is None:
        why = "heyoka is not installed" if heyoka() is None else "compiling its equations would take long"
        best = {"dop853": "scipy-dop853", "esdirk43": "scipy-radau"}[best]
    return MethodChoice(METHODS[best], first_tolerance(METHODS[best], accuracy), why)


def _is_bound(equations: Equations) -> bool:
    """Whether the equations have constraints or events, whose steps would take as long uncompiled."""
    return equations.has_events or equations.constraints is not None


_decays: WeakKeyDictionary[Equations, float] = WeakKeyDictionary()


def _decay(equations: Equations) -> float:
    """The fastest decay [1/s], kept as long as the equations."""
    if equations not in _decays:
        _decays[equations] = fastest_decay(equations)
    return _decays[equations]


def _first_answer(equations: Equations, method: Method, accuracy: float, duration: float, decay: float) -> float:
    """Seconds to a first answer, with compiling: by whole steps, or by steps in parts."""
    run = functools.partial(_steps_seconds, equations, method, accuracy, duration, decay)
    parts = parts_seconds(equations) + SOLUTIONS * run(parts=True)
    if in_parts(equations, method):
        return parts
    return min(parts, step_seconds(equations, method) + SOLUTIONS * run())


def _steps_seconds(
    equations: Equations, method: Method, accuracy: float, duration: float, decay: float, *, parts: bool = False
) -> float:
    """Seconds of the steps of one solution by the built-in calibration. decay: of the fastest mode, 1/s."""
    tolerance, (attempts, growth) = first_tolerance(method, accuracy), ATTEMPTS[method.name]
    steps = attempts * (1e-3 / tolerance) ** growth * duration / MEASURED
    steps = max(steps, decay * duration / STABLE.get(method.name, math.inf))
    if equations.sampling is not None:  # steps end at ticks
        steps = max(steps, equations.sampling.ticks_per_second * duration)
    operations, size = max(1, equations.operations), equations.space.size
    if method.kind == "taylor":
        price = TAYLOR_OPERATION * (2 if equations.space.nv >= taylor_code.COMPACT_FROM else 1)
        return float(steps * operations * taylor_code.order_of(tolerance) ** 2 * price)
    work = operations * method.evaluations
    if method.kind == "implicit":  # the Jacobian by central differences, and its factors
        work += size * (2 * operations + size**2)
    return float(steps * (work * OPERATION + (method.evaluations * EVALUATION if parts else CALL)))


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
