"""A segment of a solution with modes: smooth motion in one mode, up to the first zero of a guard."""

from __future__ import annotations

import copy
from collections.abc import Mapping

import numpy as np

from twolink.integrate.core.columns import Columns
from twolink.integrate.core.track import Track
from twolink.integrate.hybrid.locating import GuardWatcher, Hit
from twolink.integrate.motion.state import Array
from twolink.integrate.solution import Solution


class OpenSegment:
    """A segment that goes on.

    Parameters
    ----------
    columns : Columns
        One solution.
    watcher : GuardWatcher
    times : ndarray (n,)
        Of the samples from its begin on, s.
    """

    def __init__(self, columns: Columns, watcher: GuardWatcher, times: Array) -> None:
        self.columns, self.watcher = columns, watcher
        self.is_anew = False  # True of the last part of a slip that has turned
        self.track = Track(columns.by, times, columns.time, columns.x[:, 0])
        self._rows = columns.by.equations.layout.rows_of_slots()

    def copied(self) -> OpenSegment:
        """A segment that goes on from here with the same bits, whatever this one does; its samples are not copied."""
        other = copy.copy(self)
        other.watcher, other.columns, other.track = self.watcher.copied(), self.columns.copied(), self.track.last()
        return other

    @property
    def begin(self) -> float:
        """The time when it began, s."""
        return self.track.begin

    @property
    def x(self) -> Array:
        """The last state (size,)."""
        return self.track.x

    def advance(self, end: float, expected: int = 1) -> Hit | None:
        """Advance to a time, s, or to the first event. expected: about how many steps that takes."""
        size = len(self.track.x)
        for block in self.columns.blocks(end, expected):
            t, x = block.t[:, 0], block.states[:, :size, 0]
            hit = self.watcher.first(t, x)
            before = len(t) if hit is None else max(1, int(np.searchsorted(t, hit.t)))
            if before > 1:
                self.track.add(t[1:before], x[1:before])
            if hit is not None:
                self.columns.state[:] = block.states[before - 1]
                return hit
        return None

    def hold(self, numbers: Mapping[str, float]) -> None:
        """Let numbers hold from now on, by the names of their slots."""
        for name, value in numbers.items():
            if name in self._rows:
                self.columns.x[self._rows[name]] = value
        self.track.change(self.columns.x[:, 0])

    def solution(self, end: float, last: Array, *, before: bool = False) -> Solution:
        """The segment up to its end, where the state is `last` (moving,); see `Track.solution`."""
        return self.track.solution(self.columns, end, last, before=before)
