"""Refinement: what is tried next where an error bar is above the accuracy, and the error where nothing is left.

Smaller settings come first, as long as truncation is a part of the bar that they can make smaller. Then methods of
higher order, the last of them Taylor's; where rounding is in the way, in numbers of more digits: 31, then 47.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from twolink.errors import AccuracyError
from twolink.integrate.motion.equations import Equations
from twolink.integrate.solution import UNSTABLE
from twolink.integrate.solver import MethodChoice, choose, first_setting, smallest_tolerance
from twolink.integrate.solvers.taylor import ROUNDING_UNIT, Precision
from twolink.integrate.steps.failures import MAX_STEPS
from twolink.integrate.steps.methods import METHODS, Method
from twolink.native.library import library
from twolink.simulation.error_bar import DECIDES, PARTED
from twolink.simulation.trajectory import Trajectory
from twolink.simulation.verified import Verified

PATIENCE = 600.0  # s of wall clock, unless a caller has another one
ROOM = 10.0  # times the smallest tolerance: the finer solution must be able to be finer
AIM = 0.3  # of the accuracy, for the next bar
USUAL_GROWTH = 30.0  # of the error of a run in many digits over its tolerance, at least
UNKNOWN = 100.0  # times the growth that solutions show which have parted
COARSEST = 1.0  # rad or m: a larger accuracy says nothing
MOST = 0.8  # of the accuracy, that rounding may take
CHANCE = 2.0  # times the accuracy: the bar of the same rounding may be half as large by other random numbers
TRIALS = 8  # settings of a method, at most
WORSE, STRIKES = 0.9, 2  # of the best bar: a setting is no better; so many of them may be, as steps meet singularities
OTHERS = ("dop853", "rk45", "esdirk43")  # where one method does not get to the accuracy by smaller settings
REACHED = {"double": 3e-15, "extended": 3e-29}  # rad or m: a smaller accuracy is not tried in these numbers
DIGITS: dict[Precision, str] = {"double": "16 digits", "extended": "31 digits", "quad": "47 digits"}


@dataclass(eq=False)
class Refinement:
    """The search for a method and a setting that keep an accuracy.

    Parameters
    ----------
    equations : Equations
    accuracy : float
        rad or m.
    any_method : bool
        Whether other methods may be tried.
    precisions : tuple of str
        In which numbers may be tried after the first ones, in order.
    """

    equations: Equations
    accuracy: float
    any_method: bool = False
    precisions: tuple[Precision, ...] = ()
    tried: list[str] = field(default_factory=list)
    best: Trajectory | None = None
    lost: AccuracyError | None = None
    _digits: Precision = "double"
    _settings: int = 0
    _last: float = np.inf
    _finite: float = 0.0  # the last setting whose bar was finite
    _worse: int = 0
    _left: Iterator[MethodChoice] | None = None
    _verified: Verified | None = None  # the last one

    def seen(self, choice: MethodChoice, run: Trajectory | None) -> None:
        """Take note of what was tried, and of the run that is within the accuracy for longest."""
        setting = f"{'tolerance' if choice.method.adaptive else 'step'} {choice.setting:.1e}"
        digits = "" if choice.precision == "double" else f" with {DIGITS[choice.precision]}"
        self._digits = choice.precision
        self.tried.append(f"{choice.method.name}{digits} at {setting}")
        if run is None:
            return
        if self.best is not None:
            run, self.best = self._agreeing(run, self.best)
        if self.best is None or _worth(run) > _worth(self.best):
            self.best = run

    def _agreeing(self, run: Trajectory, other: Trajectory) -> tuple[Trajectory, Trajectory]:
        """The two runs with bars that do not contradict each other.

        Where their distance is above the sum of their bars, one of the bars does not hold, and it is not known which.
        Each bar is then widened to the distance plus the other one.
        """
        if run.error is None or other.error is None:
            return run, other
        n = min(len(run.t), len(other.t))  # an event may end one of them
        apart = self.equations.space.distance(run.q[:n], other.q[:n])
        if not np.any(apart > run.error[:n] + other.error[:n]):
            return run, other
        return (replace(run, error=_at_least(run.error, apart + other.error[:n])),
                replace(other, error=_at_least(other.error, apart + run.error[:n])))  # fmt: skip

    def after(self, one: Verified) -> MethodChoice | None:
        """The choice to try after a run; None where nothing is left."""
        self._settings, self.lost, self._verified = self._settings + 1, one.lost, one
        smaller = self._smaller(one)
        if smaller is not None and _steps_at(one, smaller.setting) > MAX_STEPS:
            return self._other(self._by_taylor(one))
        return smaller or self._other(self._others(one.choice.method, one))

    def _rounding(self, one: Verified) -> float:
        """The largest part of the bar that is rounding, rad or m."""
        return _largest(one.rounding) + float(one.common_rounding(self.equations.space).max(initial=0.0))

    def after_failure(self, choice: MethodChoice, code: str | None = None) -> MethodChoice | None:
        """The choice to try after a run that could not be solved: another method.

        Where the steps were too many, methods of lower order would take more of them: Taylor's takes fewer.
        """
        if code == "too-many-steps" and self.precisions:
            most = UNKNOWN * MAX_STEPS  # tolerances, as no run shows less
            why = f"{choice.method.name} takes too many steps"
            same: tuple[Precision, ...] = ("double",) if choice.method.kind != "taylor" else ()
            unknown = (by_taylor(self.accuracy, one, why, most) for one in (*same, *self.precisions))
            return self._other(self._by_taylor(self._verified) if self._verified else unknown)
        return self._other(self._others(choice.method))

    def _other(self, every: Iterator[MethodChoice]) -> MethodChoice | None:
        """The next of what is left to try, which the first call says."""
        self._left, self._settings, self._last, self._worse = self._left or every, 0, np.inf, 0
        self._finite = 0.0
        return next(self._left, None)

    def _smaller(self, one: Verified) -> MethodChoice | None:
        """A smaller setting of the same method; None where that does not help."""
        choice, method = one.choice, one.choice.method
        truncation, rounding = _largest(one.truncation), self._rounding(one)
        bar = truncation + rounding
        if self.equations.sampling is not None and method.order < METHODS["dop853"].order and self.any_method:
            return None  # steps end at ticks: more order costs less there than more steps
        if self._settings >= TRIALS:
            return None
        if not self._kinks and truncation < DECIDES * rounding and rounding > MOST * self.accuracy:
            return None
        if self._settings > 1 and not bar <= WORSE * self._last:
            self._worse += 1
            is_rounding = not self._kinks and rounding > max(MOST * bar, CHANCE * self.accuracy)
            if self._worse > STRIKES or is_rounding:
                return None
        self._last = min(bar, self._last)
        if not np.isfinite(bar) and method.adaptive and self._finite > choice.setting:
            # Steps of a smaller tolerance may not get across a singular position: try between.
            return replace(choice, setting=float(np.sqrt(choice.setting * self._finite)))
        self._finite = choice.setting if np.isfinite(bar) else 0.0
        ratio = AIM * self.accuracy / bar if np.isfinite(bar) else AIM
        if not method.adaptive:
            setting = choice.setting * min(0.9, ratio ** (1.0 / method.order))
            return replace(choice, setting=setting) if one.solution.t[-1] / setting <= MAX_STEPS else None
        smallest = ROOM * smallest_tolerance(method, choice.precision)
        beside = smallest * (1.0 + 0.5 * self._settings)
        if choice.setting <= 1.01 * smallest or (self._kinks and choice.setting < beside):
            return replace(choice, setting=beside) if self._kinks else None  # other steps meet kinks elsewhere
        ratio **= 1.0 + 1.0 / method.order  # the error of a whole run follows the tolerance by less
        return replace(choice, setting=max(choice.setting * min(AIM, ratio), smallest))

    def _others(self, method: Method, one: Verified | None = None) -> Iterator[MethodChoice]:
        """Methods of higher order, unless rounding is in the way; Taylor's, in more digits too; then the others.

        Where smaller settings did not suffice, those of lower order would take far more steps; they are left for runs
        that were lost.
        """
        rounding = 0.0 if one is None else self._rounding(one)
        others = list[MethodChoice]()
        if self.any_method and method.name in OTHERS and rounding < MOST * self.accuracy:
            names = OTHERS if self.equations.sampling is None else OTHERS[:1]
            others = [MethodChoice(METHODS[name], first_setting(self.equations, METHODS[name], self.accuracy),
                                   f"{method.name} did not reach the accuracy") for name in names
                      if name != method.name]  # fmt: skip
        reached = one is not None and np.isfinite(_largest(one.truncation))
        early = [choice for choice in others if not reached or choice.method.order > method.order]
        yield from early
        if one is not None:
            yield from self._by_taylor(one)
        yield from (choice for choice in others if choice not in early)

    def _by_taylor(self, one: Verified) -> Iterator[MethodChoice]:
        """Taylor's method: in a run's digits, where another method's steps are what it lacks; then in more."""
        rounding, choice = self._rounding(one), one.choice
        if self.precisions and choice.method.kind != "taylor" and rounding < DECIDES * self.accuracy:
            yield by_taylor(self.accuracy, choice.precision, _reached(one), _growth(one))
        for precision in self.precisions:
            more = ROUNDING_UNIT[precision] / ROUNDING_UNIT[choice.precision]
            reaches = not np.isfinite(rounding) or rounding * more <= MOST * self.accuracy
            if more < 1.0 and (reaches or precision == self.precisions[-1]):
                yield by_taylor(self.accuracy, precision, _reached(one), _growth(one))

    @property
    def _kinks(self) -> bool:
        """True if steps may meet kinks of the forces that are not located.

        There a step is accepted or not by chance, and a disturbed solution takes other steps: its distance to the run
        is of truncation, too. It is taken for rounding once smaller settings do not make it smaller.
        """
        return not all(effect.analytic for effect in self.equations.effects)

    def failure(self) -> AccuracyError:
        """The error where nothing is left."""
        run, lost = self.best, self.lost
        if lost is not None and (run is None or run.error is None or not np.isfinite(run.error[-1])):
            return lost
        what = f"{self.accuracy:g} cannot be kept in {self._digits} precision"
        more = "quad" if self._digits == "double" and self.equations.analytic and library() is not None else ""
        also = ['precision="auto"'] if more else []
        data: dict[str, Any] = {"code": "accuracy-limit", "precision": more, "tried": self.tried}
        if run is None or run.error is None:
            return AccuracyError(what, argument="accuracy", remedy=f"ask for {', or '.join(['less accuracy', *also])}",
                                 trusted_until=0.0, **data)  # fmt: skip
        until, bar = run.trusted_until or 0.0, float(run.error[-1])
        said = "".join(f"; {event}" for event in run.events if event.kind == UNSTABLE)
        shorter = f"duration={until:.6g}, up to which it is kept" if until else "a shorter duration"
        less = _rounded_up(bar)
        ways = [shorter, *([f"less accuracy, such as {less:g}"] if less <= COARSEST else []), *also]
        return AccuracyError(
            f"{what}: the smallest error bar is {bar:.1e} at the end, tried were {'; '.join(self.tried[-4:])}{said}",
            where=f"t = {until:.6g} s",
            remedy=f"ask for {', or '.join(ways)}",
            run=run,
            trusted_until=until,
            **data,
        )


