"""Solution: the states that a solver computed, and their cost."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from twolink.integrate.event import Event

Progress = Callable[[float], None]


@dataclass(frozen=True)
class Piece:
    """A smooth part of a solution: its equations, whose `start` is the state at its begin [s], and its samples' number.

    A piece between two events may have no sample.
    """

    equations: Any
    begin: float
    samples: int


@dataclass(frozen=True)
class Solution:
    """States x (size, n) at times t (n,); fewer than asked when `interrupted` by Ctrl-C.

    steps, rejected: steps taken and refused. evaluations: of the equations. compile_seconds: what compiling or
    loading took, not part of the solving. precise: the states (n, size) in a higher precision where it was asked
    for. events: what happened on the way. hit: the event that ended a piece, as a watcher found it.
    pieces: its smooth parts; of what `solver.solve` returns there is one at least.
    """

    t: np.ndarray
    x: np.ndarray
    steps: int
    evaluations: int
    rejected: int = 0
    compile_seconds: float = 0.0
    compiled: bool = False
    interrupted: bool = False
    precise: Any = None
    events: tuple[Event, ...] = ()
    hit: Any = None
    pieces: tuple[Piece, ...] = ()


def joined(parts: Sequence[Solution]) -> Solution:
    """Solutions one after the other as one."""
    if len(parts) == 1:
        return parts[0]
    return Solution(
        np.concatenate([part.t for part in parts]),
        np.concatenate([part.x for part in parts], axis=1),
        sum(part.steps for part in parts),
        sum(part.evaluations for part in parts),
        sum(part.rejected for part in parts),
        sum(part.compile_seconds for part in parts),
        parts[0].compiled,
        parts[-1].interrupted,
        None if parts[0].precise is None else np.concatenate([part.precise for part in parts]),
        pieces=tuple(piece for part in parts for piece in part.pieces),
    )
