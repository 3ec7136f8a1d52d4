"""Event: one line of run.events."""

from dataclasses import dataclass

AMBIGUOUS, UNSTABLE = "ambiguous-tick", "unstable-loop"


@dataclass(frozen=True)
class Event:
    """What happened at a time t [s].

    kind: "impact", "rest", "leave", "edge" (a corner or an edge passes the end of what it touches), "stick", "slip",
    "reverse" (of slip), "slide", "roll", "catch", "breakaway" (of a catch), "release", "engage", "limit" (of effort),
    "assembled", "watch", "ambiguous-tick" (of a controller: solutions of the error bar got different answers) or
    "unstable-loop" (of controllers: from here on errors grow at an exponential rate). what: the joint, link or effect.
    detail: in words. energy: lost at once, J. effect: the place among the scene's effects of what is watched, released
    or engaged; None of other events.
    direction: of a watch by a condition or a function, 1 where its value rises through 0, -1 where it falls.
    """

    t: float
    kind: str
    what: str
    detail: str = ""
    energy: float = 0.0
    effect: int | None = None
    direction: int = 0

    def __str__(self) -> str:
        lost = f", {self.energy:.6g} J lost" if self.energy else ""
        return f"t = {self.t:.12g} s: {self.kind} {self.what}{': ' if self.detail else ''}{self.detail}{lost}"
