"""The law of a closed contact: one point of a gap that presses, slides, rolls or sticks.

    0 <= g,  0 <= N,  g N = 0                                  bodies do not overlap, and do not pull (Signorini 1933)
    |T| <= mu N           while c = 0                          friction holds (Coulomb 1785)
    T = -mu N c / |c|     while c is not 0
    g'+ = -e g'-          at an impact (Newton 1687)

N, T: the normal force and that of friction. c: the slip along the tangents.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import ClassVar

from twolink.algorithms.motion import Motion
from twolink.algorithms.spatial import Scalar, Vec, add, minus, plus, scale, times
from twolink.effects.gaps import Gap
from twolink.effects.inputs import Slot
from twolink.effects.loops import Loop
from twolink.effects.switching import ContactPoint

SLOW = 1e-9  # m/s: a slip whose direction is not followed
STILL = 1e-11  # m/s: one whose direction is rounding


def contact_point(
    name: str,
    gap: Gap,
    friction: float,
    restitution: float,
    static: float | None = None,
    *,
    reflects: bool = False,
) -> ContactPoint:
    """A contact of the engine from a gap and the numbers of its law."""
    constraint, content = functools.partial(Touching, name, gap, friction), repr((gap, friction, restitution))
    return ContactPoint(
        name,
        restitution,
        friction,
        friction if static is None else static,
        gap.value,
        gap.velocity,
        constraint,
        content,
        gap.single,
        reflects,
    )


class Touching(Loop, frozen=True):
    """g = 0, and while it rolls or sticks c = 0 along both tangents; while it slides, with friction.

    pair: the name of the two bodies. friction: mu. rolling: whether it rolls or sticks. before: the direction of
    sliding when that began, along the two tangents: c does not change to the other side of it before an event.
    """

    pair: str
    gap: Gap
    friction: float
    rolling: bool
    before: tuple[Slot, Slot] | tuple[float, float]

    touches: ClassVar[bool] = True
    max_rows: ClassVar[int] = 3  # the normal row, and two along the tangents

    def rows(self, motion: Motion) -> list[Scalar]:
        """The gap, of what touches."""
        return [self.gap.nearest(motion).gap]

    def velocity_rows(self, motion: Motion) -> list[Scalar]:
        """c along the tangents."""
        return list(self.gap.velocity(motion)[1:]) if self.rolling else []

    def forces(self, motion: Motion, along: Motion) -> list[Scalar] | None:
        """The power of a normal force of size 1 and of its friction."""
        if self.rolling or not self.friction:
            return None
        normal, *others = self.gap.velocity(along)
        friction = plus(*(times(d, other) for d, other in zip(self.sliding(motion), others, strict=True)))
        return [minus(normal, times(self.friction, friction))]

    def contact_force(self, motion: Motion, multipliers: Sequence[Scalar]) -> tuple[str, Vec, Vec]:
        """The normal force and that of friction, at the nearest point of the first body."""
        normal, *across = multipliers
        if not self.rolling:
            directions = self.sliding(motion) if self.friction else (0.0, 0.0)
            across = [times(-self.friction, times(normal, d)) for d in directions]
        near = self.gap.nearest(motion)
        force = add(*(scale(size, axis) for size, axis in zip((normal, *across), near.axes, strict=True)))
        return self.pair, near.first.position(motion), force

    def sliding(self, motion: Motion) -> list[Scalar]:
        """The direction of sliding along the two tangents: of c + s b, with the direction b of `before` and s = SLOW.

        That of c alone is singular at c = 0, and need not be b there: steps would be ever smaller. This one is singular
        past the plane c . b = 0, which ends the mode.
        """
        xp = motion.xp
        _, x, y = self.gap.velocity(motion)
        still = xp.less(plus(times(x, x), times(y, y)), STILL * STILL)
        a, b = self.before
        x, y = plus(x, times(SLOW, a)), plus(y, times(SLOW, b))
        speed = xp.sqrt(plus(times(x, x), times(y, y)))
        speed = xp.where(xp.less(speed, STILL), STILL, speed)
        # Beyond, where steps look too, the direction stays, so that it has no corner.
        sign = xp.where(xp.less(plus(times(x, a), times(y, b)), 0.0), -1.0, 1.0)
        return [xp.where(still, was, times(sign, now / speed)) for was, now in ((a, x), (b, y))]
