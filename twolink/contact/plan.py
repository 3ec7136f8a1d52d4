"""The steps that a run takes, from sample to sample and from break to break."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from twolink.integrate.equations import Equations
from twolink.integrate.state import Array


class Plan(NamedTuple):
    """Of each step its begin and its length (n,), s, its smooth piece (n,), and whether a sample is at its end (n,).

    numbers (pieces, m): of each piece.
    """

    t: Array
    h: Array
    piece: Array
    sampled: Array
    numbers: Array


def plan_steps(equations: Equations, times: Array, step: float, halvings: int) -> Plan:
    """Steps of at most `step` [s] for samples at times (n,). Samples and breaks end a step.

    halvings: how often the steps between two of those are doubled in number, and one more: else many steps began at the
    same times, and an impact would fall on the same place within them.
    """
    grid = np.union1d(times, equations.breaks(float(times[-1])))
    count = (np.maximum(1, np.ceil(np.diff(grid) / step - 1e-9).astype(int)) + 1) * 2**halvings - 1
    after, piece = np.cumsum(count), np.repeat(np.arange(len(count)), count)
    h, sampled = (np.diff(grid) / count)[piece], np.zeros(len(piece), dtype=bool)
    sampled[after - 1] = np.isin(grid[1:], times)
    numbers = np.array([equations.layout.numbers_at(t) for t in (0.5 * (grid[:-1] + grid[1:])).tolist()])
    return Plan(grid[piece] + (np.arange(len(piece)) - (after - count)[piece]) * h, h, piece, sampled, numbers)
