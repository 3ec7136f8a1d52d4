"""Gaps between two shapes as formulas: distance, common normal, and the points of both bodies that touch.

    g = n . (x_a - x_b),   g' = n . (v_a - v_b)

x_a, x_b: the nearest points of the two bodies. n: the unit normal at them, from b to a. v_a, v_b: the velocities of the
material points there. The second equation holds at any distance: the nearest points move along the surfaces, across n.

A shape is a core with a radius around it: a point for a sphere, a segment for a capsule, and the solid itself with the
radius 0 for a box, a cylinder and a hull. Cores do not meet while g >= 0, unless both radii are 0. Source: Ericson,
Real-Time Collision Detection, 2005, chapter 5.

A cylinder meets a plane with the discs at its ends. A tilted disc touches with its rim, a flat one stands: it counts as
flat up to a tilt of 1e-9 rad, which moves no point of a body of 1 m by more than 1e-9 m. One that touches with a larger
tilt, up to 3e-5 rad, is refused by `single`: its lowest point is not determined.

Frames are names of links, of which a `KinematicState` knows the places; or numbers of many links, see `points`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import msgspec
import numpy as np

from twolink.algorithms.motion import GROUND, KinematicState
from twolink.algorithms.namespaces import Array, Numbers
from twolink.algorithms.spatial import (
    IDENTITY,
    ZERO,
    Scalar,
    Vec,
    across,
    add,
    constant,
    cross,
    dot,
    minus,
    scale,
    times,
    unit,
)
from twolink.io.text import kebab_case

FLAT = 1e-18  # the square of the sine of the tilt below it: a disc lies flat
NO_DIRECTION = 1e-30  # the square of a length below which it has no direction
AWAY = 1.0  # m: of a disc or point that does not touch as the disc lies
NEVER = 1e30  # m^2: the square of the distance from what is not below the ball
FACE_FIRST = 1.0 - 1e-14  # of the square of the distance from a face: it is nearer than its edges
PARALLEL = 1e-9  # the square of the sine between two segments, or of a tilt, below it: they count as parallel


class Place(NamedTuple):
    """A point of a body: at `point` in the frame's axes, and `offset` from there along the world's axes, m."""

    frame: str
    point: Vec
    offset: Vec

    def position(self, motion: KinematicState) -> Vec:
        """Position of the place in the world, m."""
        return add(motion.position(self.frame, self.point), self.offset)

    def velocity(self, motion: KinematicState) -> Vec:
        """Its velocity along the world's axes, m/s."""
        velocity = motion.velocity(self.frame, self.point)
        if self.offset is ZERO:
            return velocity
        return add(velocity, cross(motion.angular_velocity(self.frame), self.offset))


class Nearest(NamedTuple):
    """The gap g [m], the normal n with two tangents across it, and the nearest points of the bodies a and b."""

    gap: Scalar
    axes: tuple[Vec, Vec, Vec]
    first: Place
    second: Place


class Gap(msgspec.Struct, frozen=True, tag_field="kind", tag=kebab_case):
    """A gap between two shapes. Subclasses say where their nearest points are."""

    def nearest(self, motion: KinematicState) -> Nearest:
        """The nearest points."""
        raise NotImplementedError

    def value(self, motion: KinematicState) -> Scalar:
        """g, m."""
        return motion.once(self.nearest).gap

    def velocity(self, motion: KinematicState) -> Vec:
        """g' and the slip of a on b along the two tangents, m/s."""
        near = motion.once(self.nearest)
        slip = sub(near.first.velocity(motion), near.second.velocity(motion))
        x, y, z = (dot(axis, slip) for axis in near.axes)
        return x, y, z

    def single(self, motion: KinematicState) -> Scalar | None:
        """Above 0 where the nearest points are single ones; None where they are so everywhere.

        Where they are not, a line or a side is nearest, and the gap has a kink.
        """
        del motion
        return None


class Ball(msgspec.Struct, frozen=True):
    """A ball of a link: its centre in the link's axes and its radius, m."""

    frame: str
    point: Vec
    radius: float

    def centre(self, motion: KinematicState) -> Vec:
        """Its centre in the world, m."""
        return motion.position(self.frame, self.point)

    def surface(self, normal: Vec) -> Place:
        """Its point farthest against the normal."""
        return Place(self.frame, self.point, scale(-self.radius, normal))