def first_choice(
    equations: Equations,
    accuracy: float,
    end: float,
    method: str,
    precision: Precision | Literal["auto"],
    more: tuple[Precision, ...],
) -> MethodChoice:
    """The first choice of method and setting. more: the precisions beyond double that may be tried."""
    if more and accuracy < REACHED["double"]:
        return by_taylor(accuracy, more[-1] if accuracy < REACHED["extended"] else more[0], "the accuracy needs them")
    return choose(equations, accuracy, end, method, "double" if precision == "auto" else precision)


def by_taylor(
    accuracy: float, precision: Precision, why: str = "asked for", growth: float = USUAL_GROWTH
) -> MethodChoice:
    """Taylor's method for an accuracy. growth: of the error of a run over its tolerance."""
    method = METHODS["taylor"]
    tolerance = max(accuracy / max(growth, USUAL_GROWTH), ROOM * smallest_tolerance(method, precision))
    return MethodChoice(method, tolerance, f"{DIGITS[precision]}: {why}", precision)


def precisions_of(equations: Equations) -> tuple[Precision, ...]:
    """The precisions beyond double in which equations can be solved."""
    return ("extended", "quad") if equations.analytic and library() is not None else ()


def _at_least(bar: np.ndarray, other: np.ndarray) -> np.ndarray:
    """An error bar of at least another one (m,) at its first samples, and the last of that after them."""
    other = np.append(other, np.full(len(bar) - len(other), other[-1]))
    return np.maximum.accumulate(np.maximum(bar, other))


