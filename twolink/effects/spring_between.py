"""A spring, damper and actuator between two points."""

from __future__ import annotations

from twolink.algorithms.spatial import add, dot, plus, reciprocal, scale, times
from twolink.dynamics import Robot
from twolink.effects.effect import Effect, finite
from twolink.effects.frame_checks import check_frame, check_three, floats
from twolink.effects.inputs import Input, check_input, value_at
from twolink.effects.motion import Loads, Motion
from twolink.errors import SceneError


class SpringBetween(Effect, frozen=True):
    """A tension T = k (l - l0) + c l' + F along the line between two points, l apart.

    T > 0 pulls the points together, T < 0 pushes them apart; F has the same sign (as in Haug's spring-damper-actuator,
    and SUNDIALS' slider-crank).

    first, second: links, or "universe" for the ground. first_point, second_point: the points, in their frames, m; of
    the ground in the world's coordinates. stiffness: k, N/m. rest_length: l0, m. damping: c, N s/m. force: F, N, a
    number or a function of time.

    The line has no direction where the points coincide: the equations are singular there, and a run that meets it ends
    in an error. A spring with l0 = 0, c = 0 and F = 0 pulls with k times the distance in each direction, and has none.
    """

    first: str
    second: str
    stiffness: float = 0.0
    rest_length: float = 0.0
    damping: float = 0.0
    force: Input = 0.0
    first_point: tuple[float, float, float] = (0.0, 0.0, 0.0)
    second_point: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def check(self, robot: Robot) -> None:
        """One of the frames moves, and not both with the same body; k, l0 and c are not negative."""
        moving = [check_frame(getattr(self, field), robot, field, ground=True) for field in ("first", "second")]
        bodies = {_body(robot, frame) for frame in (self.first, self.second)}
        if not any(moving) or len(bodies) == 1:
            raise SceneError(f"{self.first!r} and {self.second!r} do not move against each other", where="second",
                             remedy="name links with a joint between them")  # fmt: skip
        for name in ("stiffness", "rest_length", "damping"):
            finite(getattr(self, name), name, least=0.0)
        check_input(self.force, "force")
        check_three(self.first_point, "first_point")
        check_three(self.second_point, "second_point")

    def act(self, motion: Motion, loads: Loads) -> None:
        """T n on the first point, -T n on the second, n from the first to the second."""
        near, far = floats(self.first_point), floats(self.second_point)
        k, c, rest = float(self.stiffness), float(self.damping), float(self.rest_length)
        line = add(motion.position(self.second, far), scale(-1.0, motion.position(self.first, near)))
        constant = plus(-k * rest, value_at(self.force, motion.t, motion.xp))
        tension = scale(k, line)
        if c or not (type(constant) is float and constant == 0.0):
            inverse = reciprocal(motion.xp.sqrt(dot(line, line)), motion.xp)
            along = scale(inverse, line)
            if c:
                velocity = motion.velocity(self.second, far)
                apart = add(velocity, scale(-1.0, motion.velocity(self.first, near)))
                constant = plus(constant, times(c, dot(along, apart)))
            tension = add(tension, scale(constant, along))
        loads.force(self.first, tension, point=near)
        loads.force(self.second, scale(-1.0, tension), point=far)


def _body(robot: Robot, frame: str) -> int:
    """The joint that carries a frame; 0 is the ground."""
    found = robot.model.getFrameId(frame)
    return 0 if found >= robot.model.nframes else int(robot.model.frames[found].parentJoint)
