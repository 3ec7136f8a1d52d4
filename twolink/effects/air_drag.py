"""Drag of the air on a body."""

from __future__ import annotations

from twolink.algorithms.spatial import add, dot, scale, times
from twolink.dynamics import Robot
from twolink.effects.effect import Effect, finite
from twolink.effects.frame_checks import check_frame, check_three, floats, three
from twolink.effects.inputs import Input, check_input, value_at
from twolink.effects.motion import Loads, Motion

# m/s. |u| itself has no second derivative at u = 0, and its first is 0 / 0 as formulas go, which a solver that
# differentiates the equations meets at rest. The root of u . u + SLOW^2 has all. The force stays against u, so that
# in still air energy never grows, and is off by rho c A SLOW^2 / 4 at most: 3e-13 N for a square metre.
SLOW = 1e-6


class AirDrag(Effect, frozen=True):
    """F = -rho c A |u| u / 2 at a point of a frame, u its velocity against the air (Rayleigh's drag equation).

    frame: a link. area: A, m^2, the same from all sides. coefficient: c. density: rho, kg/m^3. point: where the force
    acts, in the frame, m. wind: the air's velocity along the world's axes, m/s: numbers or functions of time.

    |u| is taken as sqrt(u . u + 1e-12 m^2/s^2): smooth, with a force against u and less than 1e-12 N off for bodies
    below 3 m^2. Taylor's series are short where u passes 0, so that "auto" takes another method.
    """

    frame: str
    area: float
    coefficient: float = 1.0
    density: float = 1.225
    point: tuple[float, float, float] = (0.0, 0.0, 0.0)
    wind: tuple[Input, Input, Input] = (0.0, 0.0, 0.0)

    @property
    def analytic(self) -> bool:
        """Not for Taylor's method: see above."""
        return False

    def check(self, robot: Robot) -> None:
        """The frame moves; area, coefficient and density are not negative."""
        check_frame(self.frame, robot, "frame")
        for name in ("area", "coefficient", "density"):
            finite(getattr(self, name), name, least=0.0)
        check_three(self.point, "point")
        for i, wind in enumerate(three(self.wind, "wind")):
            check_input(wind, f"wind[{i}]")

    def act(self, motion: Motion, loads: Loads) -> None:
        """-rho c A |u| u / 2."""
        k = -0.5 * float(self.density) * float(self.coefficient) * float(self.area)
        if k == 0.0:
            return
        point = floats(self.point)
        x, y, z = (value_at(wind, motion.t, motion.xp) for wind in self.wind)
        u = add(motion.velocity(self.frame, point), scale(-1.0, (x, y, z)))
        speed = motion.xp.sqrt(dot(u, u) + SLOW**2)
        loads.force(self.frame, scale(times(k, speed), u), point=point)