def _worth(run: Trajectory) -> tuple[float, float]:
    """Until when a run is within the accuracy; of equal ones, how small its bar is at the end."""
    return run.trusted_until or 0.0, -np.inf if run.error is None else -float(run.error[-1])


def _largest(part: np.ndarray | None) -> float:
    return np.inf if part is None else float(part.max(initial=0.0))


def _growth(one: Verified) -> float:
    """By how much an accuracy has to be above the tolerance, as a run showed.

    Solutions that have parted show no more than that it is large; a tolerance in many digits costs little.
    """
    truncation = _largest(one.truncation)
    if not (np.isfinite(truncation) and one.choice.method.adaptive):
        return 0.0
    growth = truncation / (AIM * one.choice.setting)
    return growth if truncation < PARTED else UNKNOWN * max(growth, float(one.solution.steps))


def _steps_at(one: Verified, tolerance: float) -> float:
    """The number of steps that a run would take at another tolerance of its method, about."""
    method, ratio = one.choice.method, one.choice.setting / tolerance
    return one.solution.steps * ratio ** (1.0 / method.error_order) if method.adaptive else 0.0


def _reached(one: Verified) -> str:
    """The error that the run before reached, in words."""
    reached = _largest(one.truncation) + _largest(one.rounding)
    return f"{one.choice.method.name} with {DIGITS[one.choice.precision]} reached {reached:.1e}"


def _rounded_up(x: float) -> float:
    """A number of one digit above x."""
    power = 10.0 ** np.floor(np.log10(x)) if 0.0 < x < np.inf else 1.0
    return float(np.ceil(1.05 * x / power) * power) if np.isfinite(x) else 1.0
