"""Loops: constraints g(q) = 0 or b(q) v = 0 between places of a robot, besides its joints."""

import math
from collections.abc import Sequence
from typing import ClassVar

import numpy as np
import pinocchio as pin

from twolink.algorithms.motion import GROUND, KinematicState
from twolink.algorithms.spatial import ZERO, Scalar, Vec, across, dot, minus, plus, times, unit
from twolink.dynamics import Robot
from twolink.effects.checks import apart
from twolink.effects.effect import CoordinateJoint, Direction, Effect, PlaceName
from twolink.errors import SceneError


class Loop(Effect, frozen=True):
    """A rigid bilateral constraint, held by the force J^T lambda that it takes.

    Redundant rows are recognized and dropped, so that a planar loop may be given as the whole joint.
    """

    touches: ClassVar[bool] = False  # whether it is that of bodies that touch
    max_rows: ClassVar[int] = 0  # the number of rows in the mode that has most; 0 where it has no modes

    def carrier(self, motion: KinematicState) -> int:
        """The body along whose axes the rows are, where they are differences of points; 0 is the ground.

        Seen from the nearest body that carries both places, the rows do not depend on the joints that carry it: a loop
        that hangs on a long chain costs what it costs alone.
        """
        del motion
        return 0

    def rows(self, motion: KinematicState) -> list[Scalar]:
        """g(q), m and (of directions) 1: what stays 0."""
        raise NotImplementedError

    def require_closed(self, motion: KinematicState) -> None:
        """Require of a motion by numbers, where the rows are 0, the place that they mean. Raises SceneError."""

    def velocity_rows(self, motion: KinematicState) -> list[Scalar]:
        """b(q) v, m/s: what stays 0 of velocities alone, as rolling does. Linear in v."""
        del motion
        return []

    def forces(self, motion: KinematicState, along: KinematicState) -> list[Scalar] | None:
        """The power along another velocity of each row's force of size 1, where that force is not the row's J^T.

        motion: q and v. along: the same q and some other velocity. Friction is such a force: it comes with the normal
        one, and does not act along it.
        """
        del motion, along
        return None

    def contact_force(self, motion: KinematicState, multipliers: Sequence[Scalar]) -> tuple[str, Vec, Vec] | None:
        """The pair of bodies whose contact this is, the point where it acts, m, and the force on the first, N.

        Both are along the world's axes.
        """
        del motion, multipliers
        return None

    def contact_slip(self, motion: KinematicState) -> Vec:
        """The velocity of the first of two bodies that touch relative to the second one, along the contact, m/s."""
        del motion
        return ZERO


class _CommonPoint(Loop, frozen=True):
    """A point of link a at a point of link b."""

    a: PlaceName
    b: PlaceName = GROUND
    point_a: tuple[float, float, float] = (0.0, 0.0, 0.0)
    point_b: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def carrier(self, motion: KinematicState) -> int:
        """The nearest body that carries a and b."""
        return motion.carrier(self.a, self.b)

    def rows(self, motion: KinematicState) -> list[Scalar]:
        """x_a - x_b along the carrier's axes."""
        return apart(motion.seen_from(self.carrier(motion)), self.a, self.point_a, self.b, self.point_b)


class PointLoop(_CommonPoint, frozen=True):
    """A point of link a stays at a point of link b: g = x_a - x_b.

    Parameters
    ----------
    a, b : str
        Links; b may be the "universe", the ground.
    point_a, point_b : (float, float, float)
        In the links' axes, m.
    """


