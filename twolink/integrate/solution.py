"""Solution: the states that a solver computed, and their cost."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from twolink.integrate.event import Event

Progress = Callable[[float], None]
MAX_KEPT = 50_000_000  # numbers of states where steps ended
Code = Literal["steps", ""]  # what of a solver is native


class Impulse(NamedTuple):
    """Of an impact at a time t [s] on a pair of bodies: the one on the first (3,), along the world's axes, N s."""

    t: float
    pair: str
    on_first: np.ndarray


@dataclass(frozen=True)
class Segment:
    """A smooth part of a solution; between two events it may have no sample.

    Parameters
    ----------
    equations : Equations
        Their `start` is the state at the begin.
    begin : float
        When it begins, s.
    samples : int
        The number of its samples.
    taken : (ndarray (k,), ndarray (k, nq + nv)) or None
        Times and states where steps ended, with the begin; None where the solver does not tell.
    last : ndarray (nq + nv,) or None
        The state at its end, before the event there; None where no event ends it.
    held : ndarray (k, size - nq - nv) or None
        The numbers that hold from each time of `taken` on; None: those of the equations' start throughout.
    readings : mapping of str to Readings, or None
        What sensors read on the way, by name; None where nothing is called at ticks.
    """

    equations: Any
    begin: float
    samples: int
    taken: tuple[np.ndarray, np.ndarray] | None = None
    last: np.ndarray | None = None
    held: np.ndarray | None = None
    readings: Any = None

    def numbers(self, times: np.ndarray) -> np.ndarray:
        """The numbers (size - nq - nv, n) behind (q, v, z) at times (n,)."""
        if self.held is None or self.taken is None:
            fixed = np.asarray(self.equations.start[self.equations.moving :], dtype=float)
            return np.repeat(fixed[:, None], len(times), axis=1)
        return np.asarray(self.held[np.searchsorted(self.taken[0], times, side="right") - 1].T)


@dataclass(frozen=True)
class Solution:
    """The states that a solver computed, and their cost.

    Parameters
    ----------
    t : ndarray (n,)
        Times, s; fewer than asked for when interrupted, or when an event ended the run.
    x : ndarray (size, n)
        States.
    steps, evaluations, rejected : int
        Steps taken, evaluations of the equations, attempts in vain.
    compiled : {"steps", ""}
        Whether the steps were native.
    interrupted : bool
        Ctrl-C ended it.
    precise : ndarray (n, size, parts) or None
        The states in a higher precision, where it was asked for: sums of doubles (`digits`).
    events : tuple of Event
        What happened on the way.
    impulses : tuple of Impulse
        Those of impacts at contacts, of each point that is pressed.
    segments : tuple of Segment
        The smooth parts; one at least in what `solver.solve` returns.
    companion_steps : int
        How many attempted steps solutions in the same batch took beyond those of the run: the batch went on for them.
    compile_seconds : float
        Of tracing, loading and comparing programs, which is not part of the solving.
    """

    t: np.ndarray
    x: np.ndarray
    steps: int
    evaluations: int
    rejected: int = 0
    compiled: Code = ""
    interrupted: bool = False
    precise: Any = None
    events: tuple[Event, ...] = ()
    impulses: tuple[Impulse, ...] = ()
    segments: tuple[Segment, ...] = ()
    companion_steps: int = 0
    compile_seconds: float = 0.0


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
        compiled=parts[-1].compiled,
        interrupted=parts[-1].interrupted,
        precise=None if parts[0].precise is None else np.concatenate([part.precise for part in parts]),
        segments=tuple(segment for part in parts for segment in part.segments),
        companion_steps=sum(part.companion_steps for part in parts),
    )