class PlaneGap(Gap, frozen=True):
    """From a ball or a point of body a to a plane of body b: g = n . (x - x_b) - height - radius.

    frame: of the plane. normal: n in its axes, of length 1. height: of the plane along n from the frame's origin, m.
    """

    ball: Ball
    frame: str
    normal: Vec
    height: float

    def nearest(self, motion: KinematicState) -> Nearest:
        """The ball's lowest point."""
        normal = self.normal
        x, axes = self.ball.centre(motion), (normal, *tangents(normal, motion.xp))
        if isinstance(self.frame, str) and self.frame == GROUND:
            gap = minus(dot(normal, x), self.height + self.ball.radius)
            return Nearest(gap, axes, self.ball.surface(normal), Place(GROUND, ZERO, ZERO))
        n, s, t = (motion.direction(self.frame, axis) for axis in axes)
        apart = sub(x, motion.position(self.frame))
        distance = minus(dot(n, apart), self.height)
        touched = sub(apart, scale(distance, n))
        gap = minus(distance, self.ball.radius)
        return Nearest(gap, (n, s, t), self.ball.surface(n), Place(self.frame, ZERO, touched))


class RoundGap(Gap, frozen=True):
    """Between two balls or capsules: g = |x_a - x_b| - r_a - r_b with the nearest points of points or segments.

    first, second: balls about the segments' middles. first_half, second_half: from there to an end, in the axes of the
    frame; 0 for a ball.
    """

    first: Ball
    second: Ball
    first_half: Vec = ZERO
    second_half: Vec = ZERO

    def nearest(self, motion: KinematicState) -> Nearest:
        """The nearest points of the segments, each with its radius."""
        a, b = self.first.centre(motion), self.second.centre(motion)
        u, w = (motion.direction(ball.frame, half) if has_length(half) else None
                for ball, half in ((self.first, self.first_half), (self.second, self.second_half)))  # fmt: skip
        along_a, along_b = _nearest_of_segments(sub(a, b), u, w, motion.xp)
        return between_balls(motion, (self.first, a, along_a), (self.second, b, along_b))

    def single(self, motion: KinematicState) -> Scalar | None:
        """The square of the sine between segments; or what parallel ones have between their ends, over their length."""
        if not (has_length(self.first_half) and has_length(self.second_half)):
            return None
        u, w = (motion.direction(ball.frame, half)
                for ball, half in ((self.first, self.first_half), (self.second, self.second_half)))  # fmt: skip
        aa, ab, bb = dot(u, u), dot(u, w), dot(w, w)
        apart, xp = sub(self.first.centre(motion), self.second.centre(motion)), motion.xp
        sine, size = 1.0 - ab * ab / (aa * bb) - PARALLEL, xp.sqrt(aa) + xp.sqrt(bb)
        between = xp.sqrt(dot(u, apart) * dot(u, apart) / aa) / size - 1.0
        return xp.where(xp.less(sine, between), between, sine)


class BoxGap(Gap, frozen=True):
    """From a ball of body a to a box of body b: to the nearest point of a face, an edge or a corner.

    frame, point, axes, half: the box's link, its centre and own axes in the link's, and half its edges, m.
    """

    ball: Ball
    frame: str
    point: Vec
    axes: tuple[Vec, Vec, Vec]
    half: Vec

    def nearest(self, motion: KinematicState) -> Nearest:
        """The point of the box with the ball's centre's coordinates, each limited to the box."""
        x, middle = self.ball.centre(motion), motion.position(self.frame, self.point)
        apart, inside = sub(x, middle), ZERO
        for axis, half in zip(self.axes, self.half, strict=True):
            e = motion.direction(self.frame, axis)
            inside = add(inside, scale(limited(dot(e, apart), half, motion.xp), e))
        return between_balls(motion, (self.ball, x, ZERO), (Ball(self.frame, self.point, 0.0), middle, inside))


class CylinderGap(Gap, frozen=True):
    """From a ball of body a to a cylinder of body b: to the nearest point of its side, an end or a rim.

    frame, point, axis, radius, half: the cylinder's link, its middle and axis in the link's axes, its radius and half
    its length, m.
    """

    ball: Ball
    frame: str
    point: Vec
    axis: Vec
    radius: float
    half: float

    def nearest(self, motion: KinematicState) -> Nearest:
        """The ball's centre, limited to the cylinder along its axis and across it."""
        xp = motion.xp
        x, middle = self.ball.centre(motion), motion.position(self.frame, self.point)
        apart, u = sub(x, middle), motion.direction(self.frame, self.axis)
        along = dot(u, apart)
        outward = sub(apart, scale(along, u))
        square = dot(outward, outward)
        beyond = xp.less(self.radius * self.radius, square)
        share = xp.where(beyond, self.radius / xp.sqrt(xp.where(beyond, square, 1.0)), 1.0)
        inside = add(scale(limited(along, self.half, xp), u), scale(share, outward))
        return between_balls(motion, (self.ball, x, ZERO), (Ball(self.frame, self.point, 0.0), middle, inside))


