"""What acts until it is let go: a payload, a grip, a spring that tears."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from twolink.dynamics import Robot
from twolink.effects.conditions import Condition, check_when
from twolink.effects.effect import Effect
from twolink.effects.motion import Motion
from twolink.effects.switching import Switch
from twolink.errors import SceneError


class Release(Switch, frozen=True):
    """An effect that acts until a time or a condition, and not any more from then on.

    of: any other effect, such as a payload or a weld loop that holds a ball. at: s. when: a condition. What is let go
    keeps its velocity: nothing jumps. A payload that is let go is gone; a body that was welded flies on.
    """

    of: Any  # an Effect: scene files read it by its type
    at: float | None = None
    when: Condition | None = None

    @property
    def structural(self) -> bool:
        """The effect stands in its place, until then."""
        return True

    def check(self, robot: Robot) -> None:
        """The effect fits, and so does the condition."""
        if not isinstance(self.of, Effect) or isinstance(self.of, Switch):
            raise SceneError(f"{type(self.of).__name__} cannot be let go", where="of",
                             remedy="give an effect without modes, such as a payload or a loop")  # fmt: skip
        try:
            self.of.check(robot)
        except SceneError as error:
            raise SceneError(error.what, where=f"of.{error.where}", remedy=error.remedy) from None
        check_when(self.at, self.when, robot)

    def at_first(self) -> tuple[Effect, ...]:
        """The effect."""
        return (self.of,)

    def breaks(self, duration: float) -> Sequence[float]:
        """The time, if it is one."""
        del duration
        return () if self.at is None else (float(self.at),)

    def distance(self, motion: Motion) -> Any:
        """What is missing to the condition."""
        return None if self.when is None else self.when.distance(motion)
