"""A ball or a point of a link that meets a plane: it bounces, slides, rolls or sticks."""

from twolink.algorithms.motion import GROUND
from twolink.algorithms.spatial import unit
from twolink.dynamics import Robot
from twolink.effects.checks import check_frame, floats
from twolink.effects.contact_law import contact_point
from twolink.effects.effect import LinkName, NotNegative
from twolink.effects.gaps import Ball, PlaneGap
from twolink.effects.joint_switches import check_restitution
from twolink.effects.switching import ContactPoint, SwitchingEffect


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

    frame: LinkName
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

    def modes(self, robot: Robot) -> list[ContactPoint]:
        """The gap to the plane."""
        del robot
        ball = Ball(self.frame, floats(self.point), float(self.radius))
        gap = PlaneGap(ball, GROUND, unit(self.normal, "normal"), float(self.height))
        return [contact_point(self.frame, gap, float(self.friction), float(self.restitution))]
