"""A ball or a point of a link that meets a plane: it bounces, slides, rolls or sticks."""

import functools
from typing import ClassVar

from twolink.algorithms.spatial import Scalar, Vec, cross, dot, minus, plus, scale, times
from twolink.dynamics import Robot
from twolink.effects.conditions import across, unit
from twolink.effects.effect import NotNegative
from twolink.effects.frame_checks import check_frame
from twolink.effects.inputs import Slot
from twolink.effects.joint_stops import check_restitution
from twolink.effects.loop import Loop
from twolink.effects.motion import Motion
from twolink.effects.switching import Contact, SwitchingEffect


class PlaneContact(SwitchingEffect, frozen=True):
    """A ball or a point of a link in contact with a plane.

        gap = n . x - height - radius >= 0
        gap'+ = -e gap'-             at an impact (Newton 1687)
        |f_t| <= mu f_n              Coulomb's friction; |f_t| = mu f_n against the sliding while the ball slides

    x is the ball's centre; a point is a ball of radius 0. The friction impulse of an impact is mu times its normal
    impulse, or less if that stops the sliding. Bounces that have become smaller than the accuracy end in rest.

    Parameters
    ----------
    frame : str
        The link.
    point : (float, float, float)
        The centre x in the link's axes, m.
    radius : float
        Of the ball, m.
    normal : (float, float, float)
        n, along the world's axes, of any length: it is scaled to 1.
    height : float
        Of the plane along n, m.
    restitution : float
        e, from 0 to 1.
    friction : float
        mu, not negative.
    """

    frame: str
    point: tuple[float, float, float] = (0.0, 0.0, 0.0)
    radius: NotNegative = 0.0
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0)
    height: float = 0.0
    restitution: NotNegative = 0.0
    friction: NotNegative = 0.0

    def check(self, robot: Robot) -> None:
        """Require a link that moves, and a normal that has a direction."""
        check_frame(self.frame, robot, "frame")
        unit(self.normal, "normal")
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

    def velocity(self, motion: Motion) -> Vec:
        """The rate of the gap, and the slip along the two tangents, m/s."""
        normal, slip = unit(self.normal, "normal"), self.slip(motion)
        first, second = across(normal)
        return dot(normal, slip), dot(first, slip), dot(second, slip)

    def modes(self, robot: Robot) -> list[Contact]:
        """The gap to the plane."""
        del robot
        constraint, content = functools.partial(Touching, self), repr(self)
        friction = float(self.friction)
        return [Contact(self.frame, self.restitution, friction, self.gap, self.velocity, constraint, content)]


class Touching(Loop, frozen=True):
    """gap = 0, and while it rolls or sticks c = 0 along the plane; while it slides, with friction.

    contact: the ball and the plane. rolling: whether it rolls or sticks. before: the direction of sliding when that
    began, along the two tangents: c does not change to the other side of it before an event.
    """

    contact: PlaneContact
    rolling: bool
    before: tuple[Slot, Slot] | tuple[float, float]

    max_rows: ClassVar[int] = 3  # the normal row, and two along the tangents

    def rows(self, motion: Motion) -> list[Scalar]:
        """The gap."""
        return [self.contact.gap(motion)]

    def velocity_rows(self, motion: Motion) -> list[Scalar]:
        """c along the plane."""
        return list(self.contact.velocity(motion)[1:]) if self.rolling else []

    def forces(self, motion: Motion, along: Motion) -> list[Scalar] | None:
        """The power of a normal force of size 1 and of its friction."""
        mu = float(self.contact.friction)
        if self.rolling or not mu:
            return None
        xp = motion.xp
        _, x, y = self.contact.velocity(motion)
        normal, *others = self.contact.velocity(along)
        a, b = self.before
        speed = xp.sqrt(plus(times(x, x), times(y, y)))
        # Past the instant of no sliding, which steps look beyond, the direction stays, so that it has no corner.
        sign = xp.where(xp.less(plus(times(x, a), times(y, b)), 0.0), -1.0, 1.0)
        still = xp.less(speed, 1e-300)
        direction = [xp.where(still, was, times(sign, now / xp.where(still, 1.0, speed)))
                     for was, now in ((a, x), (b, y))]  # fmt: skip
        friction = plus(*(times(d, other) for d, other in zip(direction, others, strict=True)))
        return [minus(normal, times(mu, friction))]
