"""Ambiguous ticks: answers of a controller that differ between solutions by more than continuity explains.

And growth: solutions of an unstable loop part by e^(rate t) until they are as far apart as the motion is large. A
stable loop forgets the rounding of every step, and what no feedback holds grows as a power of time, no faster than t^3.

Where |du| is the distance of the answers and |dx| that of the states so far, |du| / |dx| of a continuous controller is
about its gain. At a threshold or the edge of a quantizer it is larger by orders: |dx| is rounding, |du| is not.
"""

import copy
import math
from typing import Any

import numpy as np

Array = np.ndarray[Any, np.dtype[Any]]
BLOCK = 512  # ticks that are looked at together
JUMP = 100.0  # times the largest ratio before, and the median of a block: one that most ticks have is a gain
MANY = 8  # ticks that have a median
FIRST, FIRST_STEPPED = 1e6, 1e2  # of solutions that differ by rounding, and of those of other steps
ANSWERED = 0.9  # of the ticks: a controller that answers equally to states that differ leaves them alone
SMALL = 1e-12  # relative: a smaller |du| is rounding
POWER = 3.0  # of the time, at most, where nothing is unstable
LEAST = 100.0  # times that power: growth that tells
PARTS = 60  # of the time that are looked at
JUMPS = 2  # between two times, which may be an impact or a threshold: they do not count
FORGOTTEN = 0.01  # of the largest distance: smaller ones in the last quarter have been brought together again


class Ambiguity:
    """Looks at the answers of one controller tick by tick.

    first: a ratio, relative to the sizes of u and x, that is not yet a jump.
    """

    def __init__(self, first: float = FIRST) -> None:
        self._first = first
        self._count, self._t, self._u, self._x = 0, np.empty(BLOCK), np.empty(0), np.empty(0)  # of a block
        self._found: list[float] = []
        self._ratio, self._apart, self._sizes = 0.0, 0.0, np.zeros(2)
        self._ticks, self._answered, self._rounding = [np.empty(0)], 0, [np.empty(0)]

    def add(self, t: Array, u: Array, x: Array) -> None:
        """Take the answers u (k, m, n) to the states x (k, size, n) at times (k,)."""
        while len(t):
            if not self._count:
                self._u, self._x = np.empty((BLOCK, *u.shape[1:])), np.empty((BLOCK, *x.shape[1:]))
            some = min(BLOCK - self._count, len(t))
            place = slice(self._count, self._count + some)
            self._t[place], self._u[place], self._x[place] = t[:some], u[:some], x[:some]
            self._count += some
            if self._count == BLOCK:
                self._look()
            t, u, x = t[some:], u[some:], x[some:]

    def ticks(self) -> list[float]:
        """The times of ambiguous ticks so far."""
        return self._looked()._found

    def growth(self) -> tuple[float, float] | None:
        """From when solutions part as those of an unstable loop, s, and at which rate, 1/s; None where they do not."""
        now = self._looked()
        times = np.concatenate(now._ticks)
        return growth(times, np.concatenate(now._rounding)) if now._answered > ANSWERED * len(times) else None

    def _looked(self) -> "Ambiguity":
        """A copy that has looked at all ticks so far: the blocks do not depend on the time of the question."""
        other = copy.copy(self)
        other._found, other._ticks, other._rounding = self._found.copy(), self._ticks.copy(), self._rounding.copy()
        other._look()
        return other

    def _look(self) -> None:
        if not self._count:
            return
        times, self._count, k = self._t[: self._count], 0, self._count
        # Ticks last: a maximum over the others takes a quarter of the time.
        u, x = (np.ascontiguousarray(np.moveaxis(values[:k], 0, 2)) for values in (self._u, self._x))
        with np.errstate(invalid="ignore"):
            du, dx = (np.nan_to_num(_largest(y[:, 1:] - y[:, :1])) for y in (u, x))
        self._ticks.append(times.copy())
        self._answered += int(np.count_nonzero(du))
        self._rounding.append(_largest(x[:, -1:] - x[:, -2:-1]))  # the last two differ by rounding alone
        size_u, size_x = (np.maximum.accumulate(np.append(size, _largest(y)))[1:]
                          for size, y in zip(self._sizes, (u, x), strict=True))  # fmt: skip
        dx = np.maximum.accumulate(np.append(self._apart, dx))[1:]
        apart = du > SMALL * size_u
        with np.errstate(divide="ignore", invalid="ignore"):
            ratios = np.where(apart, du / dx, 0.0)
            first = self._first * np.where(size_x > 0.0, size_u / size_x, np.inf)
        usual = float(np.median(ratios)) if len(ratios) >= MANY else 0.0
        for t, ratio, least in zip(times[apart], ratios[apart], first[apart], strict=True):
            if ratio > JUMP * max(self._ratio, usual) and ratio > least:
                self._found.append(float(t))
            else:
                self._ratio = max(self._ratio, ratio)
        self._apart, self._sizes = dx[-1], np.array([size_u[-1], size_x[-1]])


def _largest(values: Array) -> Array:
    """The largest magnitudes (k,) in values (size, n, k)."""
    return np.asarray(np.abs(values).reshape(-1, values.shape[2]).max(axis=0, initial=0.0))


def growth(t: Array, apart: Array) -> tuple[float, float] | None:
    """From when distances (n,) at times (n,) grow as those of an unstable loop, s, and their rate, 1/s; or None."""
    known = (apart > 0.0) & np.isfinite(apart) & (t > t[0])
    t, apart = t[known], apart[known]
    if len(t) < JUMPS + 3 or apart[t >= 0.75 * t[-1]].max() < FORGOTTEN * apart.max():
        return None
    every = np.unique(np.searchsorted(t, np.linspace(t[0], t[-1], PARTS)))
    t, size = t[every], np.log(np.maximum.accumulate(apart))[every]
    beyond = size - POWER * np.log(t)
    end = int(np.argmax(beyond - np.minimum.accumulate(beyond)))
    begin = int(np.argmin(beyond[: end + 1]))
    rises = np.sort(np.diff(beyond[begin : end + 1]))
    if len(rises) <= JUMPS or rises[:-JUMPS].sum() < math.log(LEAST):
        return None
    return float(t[begin]), float(np.polyfit(t[begin : end + 1], size[begin : end + 1], 1)[0])
