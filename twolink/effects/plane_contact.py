"""A ball, an ellipsoid or a point of a link on a plane: rigid, with events, or compliant, which is smooth."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from twolink.algorithms.motion import GROUND, KinematicState
from twolink.algorithms.namespaces import Numbers
from twolink.algorithms.spatial import (
    ZERO,
    Scalar,
    Vec,
    add,
    constant,
    dot,
    minus,
    plus,
    reciprocal,
    scale,
    times,
    unit,
)
from twolink.dynamics import Robot
from twolink.effects.checks import floats
from twolink.effects.contact import contact_point
from twolink.effects.effect import AboveZero, Direction, Effect, LinkName, Loads, NotNegative, Share, number
from twolink.effects.switching import ContactPoint, SwitchingEffect
from twolink.errors import SceneError
from twolink.geometry.gaps import Ball, Gap, Nearest, Place, PlaneGap, tangents

AXES: tuple[Vec, ...] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
SPIN = 8 / (3 * np.pi)  # of Zhuravlev's friction: what spin takes from that against slip
SLIP = 15 * np.pi / 16  # and slip from that against spin
TWIST = 3 * np.pi / 16  # of mu N times the radius: the moment against spin alone


class EllipsoidGap(Gap, frozen=True):
    """From an ellipsoid of body a to a plane of the world: g = n . c - height - |r|, r_k = R_k n . e_k.

    point, radii: its centre and its radii R_k along the axes e_k of its link, m. Its lowest point is
    c - sum_k R_k r_k e_k / |r|.
    """

    link: str
    point: Vec
    radii: Vec
    normal: Vec
    height: float

    def nearest(self, motion: KinematicState) -> Nearest:
        """The ellipsoid's lowest point."""
        n, axes = self.normal, [motion.direction(self.link, axis) for axis in AXES]
        sizes = [times(radius, dot(n, axis)) for radius, axis in zip(self.radii, axes, strict=True)]
        length = motion.xp.sqrt(dot(tuple(sizes), tuple(sizes)))
        offset = add(*(scale(times(-radius / length, size), axis)
                       for radius, size, axis in zip(self.radii, sizes, axes, strict=True)))  # fmt: skip
        gap = minus(dot(n, motion.position(self.link, self.point)), plus(self.height, length))
        place = Place(self.link, self.point, offset)
        return Nearest(gap, (n, *tangents(n, motion.xp)), place, Place(GROUND, ZERO, ZERO))


def gap_to_plane(on: PlaneContact | CompliantContact, xp: Any = Numbers) -> Gap:
    """The gap of an effect's ball, point or ellipsoid to its plane."""
    point, normal, height = floats(on.point), floats(on.normal), number(on.height)
    if all(map(constant, normal)):
        normal = unit(on.normal, "normal")
    else:
        normal = scale(reciprocal(xp.sqrt(dot(normal, normal)), xp), normal)
    if on.radii is None:
        return PlaneGap(Ball(on.frame, point, number(on.radius)), GROUND, normal, height)
    return EllipsoidGap(on.frame, point, floats(on.radii), normal, height)


def check_one_shape(on: PlaneContact | CompliantContact) -> None:
    """Require a ball or an ellipsoid."""
    if on.radii is not None and on.radius:
        raise SceneError("radius is given too", where="radii", remedy="keep one: a ball or an ellipsoid")


class PlaneContact(SwitchingEffect, frozen=True):
    """A ball, a point or an ellipsoid of a link in contact with a plane.

        gap = n . x - height - radius >= 0, of an ellipsoid n . x - height - |r| with r_k = R_k n . e_k
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
    radii : (float, float, float), optional
        In place of the radius: R_k of an ellipsoid along the link's axes e_k, m.
    normal : (float, float, float)
        n, along the world's axes, of any length: it is scaled to 1.
    height : float
        Of the plane along n, m.
    restitution : float
        e, from 0 to 1.
    friction : float
        mu, not negative.
    """

    frame: LinkName
    point: tuple[float, float, float] = (0.0, 0.0, 0.0)
    radius: NotNegative = 0.0
    normal: Direction = (0.0, 0.0, 1.0)
    height: float = 0.0
    restitution: Share = 0.0
    friction: NotNegative = 0.0
    radii: tuple[AboveZero, AboveZero, AboveZero] | None = None

    def check(self, robot: Robot) -> None:
        """Require one shape."""
        del robot
        check_one_shape(self)

    def modes(self, robot: Robot) -> list[ContactPoint]:
        """The gap to the plane."""
        del robot
        name = f"{self.frame} - ground"
        return [contact_point(name, gap_to_plane(self), float(self.friction), float(self.restitution))]


