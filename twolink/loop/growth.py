"""Growth: whether solutions of a sampled loop part as those of an unstable one do.

Rounding disturbs them at every step. A stable loop forgets that, and what no feedback holds grows as a power of time,
no faster than t^3. Solutions of an unstable loop part by e^(rate t) until they are as far apart as the motion is large.
"""

import math
from typing import Any

import numpy as np

Array = np.ndarray[Any, np.dtype[Any]]
POWER = 3.0  # of the time, at most, where nothing is unstable
LEAST = 100.0  # times that power: growth that tells
PARTS = 60  # of the time that are looked at
JUMPS = 2  # between two times, which may be an impact or a threshold: they do not count
FORGOTTEN = 0.01  # of the largest distance: smaller ones in the last quarter have been brought together again


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
