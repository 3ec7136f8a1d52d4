"""Locating: the first zero of guards along the steps of a piece, to the last digits of time.

A guard is above 0 while its mode lasts. It is looked at where steps end and at points within them, each a step of the
method from the state before it, so that a zero is as exact as the method. A dip between such points is followed to
its bottom, lest two zeros within a step be missed. Whether a dip that ends just above 0 touches is for the error bar to
say: the solution behind it takes one within its margin for a touch, where the other does not.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from twolink.integrate.equations import Equations
from twolink.integrate.hybrid.snapshot import Moment
from twolink.integrate.state import Array
from twolink.integrate.step_map import StepMap

WITHIN = (0.25, 0.5, 0.75)  # of a step
DIP = 0.3  # of what a guard changes around a low point: it may reach 0 between the points there
EXACT = 4 * np.finfo(float).eps
TOUCHING = ("stop", "impact", "stick")  # guards that are distances or speeds


@dataclass
class Guard:
    """What ends a mode where it passes 0.

    key: what it is. value: of a moment, (n,). side: the sign of the value while the mode lasts; None where it
    is not known before the first look. fresh: it begins at 0, which is not its zero: v / (t - start) is looked at, once
    v has been farther from 0 than `noise`, which is all it ever is where nothing moves.
    """

    key: tuple[str, int]
    value: Callable[[Moment], Any]
    side: float | None = 1.0
    fresh: bool = False
    noise: float = 0.0
    stirred: bool = False


@dataclass(frozen=True)
class Hit:
    """The first event of a piece: its time, the state there, and the guard."""

    t: float
    x: Array
    guard: Guard


class Watcher:
    """The guards of a piece that starts at a time. margin: dips to it are touches, m, rad or per second."""

    def __init__(
        self, equations: Equations, step_map: StepMap, guards: Sequence[Guard], start: float, margin: float = 0.0
    ) -> None:
        self.equations, self.map, self.guards, self.start, self.margin = equations, step_map, guards, start, margin
        self._before: tuple[float, Array] | None = None  # where the last step began: a dip may lie at its end

    def first(self, t: Array, x: Array) -> Hit | None:
        """The first event along states x (k, size) at times t (k,), which do not decrease; None if there is none."""
        if not self.guards or len(t) < 2:
            return None
        moved = np.append(np.diff(t) > 0, True)
        t, x = t[moved], x[moved]
        if len(t) < 2:
            return None
        before, self._before = self._before, (float(t[-2]), np.array(x[-2]))
        if before is not None and before[0] < t[0]:
            t, x = np.append(before[0], t), np.concatenate([before[1][None], x])
        times, states = self._within(t, x)
        moment = Moment(self.equations, times, states)
        found: list[tuple[float, float, float, int]] = []
        for j, guard in enumerate(self.guards):
            bracket = self._bracket(guard, times, self._stirred(guard, moment), t, x)
            if bracket is not None:
                found.append((*bracket, j))
        if not found:
            return None
        earliest = min(end for _, end, _, _ in found)
        roots = [(self._root(self.guards[j], a, b, t, x, level), j) for a, b, level, j in found if a <= earliest]
        time, j = min(roots)
        return Hit(time, self._at(time, t, x), self.guards[j])

    def _within(self, t: Array, x: Array) -> tuple[Array, Array]:
        """Times (m,) and states (size, m): the given ones, and those within the steps."""
        shares = np.array(WITHIN)
        inner = t[:-1, None] + shares * np.diff(t)[:, None]
        steps = np.repeat(np.arange(len(t) - 1), len(shares))
        between = self.map.partial(x[steps].T, t[steps], inner.ravel())
        times = np.concatenate([np.concatenate([t[:-1, None], inner], axis=1).ravel(), t[-1:]])
        states = np.empty((x.shape[1], len(times)))
        ends = np.arange(len(t)) * (len(shares) + 1)
        states[:, ends] = x.T
        states[:, np.setdiff1d(np.arange(len(times)), ends)] = between
        return times, states

    def _stirred(self, guard: Guard, moment: Moment) -> Array:
        """The guard's values; infinite as long as it has been nothing but the noise it began with."""
        with np.errstate(all="ignore"):
            raw = np.broadcast_to(np.asarray(guard.value(moment), dtype=float), moment.t.shape)
        quiet = np.zeros(len(raw), dtype=bool)
        if guard.fresh and not guard.stirred:
            quiet = ~np.logical_or.accumulate((np.abs(raw) > guard.noise) & (moment.t > self.start))
            guard.stirred = not quiet.all()
        if guard.side is None:
            seen = raw[~quiet & np.isfinite(raw) & (raw != 0.0)]
            guard.side = float(np.sign(seen[0])) if seen.size else None
        values = self._values(guard, moment)
        values[quiet] = math.inf
        return values

    def _values(self, guard: Guard, moment: Moment) -> Array:
        """The guard's values, above 0 while the mode lasts."""
        with np.errstate(all="ignore"):
            values = np.broadcast_to(np.asarray(guard.value(moment), dtype=float), moment.t.shape).copy()
        values *= guard.side or 1.0
        if guard.fresh:
            late = moment.t > self.start
            values[late] /= moment.t[late] - self.start
            values[~late] = math.inf
        return values

    def _bracket(self, guard: Guard, times: Array, g: Array, t: Array, x: Array) -> tuple[float, float, float] | None:
        """Times between which the guard first passes a level, and the level: 0, or the margin of a near touch."""
        margin = self.margin if guard.key[0] in TOUCHING and not guard.fresh else 0.0
        below = np.flatnonzero(g <= 0.0)  # NaN is neither
        last = int(below[0]) if below.size else len(g)
        if last == 0:  # the mode has no beginning: it ends at once
            return float(times[0]), float(times[0]), 0.0
        for i in range(1, min(last, len(g) - 1)):
            before, here, after = g[i - 1], g[i], g[i + 1]
            if not (here < before and here <= after and math.isfinite(before) and math.isfinite(after)):
                continue
            if here < max(margin, DIP * (max(before, after) - here)):
                bottom, value = self._bottom(guard, float(times[i - 1]), float(times[i + 1]), t, x)
                if value <= 0.0:
                    return float(times[i - 1]), bottom, 0.0
                if value <= margin < before:
                    return float(times[i - 1]), bottom, margin
        return (float(times[last - 1]), float(times[last]), 0.0) if last < len(g) else None

    def _bottom(self, guard: Guard, a: float, b: float, t: Array, x: Array) -> tuple[float, float]:
        from scipy.optimize import minimize_scalar

        found = minimize_scalar(lambda time: self._value(guard, time, t, x), bounds=(a, b), method="bounded",
                                options={"xatol": 1e-6 * (b - a)})  # fmt: skip
        return float(found.x), float(found.fun)

    def _root(self, guard: Guard, a: float, b: float, t: Array, x: Array, level: float) -> float:
        """Where the guard passes a level between two times."""
        from scipy.optimize import brentq

        if a == b:
            return a
        low, high = (self._value(guard, time, t, x) - level for time in (a, b))
        if not low > 0.0:
            return a
        if not high <= 0.0:
            return b
        if math.isinf(low):  # at the start, of a guard that begins at 0
            low = max(1e-300, -high)
        ends = {a: low, b: high}
        found = brentq(lambda time: ends.get(time) or self._value(guard, time, t, x) - level, a, b,
                       xtol=EXACT * max(1.0, abs(b)), rtol=EXACT)  # fmt: skip
        return float(found)

    def _value(self, guard: Guard, time: float, t: Array, x: Array) -> float:
        moment = Moment(self.equations, np.array([time]), self._at(time, t, x)[:, None])
        return float(self._values(guard, moment)[0])

    def _at(self, time: float, t: Array, x: Array) -> Array:
        """The state at a time."""
        step = min(max(0, int(np.searchsorted(t, time, side="right")) - 1), len(t) - 2)
        if time == t[step]:
            return np.array(x[step])
        return np.asarray(self.map.partial(x[step][:, None], t[step : step + 1], np.array([time]))[:, 0])
