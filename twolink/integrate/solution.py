"""Solutions: the states that a solver computed, from break to break, with events and cost."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.state import Array

if TYPE_CHECKING:
    from twolink.loop.sampled_loop import SampledLoop

AMBIGUOUS, UNSTABLE, STEPPED = "ambiguous-tick", "unstable-loop", "stepped"
NAMED = 20  # ticks that are named


@dataclass(frozen=True)
class Event:
    """An event of a run at a time t [s].

    kind: "impact", "rest", "leave", "edge" (a corner or an edge passes the end of what it touches), "stick", "slip",
    "reverse" (of slip), "slide", "roll", "catch", "breakaway" (of a catch), "release", "engage", "limit" (of effort),
    "assembled", "watch", "ambiguous-tick" (of a controller: solutions of the error bar got different answers),
    "unstable-loop" (of controllers: from here on errors grow at an exponential rate) or "stepped" (contacts that could
    not be located any further: from here on the error is an estimate). what: the joint, link or effect.
    detail: in words. energy: lost at once, J; below 0 what a kick gives. effect: the place among the scene's effects of
    what is watched, released or engaged; None of other events.
    direction: of a watch by a condition or a function, 1 where its value rises through 0, -1 where it falls.
    """

    t: float
    kind: str
    what: str
    detail: str = ""
    energy: float = 0.0
    effect: int | None = None
    direction: int = 0

    @property
    def text(self) -> str:
        """The joint, link or effect, with the detail."""
        return f"{self.what}{': ' if self.detail else ''}{self.detail}"

    def __str__(self) -> str:
        lost = f", {abs(self.energy):.6g} J {'lost' if self.energy > 0.0 else 'gained'}" if self.energy else ""
        return f"t = {self.t:.12g} s: {self.kind} {self.text}{lost}"


def ambiguous_events(found: Sequence[tuple[float, str]]) -> list[Event]:
    """Events of ambiguous ticks (when, what of), of which many are one."""
    events = [Event(at, AMBIGUOUS, what, "solutions of the error bar got different answers")
              for at, what in found[:NAMED]]  # fmt: skip
    if len(found) > NAMED:
        events.append(Event(found[NAMED][0], AMBIGUOUS, f"{len(found) - NAMED} more"))
    return events


def estimated_since(events: Sequence[Event]) -> str:
    """From when on the error is an estimate, in words; "" throughout."""
    return next((f" from t = {event.t:.6g} s on" for event in events if event.kind == STEPPED), "")


def events_of(loop: SampledLoop) -> list[Event]:
    """The ambiguous ticks of a loop so far, and from when it is unstable."""
    events = ambiguous_events(loop.ambiguous())
    events += [Event(t, UNSTABLE, what, f"errors grow at {rate:.3g} 1/s, by {math.expm1(rate * period):.2%} a tick")
               for t, what, rate, period in loop.unstable()]  # fmt: skip
    return sorted(events, key=lambda event: event.t)


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


def in_segments(equations: Equations, times: Array, solve: Callable[[Equations, Array], Solution]) -> Solution:
    """Solve from break to break for the samples `times` (n,).

    Each segment is solved on its own by `solve(equations, times)`, from the state at its beginning.
    """
    start, end = float(times[0]), float(times[-1])
    equations.require(start, end)
    edges = [start, *(t for t in equations.breaks(end) if t > start), end]
    if len(edges) == 2 and not equations.layout.tables:
        return solve(equations, times)
    held = {name: equations.start[row] for name, row in equations.layout.rows_of_slots().items()}
    parts: list[Solution] = []
    x: Any = equations.start
    for begin, stop in itertools.pairwise(edges):
        grid, extra = segment_times(times, begin, stop)
        segment = equations.starting_at(x, 0.5 * (begin + stop), slots=held)
        part = solve(segment, grid)
        x = part.x[:, -1]
        taken = slice(int(bool(parts)), len(part.t) - int(extra and len(part.t) == len(grid)))
        parts.append(replace(part, t=part.t[taken], x=part.x[: equations.moving, taken],
                             segments=(Segment(segment, begin, len(part.t[taken])),),
                             precise=None if part.precise is None else part.precise[taken]))  # fmt: skip
        if part.interrupted:
            break
    return joined(parts)


def segment_times(times: Array, begin: float, stop: float) -> tuple[Array, bool]:
    """The begin of a segment, the samples within it and its end; and whether that end is no sample."""
    first, after = np.searchsorted(times, [begin, stop], side="right")
    inside = times[first:after]
    extra = not inside.size or bool(inside[-1] < stop)
    return np.concatenate([[begin], inside, [stop] if extra else []]), extra
