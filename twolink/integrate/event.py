"""Event: one line of run.events; those of controllers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

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
