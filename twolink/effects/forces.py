"""Forces in joints and on links, by position, velocity and time."""

from collections.abc import Mapping
from typing import Annotated, ClassVar, Literal

from twolink.algorithms.motion import KinematicState
from twolink.algorithms.spatial import Vec, add, dot, minus, negative, plus, reciprocal, scale, times
from twolink.dynamics import Robot
from twolink.effects.checks import check_frame, check_values_or_urdf, floats, values_by_dof
from twolink.effects.effect import (
    AboveZero,
    CoordinateJoint,
    Effect,
    JointName,
    LinkName,
    Load,
    Loads,
    NotNegative,
    Place,
    PlaceName,
    SingleJoint,
    SomeLoad,
    Speed,
    inverse,
    number,
    of,
)
from twolink.effects.inputs import EffortSignal, Input, value_at
from twolink.errors import SceneError


class Torque(Effect, frozen=True):
    """Torques and forces in joints: tau_k = u_k(t).

    Parameters
    ----------
    inputs : mapping of joint to input
        u, N m or N: numbers, `Polynomial`, `Sine` or `Sampled` tables. Joints with one degree of freedom.
    """

    inputs: Mapping[SingleJoint, EffortSignal]

    def act(self, motion: KinematicState, loads: Loads) -> None:
        """Add u(t)."""
        for joint, u in self.inputs.items():
            loads.torque(motion.dofs(joint)[0], value_at(u, motion.t, motion.xp))


class JointDamping(Effect, frozen=True):
    """Viscous damping of joints: tau = -d v.

    Parameters
    ----------
    damping : mapping of joint to float, or None
        d, N m s/rad or N s/m, not negative; the same for each degree of freedom of a joint. None: all joints, with the
        values of the URDF (<dynamics damping>), which forward dynamics alone does not apply.
    """

    damping: Mapping[JointName, NotNegative] | None = None

    def check(self, robot: Robot) -> None:
        """Require joints, or damping in the URDF."""
        check_values_or_urdf(self.damping, robot.model.damping, "damping")

    def viscosity(self, robot: Robot) -> Mapping[str, float]:
        """d by joint."""
        return self.damping or {joint.name: float(robot.model.damping[joint.v][0]) for joint in robot.joints}

    def act(self, motion: KinematicState, loads: Loads) -> None:
        """Add -d v."""
        for k, d in values_by_dof(self.damping, motion.model.damping, motion).items():
            loads.torque(k, times(-d, motion.v[k]))


class JointSpring(Effect, frozen=True):
    """Springs in joints (Hooke's law): tau = -k (q - q0), with the energy k (q - q0)^2 / 2.

    Parameters
    ----------
    stiffness : mapping of joint to float
        k, N m/rad or N/m, not negative. Joints with one coordinate.
    rest : mapping of joint to float
        q0, rad or m; 0 by default.
    """

    stiffness: Mapping[CoordinateJoint, NotNegative]
    rest: Annotated[Mapping[str, Place], of("stiffness")] = {}

    def act(self, motion: KinematicState, loads: Loads) -> None:
        """Add -k (q - q0)."""
        for joint, k in self.stiffness.items():
            entry, dof = motion.coordinate(joint)
            loads.torque(dof, times(-number(k), plus(motion.q[entry], -number(self.rest.get(joint, 0.0)))))


class SmoothFriction(Effect, frozen=True):
    """Smoothed Coulomb friction in joints: tau = -f tanh(v / s).

    Parameters
    ----------
    friction : mapping of joint to float, or None
        f, N m or N, not negative; the same for each degree of freedom of a joint. None: all joints, with the values of
        the URDF (<dynamics friction>).
    scale : float
        s, rad/s or m/s, above 0.

    Notes
    -----
    The torque differs from Coulomb's -f sign(v) by f (1 - tanh(|v| / s)), less than 0.5 % of f where |v| > 3 s. The
    joint does not stick: under a load L < f it creeps at v = s atanh(L / f). Below s the effect is viscous damping
    f / s; the smaller s, the stiffer the equations. `DryFriction` sticks.

    References
    ----------
    Andersson, Söderberg, Björklund 2007, Tribology International 40(4), 580-587.
    """

    friction: Mapping[JointName, Load] | None = None
    scale: AboveZero = 0.01

    def check(self, robot: Robot) -> None:
        """Require joints, or friction in the URDF."""
        check_values_or_urdf(self.friction, robot.model.friction, "friction")

    def act(self, motion: KinematicState, loads: Loads) -> None:
        """Add -f tanh(v / s)."""
        for k, f in values_by_dof(self.friction, motion.model.friction, motion).items():
            if f:
                loads.torque(k, times(-f, motion.xp.tanh(times(1.0 / self.scale, motion.v[k]))))