class HingeLoop(Loop, frozen=True):
    """A hinge: a common point, x_a = x_b, and a common axis; b's axis has no part across a's.

    Parameters
    ----------
    a, b : str
        Links; b may be the "universe", the ground.
    axis_a, axis_b : (float, float, float)
        The hinge's direction in the links' axes, of any length.
    point_a, point_b : (float, float, float)
        In the links' axes, m.
    """

    a: PlaceName
    axis_a: Direction
    axis_b: Direction
    b: PlaceName = GROUND
    point_a: tuple[float, float, float] = (0.0, 0.0, 0.0)
    point_b: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def carrier(self, motion: KinematicState) -> int:
        """The nearest body that carries a and b."""
        return motion.carrier(self.a, self.b)

    def rows(self, motion: KinematicState) -> list[Scalar]:
        """x_a - x_b, and the parts of b's axis along two directions across a's."""
        motion = motion.seen_from(self.carrier(motion))
        axis = motion.direction(self.b, unit(self.axis_b, "axis_b"))
        ways = [motion.direction(self.a, way) for way in across(unit(self.axis_a, "axis_a"))]
        return [*apart(motion, self.a, self.point_a, self.b, self.point_b), *(dot(way, axis) for way in ways)]


_AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
MEANT = 2.0  # a_1 . b_1 + a_2 . b_2 + a_3 . b_3, which is 3; 0 or -1 at other zeros of the rows


class WeldLoop(_CommonPoint, frozen=True):
    """Link a is fixed to link b: x_a = x_b, and equal axes.

    Parameters
    ----------
    a, b : str
        Links; b may be the "universe", the ground.
    point_a, point_b : (float, float, float)
        In the links' axes, m.
    rpy : (float, float, float)
        The orientation of a in b: roll, pitch, yaw as in URDF, rad.
    """

    rpy: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def rows(self, motion: KinematicState) -> list[Scalar]:
        """x_a - x_b, and for axes a_i of a and b_i of b: a_2 . b_3, a_3 . b_1, a_1 . b_2."""
        motion = motion.seen_from(self.carrier(motion))
        theirs, ours = self._axes(motion)
        turns = [dot(ours[i], theirs[j]) for i, j in ((1, 2), (2, 0), (0, 1))]
        return [*apart(motion, self.a, self.point_a, self.b, self.point_b), *turns]

    def _axes(self, motion: KinematicState) -> tuple[list[Vec], list[Vec]]:
        """The axes of b, turned by rpy, and those of a, which are to be the same."""
        turned = pin.rpy.rpyToMatrix(*self.rpy).T.tolist()  # its rows: a's axes as b sees them
        theirs = [motion.direction(self.b, tuple(axis)) for axis in turned]
        return theirs, [motion.direction(self.a, axis) for axis in _AXES]

    def require_closed(self, motion: KinematicState) -> None:
        """Require equal axes: the rows are 0 too where a is turned by 180 degrees about one, or by 120 about all."""
        theirs, ours = (np.array(axes, dtype=float) for axes in self._axes(motion))
        cosines = ours @ theirs.T
        if np.trace(cosines) < MEANT:
            rpy = ", ".join(f"{x:.6g}" for x in pin.rpy.matrixToRpy(pin.rpy.rpyToMatrix(*self.rpy) @ cosines.T))
            angle = math.degrees(math.acos(max(-1.0, 0.5 * (float(np.trace(cosines)) - 1.0))))
            what = f"the nearest position has {self.a!r} turned by {angle:.0f} degrees from the rpy of its weld"
            raise SceneError(what, where="effects", code="loops-open",
                             remedy=f"start nearer to that orientation, or give rpy=({rpy})")  # fmt: skip


class Coupling(Loop, frozen=True):
    """Two coordinates coupled by gears or a belt: g = q_joint - ratio q_other - offset.

    Parameters
    ----------
    joint, other : str
        Joints with one coordinate, an angle or a length.
    ratio : float
        As in the equation.
    offset : float
        rad or m.
    """

    joint: CoordinateJoint
    other: CoordinateJoint
    ratio: float
    offset: float = 0.0

    def check(self, robot: Robot) -> None:
        """Require two joints."""
        del robot
        if self.joint == self.other:
            raise SceneError(f"joint {self.joint!r} is coupled to itself", where="other", remedy="name two joints")

    def rows(self, motion: KinematicState) -> list[Scalar]:
        """q_joint - ratio q_other - offset."""
        ours, theirs = motion.coordinate(self.joint)[0], motion.coordinate(self.other)[0]
        driven = plus(times(float(self.ratio), motion.q[theirs]), float(self.offset))
        return [minus(motion.q[ours], driven)]
