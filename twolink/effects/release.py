"""What acts until it is released: a payload, a grip, a spring that tears."""

from typing import Any

from twolink.dynamics import Robot
from twolink.effects.conditions import Condition, check_when
from twolink.effects.effect import Effect, NotNegative
from twolink.effects.field_checks import check_effect
from twolink.effects.switching import SwitchingEffect, Trigger
from twolink.errors import SceneError
from twolink.io.text import kebab_case


class Release(SwitchingEffect, frozen=True):
    """An effect that acts until a time or a condition, and no more from then on.

    Velocities do not jump. A released payload leaves with its own energy; a body that was welded on moves freely.

    Parameters
    ----------
    of : Effect
        An effect without modes, such as a payload or a weld loop that holds a ball.
    at : float, optional
        Time, s.
    when : JointReaches or FrameReaches, optional
        Condition; one of the two is needed.
    """

    of: Any  # an Effect: scene files read it by its type
    at: NotNegative | None = None
    when: Condition | None = None

    def check(self, robot: Robot) -> None:
        """Require an effect without modes that fits, and a time or a condition."""
        check_inner(self.of, robot, "released")
        check_when(self.at, self.when, robot)

    def acting(self) -> tuple[Effect, ...]:
        """The effect, until it is released."""
        return (self.of,)

    def modes(self, robot: Robot) -> list[Trigger]:
        """The release."""
        del robot
        return [Trigger("release", kebab_case(type(self.of).__name__), self.at, self.when, drops=True)]


def check_inner(effect: Any, robot: Robot, verb: str) -> None:
    """Require an effect without modes that fits. Raises SceneError; `where` begins with "of"."""
    if not isinstance(effect, Effect) or isinstance(effect, SwitchingEffect):
        raise SceneError(f"{type(effect).__name__} cannot be {verb}", where="of",
                         remedy="give an effect without modes, such as a controller")  # fmt: skip
    try:
        check_effect(effect, robot)
    except SceneError as error:
        raise error.at(f"of.{error.where}") from None