Core = tuple[Ball, Vec, Vec]  # a ball, its centre in the world, and the offset of the core's nearest point from there


def sub(a: Vec, b: Vec) -> Vec:
    """a - b."""
    x, y, z = (minus(p, q) for p, q in zip(a, b, strict=True))
    return x, y, z


def has_length(half: Vec) -> bool:
    """True if a vector is not the constant 0."""
    return not isinstance(half, tuple) or any(half)


def tangents(n: Vec, xp: Any) -> tuple[Vec, Vec]:
    """Two unit vectors across a unit vector and each other, smooth but where n_z changes its sign.

    Source: Duff et al., Building an orthonormal basis, revisited, Journal of Computer Graphics Techniques 6 (1), 2017.
    """
    if all(map(constant, n)):
        return across(n)
    x, y, z = n
    sign = xp.where(xp.less(z, 0.0), -1.0, 1.0)
    a = -1.0 / (sign + z)
    b = times(times(x, y), a)
    first = 1.0 + sign * times(times(x, x), a), times(sign, b), -(sign * x)
    return first, (b, sign + times(times(y, y), a), -y)


def axes_of(normals: Array) -> Array:
    """Two tangents and the normal (n, 3, 3) of unit normals (n, 3)."""
    return np.array([*tangents(tuple(normals.T), Numbers), normals.T]).transpose(2, 0, 1)


def between_balls(motion: KinematicState, a: Core, b: Core) -> Nearest:
    """The nearest points of two balls about core points."""
    xp = motion.xp
    (first, x, along_a), (second, y, along_b) = a, b
    line = sub(add(x, along_a), add(y, along_b))
    distance = xp.sqrt(dot(line, line))
    n = scale(1.0 / distance, line)
    ends = (Place(ball.frame, ball.point, add(along, scale(side * ball.radius, n)))
            for ball, along, side in ((first, along_a, -1.0), (second, along_b, 1.0)))  # fmt: skip
    return Nearest(minus(distance, first.radius + second.radius), (n, *tangents(n, xp)), *ends)


def limited(x: Scalar, most: Scalar, xp: Any) -> Scalar:
    """x between -most and most."""
    low = xp.where(xp.less(x, -most), -most, x)
    return xp.where(xp.less(most, low), most, low)


def _nearest_of_segments(apart: Vec, u: Vec | None, w: Vec | None, xp: Any) -> tuple[Vec, Vec]:
    """(s u, t w) with s and t from -1 to 1, nearest to each other. apart: of the middles; None: a point, no segment."""
    if u is None:
        return ZERO, ZERO if w is None else scale(_along(w, apart, xp), w)
    if w is None:
        return scale(_along(u, scale(-1.0, apart), xp), u), ZERO
    a, b, c, d, e = dot(u, u), dot(u, w), dot(w, w), dot(u, apart), dot(w, apart)
    # The nearest points of the lines, then each limited in turn.
    size = a * c - b * b
    crossing = xp.less(PARALLEL * a * c, size)
    s = xp.where(crossing, (b * e - c * d) / xp.where(crossing, size, 1.0), 0.0)
    t = limited((b * limited(s, 1.0, xp) + e) / c, 1.0, xp)
    return scale(limited((b * t - d) / a, 1.0, xp), u), scale(t, w)


def _along(line: Vec, far: Vec, xp: Any) -> Scalar:
    """s from -1 to 1 of the point s line of a segment that is nearest to a point."""
    return limited(dot(line, far) / dot(line, line), 1.0, xp)


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

    def nearest(self, motion: KinematicState) -> Nearest:
        """The lowest point of the rim."""
        xp = motion.xp
        n, s, t = (motion.direction(self.frame, axis) for axis in (self.normal, *tangents(self.normal, xp)))
        downward = down_rim(n, motion.direction(self.link, self.axis))
        square = dot(downward, downward)
        length = xp.sqrt(xp.where(xp.less(square, NO_DIRECTION), NO_DIRECTION, square))
        offset = scale(self.radius / length, downward)
        apart = sub(add(motion.position(self.link, self.point), offset), motion.position(self.frame))
        gap = minus(dot(n, apart), self.height)
        touched = sub(apart, scale(gap, n))
        return Nearest(gap, (n, s, t), Place(self.link, self.point, offset), Place(self.frame, ZERO, touched))

    def value(self, motion: KinematicState) -> Scalar:
        """g, or AWAY of a disc that lies flat."""
        flat = motion.xp.less(self._tilt(motion), FLAT)
        return motion.xp.where(flat, AWAY, motion.once(self.nearest).gap)

    def single(self, motion: KinematicState) -> Scalar:
        """The square of the sine of its tilt."""
        return minus(self._tilt(motion), PARALLEL)

    def _tilt(self, motion: KinematicState) -> Scalar:
        return tilt_of(motion, (self.frame, self.normal), (self.link, self.axis))


