"""A spring, damper and actuator between two points."""

from twolink.algorithms.spatial import add, dot, plus, reciprocal, scale, times
from twolink.dynamics import Robot
from twolink.effects.effect import Effect, LinkName, NotNegative, number
from twolink.effects.frame_checks import check_frame, floats
from twolink.effects.inputs import Input, value_at
from twolink.effects.motion import Loads, Motion
from twolink.errors import SceneError


class SpringBetween(Effect, frozen=True):
    """A tension T = k (l - l0) + c l' + F along the line between two points, l apart.

    T > 0 pulls the points together, T < 0 pushes them apart.

    Parameters
    ----------
    first, second : str
        Links, or "universe" for the ground.
    stiffness : float
        k, N/m, not negative.
    rest_length : float
        l0, m, not negative.
    damping : float
        c, N s/m, not negative.
    force : input
        F, N: a number or a function of time.
    first_point, second_point : (3,) floats
        The points, m: in the links' frames; of the ground, in the world's coordinates.

    Notes
    -----
    The line has no direction where the points coincide. The equations are singular there, and a run that meets such
    a state ends in an error. A spring with l0 = 0, c = 0 and F = 0 has no such state.

    References
    ----------
    Haug, Computer Aided Kinematics and Dynamics of Mechanical Systems, 1989: the spring-damper-actuator.
    """

    first: LinkName
    second: LinkName
    stiffness: NotNegative = 0.0
    rest_length: NotNegative = 0.0
    damping: NotNegative = 0.0
    force: Input = 0.0
    first_point: tuple[float, float, float] = (0.0, 0.0, 0.0)
    second_point: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def check(self, robot: Robot) -> None:
        """Require two points on different bodies."""
        bodies = [check_frame(getattr(self, field), robot, field, ground=True) for field in ("first", "second")]
        if bodies[0] == bodies[1]:
            what = f"{self.first!r} and {self.second!r} do not move against each other"
            raise SceneError(what, where="second", remedy="name links with a joint between them")

    def act(self, motion: Motion, loads: Loads) -> None:
        """Add T n to the first point and -T n to the second, n the direction from the first to the second."""
        near, far = floats(self.first_point), floats(self.second_point)
        k, c, rest = number(self.stiffness), number(self.damping), number(self.rest_length)
        line = add(motion.position(self.second, far), scale(-1.0, motion.position(self.first, near)))
        constant = plus(-k * rest, value_at(self.force, motion.t, motion.xp))
        tension = scale(k, line)
        if c or not (type(constant) is float and constant == 0.0):
            direction = scale(reciprocal(motion.xp.sqrt(dot(line, line)), motion.xp), line)
            if c:
                velocity = motion.velocity(self.second, far)
                apart = add(velocity, scale(-1.0, motion.velocity(self.first, near)))
                constant = plus(constant, times(c, dot(direction, apart)))
            tension = add(tension, scale(constant, direction))
        loads.force(self.first, tension, point=near)
        loads.force(self.second, scale(-1.0, tension), point=far)
