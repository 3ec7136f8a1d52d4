"""Events of the user's own: noted, and perhaps the end of the run or a change of the motion."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from twolink.dynamics import Robot
from twolink.effects.conditions import Condition, check_when
from twolink.effects.switching import SwitchingEffect, Trigger
from twolink.errors import SceneError


class Watch(SwitchingEffect, frozen=True):
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

    def triggers(self, robot: Robot) -> Sequence[Trigger]:
        """The event."""
        del robot
        return [Trigger("watch", self.name, self.at, self.when, self.function, state=self.then, ends=self.stop)]