class StandGap(PlaneGap, frozen=True):
    """From a point of the rim of a disc of body a to a plane of body b while the disc lies flat, else AWAY.

    axis: u of the disc in the frame of a. The points are corners of a polygon within the disc: where the load tips the
    disc over that, `single` ends the run, though the disc itself might still stand.
    """

    axis: Vec

    def value(self, motion: KinematicState) -> Scalar:
        """g, or AWAY of a disc that is tilted."""
        return motion.xp.where(motion.xp.less(self._tilt(motion), FLAT), motion.once(self.nearest).gap, AWAY)

    def single(self, motion: KinematicState) -> Scalar:
        """1 less the square of the sine of its tilt over that up to which it lies flat."""
        return 1.0 - self._tilt(motion) / FLAT

    def _tilt(self, motion: KinematicState) -> Scalar:
        return tilt_of(motion, (self.frame, self.normal), (self.ball.frame, self.axis))


def down_rim(n: Vec, u: Vec) -> Vec:
    """(n . u) u - n: from the middle of a disc with the axis u to its lowest point over a plane; 0 where it is flat."""
    return sub(scale(dot(n, u), u), n)


def tilt_of(motion: KinematicState, *ways: tuple[str, Vec]) -> Scalar:
    """The square of the sine between two directions, each fixed in a frame."""
    tilt = cross(*(motion.direction(frame, way) for frame, way in ways))
    return dot(tilt, tilt)


class HullGap(Gap, frozen=True):
    """From a ball of body a to a convex hull of body b.

    frame: the hull's link. edges: their ends in the link's axes. faces: of each its corners in order around its
    outward normal. Source: Ericson, Real-Time Collision Detection, 2005, sections 5.1.2 and 5.1.5.
    """

    ball: Ball
    frame: str
    edges: tuple[tuple[Vec, Vec], ...]
    faces: tuple[tuple[Vec, ...], ...]

    def nearest(self, motion: KinematicState) -> Nearest:
        """The nearest of the nearest points of edges, and of the feet on the faces that are below the ball."""
        xp = motion.xp
        x, origin = self.ball.centre(motion), motion.position(self.frame)
        ex, ey, ez = (motion.direction(self.frame, axis) for axis in IDENTITY)
        apart = sub(x, origin)
        own = dot(ex, apart), dot(ey, apart), dot(ez, apart)
        square, place = _on_edge(own, *self.edges[0], xp)
        for found in (*(_on_edge(own, *edge, xp) for edge in self.edges[1:]),
                      *(_on_face(own, face, xp) for face in self.faces)):  # fmt: skip
            closer = xp.less(found[0], square)
            square = xp.where(closer, found[0], square)
            a, b, c = (xp.where(closer, new, old) for new, old in zip(found[1], place, strict=True))
            place = a, b, c
        offset = add(add(scale(place[0], ex), scale(place[1], ey)), scale(place[2], ez))
        hull: Core = Ball(self.frame, ZERO, 0.0), origin, offset
        return between_balls(motion, (self.ball, x, ZERO), hull)


def _on_edge(x: Vec, a: Vec, b: Vec, xp: Any) -> tuple[Scalar, Vec]:
    """The square of the distance from an edge, and its nearest point."""
    half, middle = scale(0.5, sub(b, a)), scale(0.5, add(a, b))
    apart = sub(x, middle)
    along = scale(limited(dot(half, apart) / dot(half, half), 1.0, xp), half)
    off = sub(apart, along)
    return dot(off, off), add(middle, along)


def _on_face(x: Vec, corners: tuple[Vec, ...], xp: Any) -> tuple[Scalar, Vec]:
    """The square of the distance from a face, and the foot on it; NEVER where that is beside the face or behind it.

    The square is a little smaller: by rounding alone the face's edge would be the nearest from sqrt(eps) h before it.
    """
    normal = unit(cross(sub(corners[1], corners[0]), sub(corners[2], corners[1])), "vertices")
    height = dot(normal, sub(x, corners[0]))
    inside = height
    for a, b in zip(corners, (*corners[1:], corners[0]), strict=True):
        beside = dot(unit(cross(normal, sub(b, a)), "vertices"), sub(x, a))
        inside = xp.where(xp.less(beside, inside), beside, inside)
    return xp.where(xp.less(inside, 0.0), NEVER, FACE_FIRST * height * height), sub(x, scale(height, normal))
