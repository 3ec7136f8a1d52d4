"""A point or a ball of a link that meets a plane: it bounces, slides, rolls or sticks."""

from __future__ import annotations

from typing import Literal

from twolink.algorithms.spatial import Scalar, Vec, cross, dot, minus, plus, scale, times
from twolink.dynamics import Robot
from twolink.effects.conditions import unit
from twolink.effects.effect import Effect, finite
from twolink.effects.frame_checks import check_frame, check_three
from twolink.effects.inputs import Slot
from twolink.effects.joint_stops import check_restitution
from twolink.effects.loop import Loop
from twolink.effects.motion import Motion
from twolink.effects.switching import Switch

Mode = Literal["free", "sliding", "rolling"]


class PlaneContact(Switch, frozen=True):
    """gap = n . x - height - radius >= 0, for the centre x of a ball of a link; a point is a ball of radius 0.

    frame: the link. point: the centre in its axes, m. radius: m. normal: n, along the world's axes, of any length: it
    is made 1. height: of the plane along n, m. restitution: e, from 0 to 1: the gap's rate becomes -e times itself
    (Newton 1687). friction: mu, Coulomb's: while the ball slides, mu times the normal force against the sliding; else
    it rolls or sticks. An impact's friction is mu times its normal impulse, or less if that stops the sliding.
    Bounces that have become smaller than the accuracy end in rest.
    """

    frame: str
    point: tuple[float, float, float] = (0.0, 0.0, 0.0)
    radius: float = 0.0
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0)
    height: float = 0.0
    restitution: float = 0.0
    friction: float = 0.0

    @property
    def structural(self) -> bool:
        """A constraint stands in its place while there is contact."""
        return True

    def check(self, robot: Robot) -> None:
        """The frame moves, the numbers make sense."""
        check_frame(self.frame, robot, "frame")
        check_three(self.point, "point")
        check_three(self.normal, "normal")
        unit(self.normal, "normal")
        for field in ("radius", "friction"):
            finite(getattr(self, field), field, least=0.0)
        finite(self.height, "height")
        check_restitution(self.restitution)

    def gap(self, motion: Motion) -> Scalar:
        """How far it is from the plane, m."""
        n = unit(self.normal, "normal")
        return minus(dot(n, motion.position(self.frame, self.point)), float(self.height) + float(self.radius))

    def slip(self, motion: Motion) -> Vec:
        """The velocity of what touches, m/s: of the ball's lowest point, c = x' - radius omega x n."""
        n = unit(self.normal, "normal")
        centre = motion.velocity(self.frame, self.point)
        if not self.radius:
            return centre
        turning = cross(motion.angular_velocity(self.frame), scale(-float(self.radius), n))
        x, y, z = (plus(a, b) for a, b in zip(centre, turning, strict=True))
        return x, y, z

    def tangents(self) -> tuple[Vec, Vec]:
        """Two directions in the plane, at right angles."""
        n = unit(self.normal, "normal")
        k = min(range(3), key=lambda i: abs(n[i]))
        away = (float(k == 0), float(k == 1), float(k == 2))
        x, y, z = cross(n, away)
        first = unit((x, y, z), "normal")
        return first, cross(n, first)

    def in_mode(self, mode: Mode, label: str) -> tuple[Effect, ...]:
        """What stands in its place. label: of the numbers that ride along: the direction of sliding at first."""
        if mode == "free":
            return ()
        before = (Slot(f"{label}.0"), Slot(f"{label}.1"))
        return (Touching(self, mode == "rolling", before),)


class Touching(Loop, frozen=True):
    """gap = 0, and while it rolls or sticks c = 0 along the plane; while it slides, with friction.

    contact: what touches. rolling: whether it rolls or sticks. before: the direction of sliding when that began, along
    the two tangents: c does not change to the other side of it before an event says so.
    """

    contact: PlaneContact
    rolling: bool
    before: tuple[Slot, Slot] | tuple[float, float]

    def rows(self, motion: Motion) -> list[Scalar]:
        """The gap."""
        return [self.contact.gap(motion)]

    def velocity_rows(self, motion: Motion) -> list[Scalar]:
        """c along the plane."""
        if not self.rolling:
            return []
        slip = self.contact.slip(motion)
        return [dot(tangent, slip) for tangent in self.contact.tangents()]

    def forces(self, motion: Motion, along: Motion) -> list[Scalar] | None:
        """The power of a normal force of size 1 and of its friction."""
        mu = float(self.contact.friction)
        if self.rolling or not mu:
            return None
        xp, tangents = motion.xp, self.contact.tangents()
        own, other = self.contact.slip(motion), self.contact.slip(along)
        x, y = (dot(tangent, own) for tangent in tangents)
        a, b = self.before
        speed = xp.sqrt(plus(times(x, x), times(y, y)))
        # Past the instant of no sliding, which steps look beyond, the direction stays: there is no kink in it.
        sign = xp.where(xp.less(plus(times(x, a), times(y, b)), 0.0), -1.0, 1.0)
        still = xp.less(speed, 1e-300)
        direction = [xp.where(still, was, times(sign, now / xp.where(still, 1.0, speed)))
                     for was, now in ((a, x), (b, y))]  # fmt: skip
        rubbing = plus(*(times(d, dot(tangent, other)) for d, tangent in zip(direction, tangents, strict=True)))
        return [minus(dot(unit(self.contact.normal, "normal"), other), times(mu, rubbing))]
