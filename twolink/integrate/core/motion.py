"""Motion: solutions of one scene side by side, which go on from call to call; and `drive`, the loop that leads them.

There are three kinds: smooth (`core.smooth`), from event to event (`hybrid.located`), and in steps of contacts that
press (`contact.solver`). `simulate` drives a motion that keeps a track; `Simulation` drives one that keeps none.
"""

from __future__ import annotations

import functools
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

from twolink.effects.inputs import SAME_TIME
from twolink.errors import ControllerError
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.state import Array
from twolink.integrate.solution import Event

if TYPE_CHECKING:
    from twolink.effects.sensors import Forces
    from twolink.loop.sampled_loop import SampledLoop, Sampling

LATER = 1.0 + SAME_TIME
S = TypeVar("S")
Solve = TypeVar("Solve", bound=Callable[..., Any])


class AgainError(Exception):
    """The reason to solve again: a law answers otherwise in one call for all solutions, and is called for each now."""


def again(solve: Solve) -> Solve:
    """Solve, again where `AgainError` is raised."""

    @functools.wraps(solve)
    def solved(*given: Any, **options: Any) -> Any:
        while True:
            try:
                return solve(*given, **options)
            except AgainError:
                continue

    return solved  # type: ignore[return-value]


class Motion(ABC):
    """Solutions of one scene side by side. The first is the run, the others show its error.

    All that a motion remembers belongs to one of its solutions, and is in what `save` returns: what saves and goes on
    has the same bits as what does not save, and as what restores it.
    """

    equations: Equations  # of all modes; where contacts are stepped, without them

    @property
    @abstractmethod
    def t(self) -> float:
        """The time of the run, s."""

    @property
    @abstractmethod
    def x(self) -> Array:
        """The states (moving, n)."""

    @property
    @abstractmethod
    def steps(self) -> int:
        """Accepted steps of the run."""

    @property
    def unfollowed(self) -> float | None:
        """The most that bounces too low for the steps would have moved a joint, rad or m; None: all are followed."""
        return None

    @property
    def events(self) -> Sequence[Event]:
        """Events of the run so far."""
        return ()

    @property
    def ended(self) -> bool:
        """True if an event has ended the run."""
        return False

    @property
    def over(self) -> bool:
        """True if events have ended all solutions."""
        return self.ended

    @abstractmethod
    def advance(self, t: float) -> None:
        """Go to a time, s, with the numbers that hold, or to where an event ends a solution."""

    @abstractmethod
    def held(self) -> Array:
        """The states with the numbers that hold (size, n), which may be written and given to `hold`."""

    @abstractmethod
    def hold(self, x: Array) -> None:
        """Let the numbers in states (size, n) hold from now on."""

    def take_ticks(self, loop: SampledLoop, until: float) -> bool:
        """Take some ticks of a traced law up to a time in one call, where that goes; False: none."""
        del loop, until
        return False

    @abstractmethod
    def forces(self, t: float, x: Array) -> Forces:
        """The forces at states (size, n) at a time."""

    @abstractmethod
    def save(self) -> Any:
        """All that the solutions go on from, in copies."""

    @abstractmethod
    def restore(self, saved: Any) -> None:
        """Go on from there."""


def drive(motion: Motion, until: float, loop: SampledLoop | None = None) -> None:
    """Let a motion go to a time, from tick to tick of its controllers and sensors.

    Parameters
    ----------
    motion : Motion
        It stops at its own breaks and events.
    until : float
        s.
    loop : SampledLoop, optional
        The controllers and sensors, which read the states at a tick and write the numbers that hold until the next.

    Raises
    ------
    ControllerError
        A controller failed; the motion is at its tick, which is due again.
    """
    while loop is not None and loop.time <= until * LATER:
        if loop.time > motion.t * LATER:
            motion.advance(loop.time if loop.time * LATER < until else until)  # no rounding is left behind it
        if motion.over:
            break
        if motion.take_ticks(loop, until):
            continue
        states = motion.held()
        loop.tick(states)
        motion.hold(states)
    # Behind a tick at this time, finer solutions would take half of what rounding leaves as a step.
    if until > motion.t * (1.0 if loop is None else LATER) and not motion.over:
        motion.advance(until)


def driven(
    motion: Motion,
    until: float,
    sampling: Sampling | None,
    solutions: Callable[[SampledLoop | None, bool, float], list[S]],
) -> list[S]:
    """The solutions of a motion that is driven to a time with its controllers and sensors, the run's first.

    Parameters
    ----------
    motion : Motion
    until : float
        s.
    sampling : Sampling or None
    solutions : callable
        (loop, interrupted, t) -> what there is so far, up to a time t [s] where a controller failed, else infinite.

    Raises
    ------
    ControllerError
        A controller failed; its `run` is the run so far.
    """
    loop = None if sampling is None else loop_of(motion, sampling)
    try:
        drive(motion, until, loop)
        if loop is not None:
            loop.require_repeatable()
    except KeyboardInterrupt:
        return solutions(loop, True, math.inf)
    except ControllerError as error:
        error.run = solutions(loop, True, float(error.data.get("t", math.inf)))[0]
        raise
    except Exception as error:
        if loop is not None and isinstance(error, loop.differs):
            raise AgainError from error
        raise
    return solutions(loop, False, math.inf)


def loop_of(motion: Motion, sampling: Sampling, *, endless: bool = False) -> SampledLoop:
    """The controllers and sensors of a motion from now on. endless: as of `SampledLoop`."""
    from twolink.loop.sampled_loop import SampledLoop  # which scenes without controllers and sensors do not load

    layout = motion.equations.layout
    return SampledLoop(sampling, layout.rows_of_slots(), layout.space.states, motion.held(), motion.forces, motion.t,
                       endless=endless)  # fmt: skip
