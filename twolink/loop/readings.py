"""Readings of sensors: values with their bias, noise and resolution."""

import math
from typing import Any, NamedTuple

import numpy as np

from twolink.effects.inputs import SAME_TIME
from twolink.effects.sensors import Sensor
from twolink.loop.clock import Random

Array = np.ndarray[Any, np.dtype[Any]]
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
