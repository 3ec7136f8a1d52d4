"""Events at a time or a condition: events of the user, effects that end, and effects that begin."""

from typing import Any, ClassVar, Literal

from twolink.dynamics import Robot
from twolink.effects.checks import check_effect, errors_inside
from twolink.effects.conditions import Condition, check_when
from twolink.effects.effect import Effect, NotNegative
from twolink.effects.loops import Loop
from twolink.effects.switching import SwitchingEffect, Trigger
from twolink.errors import SceneError
from twolink.io.text import kebab_case


class Watch(SwitchingEffect, frozen=True):
    """An event in run.events where a condition is reached, or at a time.

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
        From Python only: (q, v) -> (q, v) after the event. Loops answer a change of v by their impulse.
    direction : {0, 1, -1}
        1: only where the value (q - value of a joint, the function) rises through 0; -1: only where it falls; 0: both.
    """

    name: str
    at: NotNegative | None = None
    when: Condition | None = None
    function: Any = None
    stop: bool = False
    then: Any = None
    direction: Literal[-1, 0, 1] = 0

    def check(self, robot: Robot) -> None:
        """One of a time, a condition and a function is given, and fits."""
        if self.function is None:
            check_when(self.at, self.when, robot)
        elif self.at is not None or self.when is not None:
            raise SceneError("a function is given beside a time or a condition", where="function", remedy="give one")
        elif not callable(self.function):
            raise SceneError(f"expected a function, got {self.function!r:.60}", where="function", remedy="f(motion)")
        if self.direction not in (-1, 0, 1) or (self.direction and self.at is not None):
            raise SceneError(f"expected 1, -1 or 0, and 0 of a time, got {self.direction!r:.60}", where="direction",
                             remedy="leave it out, or give when= or function=")  # fmt: skip
        if self.then is not None and not callable(self.then):
            raise SceneError(f"expected a function, got {self.then!r:.60}", where="then", remedy="(q, v) -> (q, v)")

    def modes(self, robot: Robot) -> list[Trigger]:
        """The event."""
        del robot
        return [Trigger("watch", self.name, self.at, self.when, self.function, state=self.then, ends=self.stop,
                        direction=self.direction)]  # fmt: skip


class _Triggered(SwitchingEffect, frozen=True):
    """An effect that acts until a time or a condition, or from then on."""

    kind: ClassVar[str]  # of the event

    of: Any  # an Effect: scene files read it by its type
    at: NotNegative | None = None
    when: Condition | None = None

    def check(self, robot: Robot) -> None:
        """Require an effect without modes that fits, and a time or a condition."""
        if not isinstance(self.of, Effect) or isinstance(self.of, SwitchingEffect):
            raise SceneError(f"{type(self.of).__name__} cannot be {self.kind}d", where="of",
                             remedy="give an effect without modes, such as a controller")  # fmt: skip
        with errors_inside():
            check_effect(self.of, robot)
        check_when(self.at, self.when, robot)

    def acting(self) -> tuple[Effect, ...]:
        """The effect, until it is released or from when it is engaged on."""
        return (self.of,)

    def modes(self, robot: Robot) -> list[Trigger]:
        """The release, or the begin."""
        del robot
        return [Trigger(self.kind, kebab_case(type(self.of).__name__), self.at, self.when,
                        drops=self.kind == "release", begins=self.kind == "engage")]  # fmt: skip


class Release(_Triggered, frozen=True):
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

    kind: ClassVar[str] = "release"


class Engage(_Triggered, frozen=True):
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

    kind: ClassVar[str] = "engage"

    def check(self, robot: Robot) -> None:
        """Require an effect that gives forces alone and fits, and a time or a condition."""
        super().check(robot)
        if isinstance(self.of, Loop) or self.of.changes:
            what = f"{type(self.of).__name__} cannot begin during a motion: velocities would jump"
            raise SceneError(what, where="of", remedy="give a force, such as a controller or a spring")
