"""Solution: the states a solver found, and what it took; and what every solver refuses alike."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from twolink.errors import AccuracyError
from twolink.integrate.event import Event

Progress = Callable[[float], None]
MAX_STEPS = 10_000_000


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


def collapsed(t: float) -> AccuracyError:
    """The step size has become too small to go on."""
    return AccuracyError(
        "the step size has collapsed: the equations are stiff, singular or not finite there",
        where=f"t = {t:.6g} s",
        remedy='try method="esdirk43" or "scipy-radau" for stiff scenes, a shorter duration, or less accuracy',
    )


def not_finite(t: float, step: float | None = None) -> AccuracyError:
    """The state has left the finite numbers."""
    remedy = "check forces and the initial state" if step is None else f"take steps smaller than {step:.3g} s"
    return AccuracyError("the state is not finite any more", where=f"t = {t:.6g} s", remedy=remedy)


def too_many_steps(t: float, limit: int = MAX_STEPS) -> AccuracyError:
    """So many steps are needed."""
    return AccuracyError(
        f"more than {limit:,} steps are needed to the end",
        where=f"t = {t:.6g} s",
        remedy="ask for a shorter duration or less accuracy",
    )


def out_of_reach(t: float, limit: float) -> AccuracyError:
    """An angle is beyond what the compiled steps' sine can take."""
    return AccuracyError(
        f"an angle is beyond {limit:.0e} rad",
        where=f"t = {t:.6g} s",
        remedy='make the joint continuous, or use method="taylor" or "scipy-dop853"',
    )


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
