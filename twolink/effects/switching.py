"""Switches: effects of modes, which change at events. What they are; integrate.hybrid runs them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

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
