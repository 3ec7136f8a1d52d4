"""Effects of modes, which change at events. The engine that runs them is integrate.hybrid."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from twolink.effects.effect import Effect

if TYPE_CHECKING:
    from twolink.dynamics import Robot


class Switch(Effect, frozen=True):
    """An effect that is smooth only between events, at which it changes its mode.

    Some hold joints at rest (`lockable`). Others put effects in their own place, others in each mode (`at_first`).
    """

    @property
    def analytic(self) -> bool:
        """Only between events."""
        return False

    @property
    def structural(self) -> bool:
        """Whether other effects stand in its place."""
        return False

    def lockable(self, robot: Robot) -> Sequence[int]:
        """The degrees of freedom that it may hold at rest."""
        del robot
        return ()

    def at_first(self) -> tuple[Effect, ...]:
        """What stands in its place when a run begins."""
        return ()


@dataclass(frozen=True, eq=False)
class Switching:
    """The effects of a scene, some of which have modes.

    base: the robot before effects changed its constants; robot: after. effects: all of the scene.
    """

    base: Robot
    robot: Robot
    effects: tuple[Effect, ...]

    @property
    def lockable(self) -> tuple[int, ...]:
        """The degrees of freedom that an effect may hold at rest."""
        return tuple(sorted({k for e in self.effects if isinstance(e, Switch) for k in e.lockable(self.robot)}))

    @property
    def times(self) -> tuple[float, ...]:
        """The times at which modes change."""
        return tuple(t for e in self.effects if isinstance(e, Switch) for t in e.breaks(np.inf))

    @property
    def first_effects(self) -> tuple[Effect, ...]:
        """The effects with what stands in the place of those with modes when a run begins."""
        return self.replaced(lambda _, effect: effect.at_first() if effect.structural else (effect,))

    def replaced(self, stand_in: Callable[[int, Any], Sequence[Effect]]) -> tuple[Effect, ...]:
        """The effects with others in the place of those with modes, by their place and themselves."""
        parts = (stand_in(i, e) if isinstance(e, Switch) else (e,) for i, e in enumerate(self.effects))
        return tuple(effect for part in parts for effect in part)

    def robot_with(self, effects: Sequence[Effect]) -> Robot:
        """The robot with the constants that these effects change."""
        changing, now = ([e for e in some if type(e).change is not Effect.change] for some in (self.effects, effects))
        if changing == now:
            return self.robot

        def change(model: Any) -> None:
            model.gravity.linear = np.zeros(3)
            for effect in now:
                effect.change(model)

        return self.base.changed(change)


def switching_of(base: Robot, robot: Robot, effects: Sequence[Effect]) -> Switching | None:
    """The effects with modes among those of a scene; None where there are none."""
    return Switching(base, robot, tuple(effects)) if any(isinstance(e, Switch) for e in effects) else None
