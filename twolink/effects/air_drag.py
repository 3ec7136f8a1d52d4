"""Drag of the air on a body."""

from typing import ClassVar

from twolink.algorithms.spatial import add, dot, scale, times
from twolink.dynamics import Robot
from twolink.effects.effect import Effect, LinkName, NotNegative, number
from twolink.effects.frame_checks import check_frame, floats
from twolink.effects.inputs import Input, value_at
from twolink.effects.motion import Loads, Motion

# m/s. |u| has no second derivative at u = 0, and the formula of its first derivative is 0 / 0 there, which a solver
# that differentiates the equations meets at rest. sqrt(u . u + SLOW^2) has both. The force stays opposite to u, so
# that in still air energy never grows; it is wrong by rho c A SLOW^2 / 4 at most, 3e-13 N for a square metre.
SLOW = 1e-6


class AirDrag(Effect, frozen=True):
    """Drag of the air at a point of a link: F = -rho c A |u| u / 2, u the point's velocity relative to the air.

    Parameters
    ----------
    frame : str
        The link.
    area : float
        A, the area of the body from any side, m^2.
    coefficient : float
        c, the drag coefficient.
    density : float
        rho, the density of the air, kg/m^3.
    point : (3,) floats
        Where the force acts, in the link's frame, m.
    wind : (3,) inputs
        The air's velocity along the world's axes, m/s: numbers or functions of time.

    Notes
    -----
    |u| is computed as sqrt(u . u + 1e-12 m^2/s^2), which is smooth at rest. The series of Taylor's method converge
    only over short steps where u passes 0, so `method="auto"` takes another method.

    References
    ----------
    Rayleigh's drag equation: Batchelor, An Introduction to Fluid Dynamics, 1967, section 5.11.
    """

    frame: LinkName
    area: NotNegative
    coefficient: NotNegative = 1.0
    density: NotNegative = 1.225
    point: tuple[float, float, float] = (0.0, 0.0, 0.0)
    wind: tuple[Input, Input, Input] = (0.0, 0.0, 0.0)

    analytic: ClassVar[bool] = False  # see the notes

    def check(self, robot: Robot) -> None:
        """Require a link that moves."""
        check_frame(self.frame, robot, "frame")

    def act(self, motion: Motion, loads: Loads) -> None:
        """Add -rho c A |u| u / 2."""
        k = -0.5 * number(self.density) * number(self.coefficient) * number(self.area)
        if k == 0.0:
            return
        point = floats(self.point)
        x, y, z = (value_at(wind, motion.t, motion.xp) for wind in self.wind)
        u = add(motion.velocity(self.frame, point), scale(-1.0, (x, y, z)))
        speed = motion.xp.sqrt(dot(u, u) + SLOW**2)
        loads.force(self.frame, scale(times(k, speed), u), point=point)
