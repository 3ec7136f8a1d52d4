"""Coordinates coupled by gears or belts."""

from twolink.algorithms.spatial import Scalar, minus, plus, times
from twolink.dynamics import Robot
from twolink.effects.effect import JointName, check_name
from twolink.effects.loop import Loop
from twolink.effects.motion import Motion
from twolink.errors import SceneError


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

    joint: JointName
    other: JointName
    ratio: float
    offset: float = 0.0

    def check(self, robot: Robot) -> None:
        """Joints exist and have one coordinate."""
        names = [j.name for j in robot.joints if j.kind == "vector"]
        check_name(self.joint, names, "joint", "joint with one coordinate")
        check_name(self.other, names, "other", "joint with one coordinate")
        if self.joint == self.other:
            raise SceneError(f"joint {self.joint!r} is coupled to itself", where="other", remedy="name two joints")

    def rows(self, motion: Motion) -> list[Scalar]:
        """q_joint - ratio q_other - offset."""
        ours, theirs = motion.coordinate(self.joint)[0], motion.coordinate(self.other)[0]
        driven = plus(times(float(self.ratio), motion.q[theirs]), float(self.offset))
        return [minus(motion.q[ours], driven)]
