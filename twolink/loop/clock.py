"""The clock: what happens at which tick, in exact fractions of a second; random numbers by seed, name and tick, and the
readings of sensors, with their bias, noise and resolution.
"""

import heapq
import math
import zlib
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from twolink.effects.inputs import SAME_TIME
from twolink.effects.sampled_control import Controller, exact
from twolink.effects.sensors import Sensor

Array = np.ndarray[Any, np.dtype[Any]]
PARTS = 2**16  # of a jitter
BLOCK = 1024  # ticks whose random numbers are drawn at once
READ, ARRIVE, UPDATE, ACT = range(4)  # of a sensor, then of a controller; in order at one instant


class Random:
    """Random numbers of a sensor or a controller, (size,) a tick: the same for the same seed, name and tick."""

    def __init__(self, seed: int, name: str, size: int = 1) -> None:
        self._key, self._size = (seed, zlib.crc32(name.encode())), size
        self._blocks: list[Array] = []  # (BLOCK, 3, size): white, walk, uniform

    def __call__(self, tick: int) -> Array:
        """Independent normal numbers, a sum of others by tick, and whole numbers from 0 to PARTS - 1, (3, size)."""
        while BLOCK * len(self._blocks) <= tick:
            draw = np.random.default_rng((*self._key, len(self._blocks)))
            block = draw.standard_normal((BLOCK, 3, self._size))
            block[:, 1] = np.cumsum(block[:, 1], axis=0) + (self._blocks[-1][-1, 1] if self._blocks else 0.0)
            block[:, 2] = draw.integers(PARTS, size=(BLOCK, self._size))
            self._blocks.append(block)
        return np.asarray(self._blocks[tick // BLOCK][tick % BLOCK])


class Clock:
    """The next instant at which something happens, and what.

    Parameters
    ----------
    parts : mapping of int to Controller or Sensor
        By their places among the effects.
    start : float
        What would begin before it is left out, s.

    Attributes
    ----------
    time : float
        That instant, s; infinite where nothing happens any more.
    """

    def __init__(self, parts: Mapping[int, Controller | Sensor], start: float = 0.0) -> None:
        names = ("period", "offset", "delay", "jitter")
        times = {place: [exact(getattr(one, name, 0)) for name in names] for place, one in parts.items()}
        self._common = PARTS * math.lcm(*(x.denominator for row in times.values() for x in row))
        self._times = {place: [int(x * self._common) for x in row] for place, row in times.items()}
        self._late = {place: Random(one.seed, f"controller {place}") for place, one in parts.items() if times[place][3]}
        self._heap: list[tuple[int, int, int, int]] = []
        begin = int(start * (1.0 - SAME_TIME) * self._common)
        for place, one in parts.items():
            period, offset, *_ = self._times[place]
            first = max(0, -((offset - begin) // period))
            heapq.heappush(self._heap, self._at(READ if isinstance(one, Sensor) else UPDATE, place, first))
        self.time = self._next()

    def due(self) -> list[tuple[int, int, int]]:
        """Actions at `time`, in order: (READ, ARRIVE, UPDATE or ACT; the place of what does it; its tick)."""
        heap, actions = self._heap, []
        now = heap[0][0]
        while heap and heap[0][0] == now:
            _, kind, place, tick = heap[0]
            actions.append((kind, place, tick))
            if kind not in (READ, UPDATE):
                heapq.heappop(heap)
                continue
            heapq.heapreplace(heap, self._at(kind, place, tick + 1))
            if delay := self._times[place][2]:
                heapq.heappush(heap, (now + delay, kind + 1, place, tick))
            else:  # at once: what else is read or answered at this instant does not depend on it
                actions.append((kind + 1, place, tick))
        self.time = self._next()
        return actions

    def ahead(self, count: int, until: float) -> Array:
        """The next instants, up to so many and an end [s], of a clock of one controller without delay or jitter.

        One that differs from the end by rounding is at the end.
        """
        now, _, place, _ = self._heap[0]
        period = self._times[place][0]
        times = np.array([(now + k * period) / self._common for k in range(count)])
        times = times[times <= until * (1.0 + SAME_TIME)]
        return np.where(times >= until * (1.0 - SAME_TIME), until, times)

    @property
    def tick(self) -> int:
        """The number of the next tick."""
        return self._heap[0][3]

    def skip(self, count: int) -> None:
        """Leave out so many instants of such a clock."""
        _, kind, place, tick = self._heap[0]
        self._heap = [self._at(kind, place, tick + count)]
        self.time = self._next()

    def saved(self) -> tuple[list[tuple[int, int, int, int]], float]:
        """The state of the clock, for `restore`."""
        return self._heap.copy(), self.time

    def restore(self, saved: tuple[list[tuple[int, int, int, int]], float]) -> None:
        """Go on from there."""
        heap, self.time = saved
        self._heap = heap.copy()

    def until(self, end: float) -> list[float]:
        """The instants up to an end, s."""
        times = []
        while self.time <= end:
            times.append(self.time)
            self.due()
        return times

    def _at(self, kind: int, place: int, tick: int) -> tuple[int, int, int, int]:
        period, offset, _, jitter = self._times[place]
        late = jitter // PARTS * int(self._late[place](tick)[2, 0]) if jitter else 0
        return offset + tick * period + late, kind, place, tick

    def _next(self) -> float:
        return self._heap[0][0] / self._common if self._heap else math.inf


AMPLIFIED = 4.0  # of a solution's distance from the run, where its reading is rounded


class Readings(NamedTuple):
    """Readings of a sensor: the times (n,) at which it measured, s, and the values (n, m)."""

    t: Array
    values: Array

    def until(self, t: float) -> "Readings":
        """The readings up to a time, s."""
        count = int(np.searchsorted(self.t, t * (1.0 + SAME_TIME), side="right"))
        return Readings(self.t[:count], self.values[:count])


def reading(sensor: Sensor, random: Random, tick: int, values: Array) -> Array:
    """The readings (n, m) at a tick of n solutions with these values, the first of which is the run.

    Another solution stands for errors up to several times its distance from the run: so far off it is rounded, so that
    the edge of a quantum between the run and the true motion shows.
    """
    white, walk, _ = random(tick)
    values = values + (sensor.bias + sensor.noise * white + sensor.walk * math.sqrt(sensor.period) * walk)
    if sensor.quantum:
        values = values[:1] + AMPLIFIED * (values - values[:1]) if len(values) > 1 else values
        values = sensor.quantum * np.round(values / sensor.quantum)
    return np.asarray(values)