class CompliantContact(Effect, frozen=True):
    """A ball, a point or an ellipsoid of a link that presses into a compliant plane. Smooth: no events.

        N = k s (1 + d s') where that is above 0, s = -gap above 0     (Hunt and Crossley 1975, n = 1)
        T = -mu N c / (|c| + 8/(3 pi) |u|)                             against the slip c
        M = -3 pi/16 mu N a u / (|u| + 15 pi/16 |c|)                   against spin, u = a w_n (Zhuravlev 1998)
        M = -r N w_t / |w_t|                                           against rolling

    w_n, w_t: the angular velocity about the normal and across it. The lengths are smoothed, |c| = sqrt(c . c + b^2)
    and so on, with a small slip b: bodies at rest creep. Without gravity, a blow at the speed v rebounds with the
    speed w of d v - ln(1 + d v) = -d w - ln(1 - d w), whatever the mass; w = v (1 - 2 d v / 3) for small d v.

    Parameters
    ----------
    frame : str
        The link.
    stiffness : float
        k, N/m.
    damping : float
        d, s/m: at the depth s it is k s d, N s/m.
    friction : float
        mu, not negative.
    patch : float
        a, the radius of the patch of contact, m: friction against spin, which also takes friction from slip.
    rolling : float
        r, m: the lever of the resistance against rolling.
    slip : float
        b, m/s, and rad/s of rolling: below it friction is viscous. The smaller, the stiffer the equations.
    point, radius, radii, normal, height
        As in `PlaneContact`.

    References
    ----------
    Hunt, Crossley: Coefficient of restitution interpreted as damping in vibroimpact, J. Applied Mechanics 42, 1975.
    Zhuravlev: The model of dry friction in the problem of the rolling of rigid bodies, J. Applied Mathematics and
    Mechanics 62, 1998.
    """

    frame: LinkName
    stiffness: NotNegative
    damping: NotNegative = 0.0
    friction: NotNegative = 0.0
    patch: NotNegative = 0.0
    rolling: NotNegative = 0.0
    slip: AboveZero = 1e-3
    point: tuple[float, float, float] = (0.0, 0.0, 0.0)
    radius: NotNegative = 0.0
    normal: Direction = (0.0, 0.0, 1.0)
    height: float = 0.0
    radii: tuple[AboveZero, AboveZero, AboveZero] | None = None

    analytic: ClassVar[bool] = False  # where it begins to touch

    def check(self, robot: Robot) -> None:
        """Require one shape."""
        del robot
        check_one_shape(self)

    def act(self, motion: KinematicState, loads: Loads) -> None:
        """Add the force at the lowest point and the moments."""
        xp, gap = motion.xp, gap_to_plane(self, motion.xp)
        near, (rate, *across) = gap.nearest(motion), gap.velocity(motion)
        n, *tangents_ = near.axes
        depth = xp.where(xp.less(near.gap, 0.0), minus(0.0, near.gap), 0.0)
        damped = minus(1.0, times(number(self.damping), rate))
        normal = times(number(self.stiffness), times(depth, xp.where(xp.less(0.0, damped), damped, 0.0)))
        turning, moment = motion.angular_velocity(self.frame), ZERO
        force, slip = scale(normal, n), self._length(xp, *across)
        load = times(number(self.friction), normal)
        if self.friction and self.patch:
            spin, size = times(number(self.patch), dot(n, turning)), number(self.patch)
            spinning = self._length(xp, spin)
            moment = scale(-TWIST * load * size * spin / (spinning + SLIP * slip), n)
            slip += SPIN * spinning
        if self.friction:
            force = add(force, *(scale(times(-load / slip, c), t) for c, t in zip(across, tangents_, strict=True)))
        if self.rolling:
            rolls = [dot(t, turning) for t in tangents_]
            share = times(-number(self.rolling), normal) / self._length(xp, *rolls)
            moment = add(moment, *(scale(times(share, w), t) for w, t in zip(rolls, tangents_, strict=True)))
        lever = add(near.first.position(motion), scale(-1.0, motion.position(self.frame, floats(self.point))))
        loads.force(self.frame, force, moment, floats(self.point), lever=lever)

    def _length(self, xp: Any, *parts: Scalar) -> Scalar:
        """The smoothed length of a vector."""
        return xp.sqrt(plus(*(times(part, part) for part in (number(self.slip), *parts))))
