"""Which method, at which setting, for an accuracy: from what studies measured here, else from a built-in calibration.

The built-in figures were measured on the paper's arm over 10 s: attempted steps at a tolerance of 1e-3, the power of
the tolerance by which they grow, and seconds a call and an operation. The duration of a scene multiplies them all
alike, so that they say which method is cheapest, not how long a run takes.
"""

import functools
import math
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from twolink.dynamics.kernels import heyoka
from twolink.errors import SceneError
from twolink.integrate import calibration, taylor
from twolink.integrate.compile_time import MAX_COMPILING, MAX_IN_PARTS, in_parts, is_reproducible, parts_seconds
from twolink.integrate.compiled_functions import is_at_hand
from twolink.integrate.equations import Equations
from twolink.integrate.first_steps import rate_name, spent
from twolink.integrate.methods import METHODS, Method, method_named
from twolink.integrate.pinocchio_rate import fastest
from twolink.integrate.pinocchio_rate import rate as rate_by_pinocchio
from twolink.integrate.solver import smallest_tolerance

# How many times smaller than the accuracy the first tolerance is: the errors of steps add up, and an estimate of low
# order is that of the less accurate solution. On the arm, UR5 and Panda a run's error is below a third of the margin
# times its tolerance.
MARGINS = {"taylor": 3.0, "dop853": 30.0}
MARGIN = 100.0
MAX_TOLERANCE = 1e-4  # a larger one saves little, and does not predict a run's error
CALL, OPERATION = 2.5e-6, 4e-10  # s: calling a step map, and an operation in it
# Attempts for the arm's 10 s at tolerance 1e-3, and the growth of attempts with 1 / tolerance.
ATTEMPTS = {"rk45": (87, 0.195), "dop853": (87, 0.105)}
STIFF = 1e6  # decay times in a run: an explicit method takes a step in each
TAYLOR_STEPS, TAYLOR_OPERATION = 370, 1.5e-10  # times the order squared, and twice that when compiled compactly


@dataclass(frozen=True)
class MethodChoice:
    """A method, its setting (the tolerance of an adaptive method, or the step of another, s), and why it was chosen."""

    method: Method
    setting: float
    why: str
    precision: taylor.Precision = "double"