class LuGreFriction(Effect, frozen=True):
    """LuGre friction in joints: bristles bend, slip as Stribeck's curve says, and creep before they do.

        z' = v - |v| z / g,   tau = -(k z + d z' + f v),   k g = c + (s - c) exp(-(v / w)^2)

    Parameters
    ----------
    stiffness : mapping of joint to float
        k of the bristles, N m/rad or N/m, above 0. Joints with one degree of freedom.
    coulomb : mapping of joint to float
        c, N m or N, above 0; for each joint with a stiffness.
    static : mapping of joint to float
        s, N m or N: to break away; c by default.
    stribeck : mapping of joint to float
        w, rad/s or m/s, above 0: the speed at which friction falls from s to c; for each joint with a static friction.
    damping : mapping of joint to float
        d of the bristles, N m s/rad or N s/m; 0 by default.
    viscous : mapping of joint to float
        f, N m s/rad or N s/m; 0 by default.

    Notes
    -----
    States: "JOINT.bristle", k z, N m or N, 0 at the start. Beside `DryFriction`, which needs no stiffness and holds a
    joint exactly, it has presliding displacement, hysteresis and varying break-away forces. The equations are stiff.

    References
    ----------
    Canudas de Wit, Olsson, Åström, Lischinsky 1995, IEEE Transactions on Automatic Control 40(3), 419-425.
    """

    stiffness: Mapping[SingleJoint, AboveZero]
    coulomb: Annotated[Mapping[str, SomeLoad], of("stiffness", each=True)]
    static: Annotated[Mapping[str, Load], of("stiffness")] = {}
    stribeck: Annotated[Mapping[str, Speed], of("static", each=True)] = {}
    damping: Annotated[Mapping[str, NotNegative], of("stiffness")] = {}
    viscous: Annotated[Mapping[str, NotNegative], of("stiffness")] = {}

    analytic: ClassVar[bool] = False  # where v passes 0

    def states(self, motion: KinematicState) -> Mapping[str, float]:
        """k z."""
        del motion
        return {f"{joint}.bristle": 0.0 for joint in self.stiffness}

    def act(self, motion: KinematicState, loads: Loads) -> None:
        """Add tau, and give k z'."""
        xp = motion.xp
        for joint, stiffness in self.stiffness.items():
            dof, bent = motion.dofs(joint)[0], motion.states[f"{joint}.bristle"]
            v, slip = motion.v[dof], number(self.coulomb[joint])
            if joint in self.static:
                ratio = times(inverse(self.stribeck[joint]), v)
                slip = plus(slip, times(minus(number(self.static[joint]), slip), xp.exp(negative(times(ratio, ratio)))))
            speed = xp.where(xp.less(v, 0.0), negative(v), v)
            rate = times(number(stiffness), minus(v, speed * bent / slip))
            loads.rates[f"{joint}.bristle"] = rate
            damping = times(times(number(self.damping.get(joint, 0.0)), inverse(stiffness)), rate)
            loads.torque(dof, negative(plus(bent, damping, times(number(self.viscous.get(joint, 0.0)), v))))


Three = tuple[Input, Input, Input]


class FrameWrench(Effect, frozen=True):
    """A force f(t) at a point of a link, and a moment n(t): tau = J_v^T f + J_w^T n.

    J_v and J_w are the Jacobians of the point's velocity and of the link's angular velocity.

    Parameters
    ----------
    frame : str
        The link.
    force : (3,) inputs
        f, N: numbers or functions of time.
    moment : (3,) inputs
        n, N m: numbers or functions of time.
    axes : "world" or "frame"
        The axes of force and moment: the world's, or the link's, with which they turn.
    point : (3,) floats
        Where the force acts, in the link's frame, m.
    """

    frame: LinkName
    force: Three = (0.0, 0.0, 0.0)
    moment: Three = (0.0, 0.0, 0.0)
    axes: Literal["world", "frame"] = "world"
    point: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def act(self, motion: KinematicState, loads: Loads) -> None:
        """Add f and n, moved to the joint that carries the link."""
        force, moment, point = _value(self.force, motion), _value(self.moment, motion), floats(self.point)
        loads.force(self.frame, force, moment, point, axes=self.axes)


def _value(vector: Three, motion: KinematicState) -> Vec:
    x, y, z = (value_at(component, motion.t, motion.xp) for component in vector)
    return x, y, z


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

    def act(self, motion: KinematicState, loads: Loads) -> None:
        """Add -rho c A |u| u / 2."""
        k = -0.5 * number(self.density) * number(self.coefficient) * number(self.area)
        if k == 0.0:
            return
        point = floats(self.point)
        x, y, z = (value_at(wind, motion.t, motion.xp) for wind in self.wind)
        u = add(motion.velocity(self.frame, point), scale(-1.0, (x, y, z)))
        speed = motion.xp.sqrt(dot(u, u) + SLOW**2)
        loads.force(self.frame, scale(times(k, speed), u), point=point)


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

    first: PlaceName
    second: PlaceName
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

    def act(self, motion: KinematicState, loads: Loads) -> None:
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
