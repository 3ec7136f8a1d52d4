"""Gaps between discs, the ends of cylinders, and planes: a tilted one touches with its rim, a flat one stands.

A disc counts as flat up to a tilt of 1e-9 rad, which moves no point of a body of 1 m by more than 1e-9 m. One that
touches with a larger tilt, up to 3e-5 rad, is refused by `single`: its lowest point is not determined.
"""

from __future__ import annotations

from twolink.algorithms.motion import Motion
from twolink.algorithms.spatial import ZERO, Scalar, Vec, across, add, cross, dot, minus, scale
from twolink.effects.checks import floats
from twolink.effects.gaps import PARALLEL, Gap, Nearest, Place, PlaneGap, sub

FLAT = 1e-18  # the square of the sine of the tilt below it: a disc lies flat
NO_DIRECTION = 1e-30  # the square of a length below which it has no direction
AWAY = 1.0  # m: of a disc or point that does not touch as the disc lies


class RimGap(Gap, frozen=True):
    """From the rim of a disc of body a to a plane of body b: its lowest point, c - R m.

        m = (n - (n . u) u) / |n - (n . u) u|,   g = n . (c - x_b) - height - R |n - (n . u) u|

    point, axis, radius: c, u and R of the disc in the frame of a. It has no lowest point where it lies flat; there it
    is AWAY, for points of the rim touch (`StandGap`).
    """

    link: str
    point: Vec
    axis: Vec
    radius: float
    frame: str
    normal: Vec
    height: float

    def nearest(self, motion: Motion) -> Nearest:
        """The lowest point of the rim."""
        normal = floats(self.normal)
        n, s, t = (motion.direction(self.frame, axis) for axis in (normal, *across(normal)))
        u = motion.direction(self.link, self.axis)
        across_axis = sub(n, scale(dot(n, u), u))
        square = dot(across_axis, across_axis)
        xp = motion.xp
        length = xp.sqrt(xp.where(xp.less(square, NO_DIRECTION), NO_DIRECTION, square))
        offset = scale(-self.radius / length, across_axis)
        apart = sub(add(motion.position(self.link, self.point), offset), motion.position(self.frame))
        gap = minus(dot(n, apart), self.height)
        touched = sub(apart, scale(gap, n))
        return Nearest(gap, (n, s, t), Place(self.link, self.point, offset), Place(self.frame, ZERO, touched))

    def value(self, motion: Motion) -> Scalar:
        """g, or AWAY of a disc that lies flat."""
        flat = motion.xp.less(self._tilt(motion), FLAT)
        return motion.xp.where(flat, AWAY, self.nearest(motion).gap)

    def single(self, motion: Motion) -> Scalar:
        """The square of the sine of its tilt."""
        return minus(self._tilt(motion), PARALLEL)

    def _tilt(self, motion: Motion) -> Scalar:
        return tilt_of(motion, (self.frame, self.normal), (self.link, self.axis))


class StandGap(PlaneGap, frozen=True):
    """From a point of the rim of a disc of body a to a plane of body b while the disc lies flat, else AWAY.

    axis: u of the disc in the frame of a. The points are corners of a polygon within the disc: where the load tips the
    disc over that, `single` ends the run, though the disc itself might still stand.
    """

    axis: Vec

    def value(self, motion: Motion) -> Scalar:
        """g, or AWAY of a disc that is tilted."""
        return motion.xp.where(motion.xp.less(self._tilt(motion), FLAT), self.nearest(motion).gap, AWAY)

    def single(self, motion: Motion) -> Scalar:
        """1 less the square of the sine of its tilt over that up to which it lies flat."""
        return 1.0 - self._tilt(motion) / FLAT

    def _tilt(self, motion: Motion) -> Scalar:
        return tilt_of(motion, (self.frame, self.normal), (self.ball.frame, self.axis))


def tilt_of(motion: Motion, *ways: tuple[str, Vec]) -> Scalar:
    """The square of the sine between two directions, each fixed in a frame."""
    tilt = cross(*(motion.direction(frame, floats(way)) for frame, way in ways))
    return dot(tilt, tilt)
