"""Track: what a solution passed, and from it the state at any time."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from twolink.integrate.motion.state import Array
from twolink.integrate.solution import MAX_KEPT, Segment, Solution
from twolink.integrate.steps.step_map import StepMap

if TYPE_CHECKING:
    from twolink.integrate.core.columns import Columns


class Track:
    """Times and states (size,) where the steps of a solution ended, with the numbers that held from then on.

    A state between two of them is a part of the step from the first: as exact as the method.

    Parameters
    ----------
    by : StepMap
    times : ndarray (n,)
        Of the samples, s, increasing.
    t : float
        The time of the start, s.
    x : ndarray (size,)
        The state there.

    Attributes
    ----------
    whole : bool
        Whether all ends of steps are kept: of too many only the samples are, unless numbers change on the way.
    """

    def __init__(self, by: StepMap, times: Array, t: float, x: Array) -> None:
        self._by, self.times, self.begin = by, times, t
        self._most = math.inf if by.equations.layout.tables else MAX_KEPT
        self._t, self._x, self._numbers = [np.array([t])], [x[None].copy()], 0
        self._sampled: list[Array] = []  # samples of what is kept no more
        self.whole = True

    @property
    def t(self) -> float:
        """The last time, s."""
        return float(self._t[-1][-1])

    @property
    def x(self) -> Array:
        """The last state (size,)."""
        return np.asarray(self._x[-1][-1])

    def last(self) -> Track:
        """A track from the last state on."""
        other = Track(self._by, self.times, self.t, self.x)
        other.begin = self.begin
        return other

    def add(self, t: Array, x: Array) -> None:
        """Add the ends of attempted steps: times (k,) and states (k, size), which repeat the last where one failed.

        There may be none, where a controller fails at once.
        """
        if not t.size:
            return
        self._t.append(t.copy())
        self._x.append(x.copy())
        self._numbers += x.size
        if self._numbers > self._most:
            self._sampled.append(self._samples(self._count(self.t)))
            self.forget()

    def change(self, x: Array) -> None:
        """Let the numbers of a state (size,) hold from the last time on."""
        self._x[-1][-1] = x

    def forget(self) -> None:
        """Keep the last state alone, with the samples so far."""
        self._t, self._x = [self._t[-1][-1:].copy()], [self._x[-1][-1:].copy()]
        self._numbers, self.whole = 0, False

    def steps(self) -> tuple[Array, Array]:
        """Times (k,) and states (k, size) where steps ended, each once."""
        if len(self._t) == 1:
            return self._t[0], self._x[0]
        t, x = np.concatenate(self._t), np.concatenate(self._x)
        kept = np.append(t[1:] > t[:-1], True)
        self._t, self._x = [t[kept]], [x[kept]]
        return self._t[0], self._x[0]

    def samples(self, until: float, *, before: bool = False) -> Array:
        """The states (size, m) at those sample times that are not after a time, s. before: nor at it."""
        count = int(np.searchsorted(self.times, until)) if before else self._count(until)
        last = self._samples(count)
        return np.concatenate([*self._sampled, last], axis=1)[:, :count] if self._sampled else last

    def solution(
        self, columns: Columns, end: float, last: Array | None = None, *, before: bool = False, readings: Any = None
    ) -> Solution:
        """The solution of the first of its columns: one segment up to its end, s, with the samples within it.

        last: the state at its end, before the event there. before: a sample at its end is not one of them.
        """
        samples, equations, by = self.samples(end, before=before), self._by.equations, self._by
        (t, x), moving, count = self.steps(), equations.moving, samples.shape[1]
        accepted, rejected = columns.counts
        segment = Segment(equations, self.begin, count, (t, x[:, :moving]) if self.whole else None, last,
                          x[:, moving:] if equations.layout.tables else None, readings)  # fmt: skip
        evaluations = (accepted + rejected + count) * by.method.evaluations
        return Solution(self.times[:count], samples[:moving], accepted, evaluations, rejected, by.compiled,
                        segments=(segment,), companion_steps=columns.companion_steps)  # fmt: skip

    def _count(self, until: float) -> int:
        return int(np.searchsorted(self.times, until, side="right"))

    def _samples(self, count: int) -> Array:
        """The states (size, m) from the samples of what is kept no more up to a number of samples."""
        return states_at(self._by, *self.steps(), self.times[sum(part.shape[1] for part in self._sampled) : count])


def states_at(by: StepMap, t: Array, x: Array, times: Array) -> Array:
    """States (size, m) at times (m,), from states x (k, size) at increasing times t (k,) where steps ended."""
    step = np.searchsorted(t, times, side="right") - 1
    states, between = x[step].T, t[step] < times
    if not between.any():
        return states
    if between.all():  # as the points of a zero do
        return by.partial(states, t[step], times)
    states[:, between] = by.partial(states[:, between], t[step[between]], times[between])
    return states