def choose(
    equations: Equations, accuracy: float, duration: float, name: str, precision: taylor.Precision = "double"
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
    precision : {"double", "quad"}

    Returns
    -------
    MethodChoice

    Raises
    ------
    SceneError
        The method is unknown, or works in double precision only.

    Notes
    -----
    "auto" takes ESDIRK43 for stiff scenes, the fastest method that a study of this scene measured, or else the
    cheapest by the built-in calibration. Without heyoka, and where compiling would take long, it takes SciPy's DOP853;
    for events, and under constraints whose rate can be compiled, ours.
    """
    if precision == "quad":
        if name not in ("auto", "taylor"):
            raise SceneError(f"{name} works in double precision", argument="method", remedy='method="taylor" or "auto"')
        return MethodChoice(METHODS["taylor"], accuracy / MARGINS["taylor"], "quadruple precision", "quad")
    if precision != "double":
        raise SceneError(f"{precision!r} is unknown", argument="precision", remedy='"double" or "quad"')
    if name != "auto":
        method = method_named(name)
        return MethodChoice(method, first_setting(equations, method, accuracy), "asked for")
    if heyoka() is None:
        return _without_whole_steps(equations, accuracy, "heyoka is not installed")
    decay = _decay(equations)
    if decay * duration > STIFF:
        method = METHODS["esdirk43"]
        why = f"stiff: a mode decays at {decay:.1g} 1/s, and explicit steps would have to be as short"
        return MethodChoice(method, first_setting(equations, method, accuracy), why)
    entry = None if is_reproducible() else calibration.cheapest(equations, duration, accuracy)
    if entry is not None:
        return MethodChoice(METHODS[entry.method], entry.setting, "measured on this scene by an accuracy study")
    if in_parts(equations, METHODS["dop853"]):
        why = (
            f"compiling steps of {equations.operations:,} operations an evaluation would take over {MAX_COMPILING:g} s"
        )
        return _without_whole_steps(equations, accuracy, why)
    return _by_calibration(
        equations.operations, equations.space.nv >= taylor.COMPACT_FROM, equations.analytic, accuracy
    )


def _without_whole_steps(equations: Equations, accuracy: float, why: str) -> MethodChoice:
    """DOP853 where whole steps are not compiled: ours in parts under constraints, if they can be, and for events.

    Else SciPy's on Pinocchio's forward dynamics, which compiles nothing, until its runs have cost what compiling the
    rate takes; it does not locate events.
    """
    seconds = math.inf if heyoka() is None else parts_seconds(equations)
    ours = equations.has_events or (equations.constraints is not None and seconds <= MAX_IN_PARTS)
    if not ours and seconds <= MAX_COMPILING:
        name = rate_name(equations)
        ours = is_reproducible() or is_at_hand(name) or spent(name) > seconds
    method = METHODS["dop853" if ours else "scipy-dop853"]
    if ours and seconds <= MAX_IN_PARTS:
        why += f"; the rate alone takes about {seconds:.0f} s, once"
    return MethodChoice(method, first_setting(equations, method, accuracy), why)


@functools.lru_cache(1024)
def _by_calibration(operations: int, compact: bool, analytic: bool, accuracy: float) -> MethodChoice:
    """The cheapest method for equations of so many operations an evaluation."""
    tolerances = {
        name: first_tolerance(METHODS[name], accuracy) for name in ((*ATTEMPTS, "taylor") if analytic else ATTEMPTS)
    }
    costs = {name: expected_seconds(METHODS[name], t, operations, compact) for name, t in tolerances.items()}
    best = min(costs, key=lambda name: costs[name])
    others = ", ".join(f"{name} {cost / costs[best]:.1f}x" for name, cost in costs.items() if name != best)
    return MethodChoice(METHODS[best], tolerances[best], f"cheapest by the built-in calibration ({others})")


_decays: WeakKeyDictionary[Equations, float] = WeakKeyDictionary()


def _decay(equations: Equations) -> float:
    """The fastest decay at the start, 1/s, kept as long as the equations; 0 where the fastest mode does not decay."""
    if equations.space.size == 0:
        return 0.0
    if equations not in _decays:
        rates, decays = fastest(equations, equations.start[:, None])
        _decays[equations] = float(rates[0]) if decays[0] else 0.0
    return _decays[equations]


def expected_seconds(method: Method, tolerance: float, operations: int, compact: bool) -> float:
    """Seconds for what takes the arm 10 s of simulated time, by the built-in calibration."""
    if method.kind == "taylor":
        order = taylor.order_of(tolerance)
        return TAYLOR_STEPS * max(1, operations) * order**2 * TAYLOR_OPERATION * (2 if compact else 1)
    attempts, growth = ATTEMPTS[method.name]
    return float(attempts * (1e-3 / tolerance) ** growth * (CALL + operations * method.evaluations * OPERATION))


def first_tolerance(method: Method, accuracy: float) -> float:
    """The tolerance to try first."""
    return max(min(accuracy / MARGINS.get(method.name, MARGIN), MAX_TOLERANCE), smallest_tolerance(method))


def second_tolerance(method: Method, first: float) -> float:
    """The tolerance of the second solution behind an error bar.

    Where the first error is small by chance, it must still be larger than the second one. Of 700 motions by DOP853 a
    bar was too small in 20 with a tenth of the tolerance, in 2 with a 30th and in none with a 100th, which takes 1.8
    times as many steps at order 8; at low order it would take too many. Taylor's order rises by 2 or 3.
    """
    return first / _second_ratio(method)


def steps_ratio(method: Method) -> float:
    """How many times as many of the longest steps the second solution takes: as many as of those by tolerance.

    By Taylor's method their order is another one, and their number may be the same.
    """
    return 1.0 if method.kind == "taylor" else float(_second_ratio(method) ** (1 / method.order))


def _second_ratio(method: Method) -> float:
    return 100.0 if method.order >= 8 else 30.0


def first_setting(equations: Equations, method: Method, accuracy: float) -> float:
    """The tolerance, or step, to try first."""
    if method.adaptive:
        return first_tolerance(method, accuracy)
    start = equations.start[:, None]
    change = (np.abs(rate_by_pinocchio(equations, 0.0, start)) / (1.0 + np.abs(start))).max(initial=0.0)
    scale = 1.0 / max(1.0, float(change) if math.isfinite(change) else 1.0)
    return float(0.3 * scale * min(1.0, accuracy) ** (1 / method.order))
