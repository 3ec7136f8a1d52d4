"""Segments: smooth motion in one mode up to the first zero of a guard, which is located to the last digits of time.

Guards are looked at where steps end and at points within them, each a step of the method from the state before it, so
that a zero is as exact as the method. A dip between such points is followed to its bottom, lest two zeros within a step
be missed; bodies that pass each other come no nearer than where the tangents of their gap meet. Whether a dip that ends
just above 0 touches is for the error bar to say: the second solution counts a dip within its margin as a touch, where
the first does not.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from twolink.integrate.core.columns import Columns
from twolink.integrate.core.track import Track, states_at
from twolink.integrate.hybrid import roots
from twolink.integrate.hybrid.snapshot import Evaluator, Snapshot
from twolink.integrate.motion.state import Array
from twolink.integrate.solution import Solution
from twolink.integrate.steps.step_map import StepMap

Key = tuple[str, int]


class Guard:
    """A value that has one sign while a mode lasts, with the transition that its zero causes.

    A guard may begin at 0, as the distance from a stop does after an impact, or the value that has just caused an
    event. That zero is no event. Then the value is nothing until it has been farther from 0 than `noise`, and from
    there on it is judged by value / (t - start), which is not 0 at the start.

    key: names the guard from segment to segment. value: of a snapshot, (n,); rate: its derivative, of a gap. side: the
    sign while the mode lasts; None where it is not known before the first look. of: what the value is; of a distance
    or a speed a near miss may count.
    """

    def __init__(
        self,
        key: Key,
        value: Callable[[Snapshot], Any],
        transition: Callable[[Any], None],
        start: float,
        *,
        side: float | None = 1.0,
        of: Literal["distance", "speed", "force", "state"] = "state",
        rate: Callable[[Snapshot], Any] | None = None,
    ) -> None:
        self.key, self.value, self.transition, self.start, self.rate = key, value, transition, start, rate
        self.side, self.of = side, of
        self.at_zero, self.noise, self.moved = False, 0.0, True

    def begin(self, first: float, noise: float, *, fired: bool) -> None:
        """Take the value at the start. noise: what counts as 0. fired: its zero has just caused an event."""
        self.at_zero = fired or abs(first) <= noise
        self.noise = max(noise, 2.0 * abs(first)) if fired else noise
        self.moved = not self.at_zero

    def observe(self, t: Array, raw: Array) -> Array:
        """Values at increasing times, above 0 while the mode lasts; infinite before it has moved away from 0."""
        quiet: Array | None = None
        if not self.moved:
            quiet = ~np.logical_or.accumulate((np.abs(raw) > self.noise) & (t > self.start))
            self.moved = not quiet.all()
        if self.side is None:
            seen = raw[np.isfinite(raw) & (raw != 0.0) & (True if quiet is None else ~quiet)]
            self.side = float(np.sign(seen[0])) if seen.size else None
        values = self.signed(t, raw)
        return values if quiet is None else np.where(quiet, math.inf, values)

    def signed(self, t: Array, raw: Array) -> Array:
        """Values above 0 while the mode lasts."""
        values = raw * (self.side or 1.0)
        if not self.at_zero:
            return values
        late = t > self.start
        return np.where(late, values / np.where(late, t - self.start, 1.0), math.inf)


NEAR_MISSES = ("distance", "speed")
WITHIN = np.array([0.25, 0.5, 0.75])  # of a step
DIP = 0.3  # of what a guard changes around a low point: it may reach 0 between the points there
FEW = 12  # gaps that are all looked at; of more only those that can close
FASTER = 4.0  # times the largest rate at the points looked at: no gap closes faster between them
EXACT = 2 * np.finfo(float).eps  # relative to max(1, t): times are not finer


@dataclass(frozen=True)
class Hit:
    """The first event of a segment: its time, the state there, and the guard."""

    t: float
    x: Array
    guard: Guard


class _Bracket(NamedTuple):
    """Increasing times around the first zero of a guard, and its values there. level: what is subtracted of them."""

    times: Array
    values: Array
    level: float = 0.0

    @property
    def ends(self) -> tuple[float, float]:
        """The times between which the guard passes 0."""
        end = int(np.argmax(self.values <= 0.0))
        return float(self.times[max(0, end - 1)]), float(self.times[end])


class GuardWatcher:
    """The guards of a segment. margin: dips to it are touches, m, rad or per second."""

    def __init__(self, evaluate: Evaluator, step_map: StepMap, guards: Sequence[Guard], margin: float = 0.0) -> None:
        self.evaluate, self.map, self.guards = evaluate, step_map, guards
        self.margins = np.array([margin if guard.of in NEAR_MISSES and not guard.at_zero else 0.0 for guard in guards])
        self._before: tuple[float, Array] | None = None  # where the last step began: a dip may lie at its end

    def copied(self) -> GuardWatcher:
        """One that goes on from here, whatever this one sees."""
        other = copy.copy(self)
        other.guards = [copy.copy(guard) for guard in self.guards]
        return other

    @np.errstate(all="ignore")
    def first(self, t: Array, x: Array) -> Hit | None:
        """The first event along states x (k, size) at times t (k,), which do not decrease; None if there is none."""
        moved = t[1:] > t[:-1]
        if np.count_nonzero(moved) < len(moved):  # of refused steps
            moved = np.append(moved, True)
            t, x = t[moved], x[moved]
        if not self.guards or len(t) < 2:
            return None
        before, self._before = self._before, (float(t[-2]), np.array(x[-2]))
        if before is not None and before[0] < t[0]:
            t, x = np.append(before[0], t), np.concatenate([before[1][None], x])
        times, states = self._within(t, x)
        snapshot = self.evaluate(times, states)
        near = self._near(snapshot, times)
        guards = [self.guards[j] for j in near]
        if not guards:
            return None
        values = np.array([guard.observe(times, _row(guard.value(snapshot), times)) for guard in guards])
        margins = self.margins[near]
        dips = _dips(values, margins) | _passing(guards, margins, snapshot, times, values)
        hits = (values <= 0.0).any(axis=1) | dips.any(axis=1)
        if not np.count_nonzero(hits):
            return None
        brackets = {}
        for k in np.flatnonzero(hits).tolist():
            bracket = self._bracket(near[k], times, values[k], dips[k], t, x)
            if bracket is not None:
                brackets[near[k]] = bracket
        if not brackets:
            return None
        earliest = min(bracket.ends[1] for bracket in brackets.values())
        time, j = min((self._root(self.guards[j], bracket, t, x), j)
                      for j, bracket in brackets.items() if bracket.ends[0] <= earliest)  # fmt: skip
        return Hit(time, states_at(self.map, t, x, np.array([time]))[:, 0], self.guards[j])

    def _within(self, t: Array, x: Array) -> tuple[Array, Array]:
        """Times (m,) and states (size, m): the ends of steps, and points within them."""
        steps, count = len(t) - 1, len(WITHIN)
        times, states = np.empty((steps, count + 1)), np.empty((x.shape[1], steps * (count + 1) + 1))
        times[:, 0], times[:, 1:] = t[:-1], t[:-1, None] + WITHIN * (t[1:] - t[:-1])[:, None]
        inner = self.map.partial(x[:-1].repeat(count, axis=0).T, t[:-1].repeat(count), times[:, 1:].ravel())
        states[:, :-1].reshape(-1, steps, count + 1)[:, :, 1:] = inner.reshape(-1, steps, count)
        states[:, :: count + 1] = x.T
        return np.append(times.ravel(), t[-1]), states

    def _near(self, snapshot: Snapshot, times: Array) -> list[int]:
        """The guards to look at, by number: of many gaps only those so small that their rates may close them."""
        gaps = {j: guard.key[1] for j, guard in enumerate(self.guards) if guard.rate is not None}
        if len(gaps) <= FEW:
            return list(range(len(self.guards)))
        rows = snapshot.contacts[list(gaps.values()), :2]
        reach = self.margins[list(gaps)] + FASTER * np.diff(times).max() * np.abs(rows[:, 1]).max(axis=1)
        far = {j for j, away in zip(gaps, rows[:, 0].min(axis=1) > reach, strict=True) if away}
        return [j for j, guard in enumerate(self.guards) if j not in far or not guard.moved]

    def _bracket(self, j: int, times: Array, g: Array, dips: Array, t: Array, x: Array) -> _Bracket | None:
        """The bracket in which guard j first passes 0, or the margin of a near touch."""
        below = np.flatnonzero(g <= 0.0)  # NaN is neither
        last = int(below[0]) if below.size else len(g)
        if last == 0:  # the mode ends where it begins
            return _Bracket(times[:1], g[:1])
        margin = float(self.margins[j])
        for i in np.flatnonzero(dips[:last]).tolist():
            bottom, value = roots.lowest(lambda s: self._values(self.guards[j], s, t, x), float(times[i - 1]),
                                         float(times[i + 1]))  # fmt: skip
            if value <= margin < g[i - 1]:
                level = margin if value > 0.0 else 0.0
                return _Bracket(np.array([times[i - 1], bottom]), np.array([g[i - 1], value]) - level, level)
        near = slice(max(0, last - 4), last + 4)
        return None if last == len(g) else _Bracket(times[near], g[near])

    def _root(self, guard: Guard, bracket: _Bracket, t: Array, x: Array) -> float:
        """The time at which the guard passes the bracket's level."""
        a, b = bracket.ends
        if a == b:
            return a
        return roots.crossing(lambda s: self._values(guard, s, t, x) - bracket.level, bracket.times, bracket.values,
                              EXACT * max(1.0, abs(b)))  # fmt: skip

    def _values(self, guard: Guard, times: Array, t: Array, x: Array) -> Array:
        """The guard's values (n,) at times (n,), above 0 while the mode lasts."""
        snapshot = self.evaluate(times, states_at(self.map, t, x, times))
        return guard.signed(times, _row(guard.value(snapshot), times))


