"""Events of the user: noted, and perhaps the end of the run or a change of the motion."""

from typing import Any

from twolink.dynamics import Robot
from twolink.effects.conditions import Condition, check_when
from twolink.effects.effect import NotNegative
from twolink.effects.switching import SwitchingEffect, Trigger
from twolink.errors import SceneError


class Watch(SwitchingEffect, frozen=True):
    """An event in run.events where a condition is reached, from either side, or at a time.

    Parameters
    ----------
    name : str
        Of the event.
    at : float, optional
        Time, s.
    when : JointReaches or FrameReaches, optional
        Condition.
    function : callable, optional
        In place of a condition, from Python only: f(motion) -> a number that passes 0. motion.q and motion.v are
        arrays of many states, motion.xp has sin, cos and sqrt.
    stop : bool
        Whether the run ends there.
    then : callable, optional
        From Python only: (q, v) -> (q, v) after the event.
    """

    name: str
    at: NotNegative | None = None
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

    def modes(self, robot: Robot) -> list[Trigger]:
        """The event."""
        del robot
        return [Trigger("watch", self.name, self.at, self.when, self.function, state=self.then, ends=self.stop)]
