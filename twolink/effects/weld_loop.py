"""A rigid connection of two links that closes a loop."""

import pinocchio as pin

from twolink.algorithms.spatial import Scalar, dot
from twolink.dynamics import Robot
from twolink.effects.effect import LinkName
from twolink.effects.frame_checks import apart, check_frame
from twolink.effects.loop import Loop
from twolink.effects.motion import GROUND, Motion

_AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


class WeldLoop(Loop, frozen=True):
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

    a: LinkName
    b: LinkName = GROUND
    point_a: tuple[float, float, float] = (0.0, 0.0, 0.0)
    point_b: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rpy: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def check(self, robot: Robot) -> None:
        """Require links."""
        check_frame(self.a, robot, "a", ground=True)
        check_frame(self.b, robot, "b", ground=True)

    def carrier(self, motion: Motion) -> int:
        """The nearest body that carries a and b."""
        return motion.carrier(self.a, self.b)

    def rows(self, motion: Motion) -> list[Scalar]:
        """x_a - x_b, and for axes a_i of a and b_i of b: a_2 . b_3, a_3 . b_1, a_1 . b_2."""
        motion = motion.seen_from(self.carrier(motion))
        turned = pin.rpy.rpyToMatrix(*self.rpy).T.tolist()  # its rows: a's axes as b sees them
        theirs = [motion.direction(self.b, tuple(axis)) for axis in turned]
        ours = [motion.direction(self.a, axis) for axis in _AXES]
        turns = [dot(ours[i], theirs[j]) for i, j in ((1, 2), (2, 0), (0, 1))]
        return [*apart(motion, self.a, self.point_a, self.b, self.point_b), *turns]
