"""Events of the user's own: noted, and perhaps the end of the run or a change of the motion."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from twolink.dynamics import Robot
from twolink.effects.conditions import Condition, check_when
from twolink.effects.motion import Motion
from twolink.effects.switching import Switch
from twolink.errors import SceneError


class Watch(Switch, frozen=True):
    """An event wherever a condition is reached, from either side, or at a time: it is found and noted in run.events.

    name: what the event is called. at: s. when: a condition. function: in Python, f(motion) -> a number that passes
    0, in place of a condition; motion.q and motion.v are arrays of many states, and motion.xp has sin, cos, sqrt.
    stop: the run ends there. then: in Python, (q, v) -> (q, v) after the event.
    """

    name: str
    at: float | None = None
    when: Condition | None = None
    function: Any = None
    stop: bool = False
    then: Any = None

    def check(self, robot: Robot) -> None:
        """One of a time, a condition and a function is given, and fits."""
        if self.function is None:
            check_when(self.at, self.when, robot)
        elif self.at is not None or self.when is not None:
            raise SceneError("a function is given beside a time or a condition", where="function", remedy="give one")
        elif not callable(self.function):
            raise SceneError(f"expected a function, got {self.function!r}", where="function", remedy="f(motion)")
        if self.then is not None and not callable(self.then):
            raise SceneError(f"expected a function, got {self.then!r}", where="then", remedy="(q, v) -> (q, v)")

    def breaks(self, duration: float) -> Sequence[float]:
        """The time, if it is one."""
        del duration
        return () if self.at is None else (float(self.at),)

    def distance(self, motion: Motion) -> Any:
        """What passes 0."""
        if self.function is not None:
            return self.function(motion)
        return None if self.when is None else self.when.distance(motion)
