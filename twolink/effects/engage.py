"""What begins to act during a motion: a regulator that catches, a brake, a gust."""

from typing import Any

from twolink.dynamics import Robot
from twolink.effects.conditions import Condition, check_when
from twolink.effects.effect import Effect, NotNegative
from twolink.effects.loop import Loop
from twolink.effects.release import check_inner
from twolink.effects.switching import SwitchingEffect, Trigger
from twolink.errors import SceneError
from twolink.io.text import kebab_case


class Engage(SwitchingEffect, frozen=True):
    """An effect that acts from a time or a condition on, and not before.

    Velocities do not jump: the effect is a force, not a mass or a constraint.

    Parameters
    ----------
    of : Effect
        An effect without modes that gives forces, such as a `StateFeedback` that catches an arm near upright.
    at : float, optional
        Time, s.
    when : JointReaches or FrameReaches, optional
        Condition, of which the first time counts; one of the two is needed.
    """

    of: Any  # an Effect: scene files read it by its type
    at: NotNegative | None = None
    when: Condition | None = None

    def check(self, robot: Robot) -> None:
        """Require an effect that gives forces alone and fits, and a time or a condition."""
        check_inner(self.of, robot, "engaged")
        if isinstance(self.of, Loop) or type(self.of).change is not Effect.change:
            what = f"{type(self.of).__name__} cannot begin during a motion: velocities would jump"
            raise SceneError(what, where="of", remedy="give a force, such as a controller or a spring")
        check_when(self.at, self.when, robot)

    def acting(self) -> tuple[Effect, ...]:
        """The effect, from then on."""
        return (self.of,)

    def modes(self, robot: Robot) -> list[Trigger]:
        """The begin."""
        del robot
        return [Trigger("engage", kebab_case(type(self.of).__name__), self.at, self.when, begins=True)]