def _dips(values: Array, margins: Array) -> Array:
    """Low points of values (guards, m) between their ends that may reach 0, or the margins; True at each."""
    before, here, after = values[:, :-2], values[:, 1:-1], values[:, 2:]
    dips = np.zeros(values.shape, dtype=bool)
    low = (here < before) & (here <= after)
    if np.count_nonzero(low):
        depth = np.maximum(before, after) - here
        dips[:, 1:-1] = low & (here < np.maximum(margins[:, None], DIP * depth)) & np.isfinite(depth)
    return dips


def _passing(guards: Sequence[Guard], margins: Array, snapshot: Snapshot, times: Array, values: Array) -> Array:
    """Points at which gaps fall, and grow at the next, with tangents that meet at 0, the margin, or below.

    The gap of bodies that move straight is convex: it lies above its tangents.
    """
    passing = np.zeros(values.shape, dtype=bool)
    for j, guard in enumerate(guards):
        if guard.rate is None:
            continue
        gap, rate = _row(guard.value(snapshot), times), _row(guard.rate(snapshot), times)
        turns = (rate[:-1] < 0.0) & (rate[1:] > 0.0) & np.isfinite(values[j, :-1] + values[j, 1:])
        for i in np.flatnonzero(turns).tolist():
            (a, b), (fall, rise), length = gap[i : i + 2], rate[i : i + 2], times[i + 1] - times[i]
            if (a * rise - b * fall + length * fall * rise) / (rise - fall) <= margins[j]:
                passing[j, min(max(1, i + int(b < a)), len(times) - 2)] = True
    return passing


def _row(value: Any, times: Array) -> Array:
    """A guard's value as numbers (n,)."""
    row = np.asarray(value, dtype=float)
    return row if row.shape == times.shape else np.broadcast_to(row, times.shape)


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
