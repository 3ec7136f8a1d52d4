"""Controllers: torques of joints by what the robot does, within limits of effort."""

import dataclasses
import math
from collections.abc import Iterable, Mapping
from typing import Annotated, Any, Literal

from twolink.algorithms.motion import KinematicState
from twolink.algorithms.recursions import newton_euler
from twolink.algorithms.spatial import Scalar, Vec, add, cross, dot, minus, negative, plus, scale, times
from twolink.dynamics import Robot
from twolink.dynamics.arguments import configuration
from twolink.effects.checks import check_joint, check_subset, single_joints
from twolink.effects.effect import (
    CoordinateJoint,
    Effect,
    Effort,
    Load,
    Loads,
    NotNegative,
    SingleJoint,
    inverse,
    number,
    of,
)
from twolink.effects.inputs import EffortSignal, PlaceSignal, Sampled, derivatives_at, value_at
from twolink.errors import SceneError
from twolink.robots.joint_layout import joint_layouts

Limits = Mapping[str, Load] | Literal["urdf"] | None


class _Limited(Effect, frozen=True):
    """A controller whose torques may have limits, `effort`."""

    @property
    def analytic(self) -> bool:
        """True if there are no limits: a torque is not smooth where it reaches its limit."""
        return getattr(self, "effort", None) is None


class JointPD(_Limited, frozen=True):
    """Proportional-derivative control: tau = kp (target - q) - kd v + feedforward, within limits.

    Parameters
    ----------
    target : mapping of joint to input
        rad or m: numbers or functions of time. Joints with one coordinate.
    kp : mapping of joint to float
        N m/rad or N/m, not negative; for every joint with a target.
    kd : mapping of joint to float
        N m s/rad or N s/m, not negative; 0 by default.
    feedforward : mapping of joint to input
        N m or N: numbers or functions of time; 0 by default.
    effort : mapping of joint to float, "urdf" or None
        Limits L of the torques, -L <= tau <= L, N m or N: by joint, the URDF's, or none.

    Notes
    -----
    The controller is continuous in time: it does not sample.

    References
    ----------
    Siciliano et al., Robotics, 2009, section 8.5.1.
    """

    target: Mapping[CoordinateJoint, PlaceSignal]
    kp: Annotated[Mapping[str, NotNegative], of("target", each=True)]
    kd: Annotated[Mapping[str, NotNegative], of("target")] = {}
    feedforward: Annotated[Mapping[str, EffortSignal], of("target")] = {}
    effort: Limits = None

    def check(self, robot: Robot) -> None:
        """Require limits of joints with a target."""
        check_limits(self.effort, self.target, robot)

    def viscosity(self, robot: Robot) -> Mapping[str, float]:  # noqa: ARG002 what all effects are given
        """kd by joint."""
        return self.kd

    def act(self, motion: KinematicState, loads: Loads) -> None:
        """Add kp (target - q) - kd v + feedforward."""
        for joint, target in self.target.items():
            entry, dof = motion.coordinate(joint)
            error = minus(value_at(target, motion.t, motion.xp), motion.q[entry])
            torque = plus(
                times(number(self.kp[joint]), error),
                times(-number(self.kd.get(joint, 0.0)), motion.v[dof]),
                value_at(self.feedforward.get(joint, 0.0), motion.t, motion.xp),
            )
            loads.torque(dof, clamped(torque, joint, self.effort, motion, loads))


class PID(_Limited, frozen=True):
    """Proportional-integral-derivative control, with a filtered derivative and anti-windup.

        u = kp e + I - kd w,   e = target - q,   I' = ki e + (tau - u) / T,   F w' = v - w,   tau = u within its limits

    Parameters
    ----------
    target : mapping of joint to input
        rad or m: numbers or functions of time. Joints with one coordinate.
    kp : mapping of joint to float
        N m/rad or N/m, not negative; for every joint with a target. Inside a motor, V in place of N m.
    ki : mapping of joint to float
        N m/(rad s) or N/(m s), not negative; 0 by default.
    kd : mapping of joint to float
        N m s/rad or N s/m, not negative; 0 by default.
    filter : mapping of joint to float
        F, the time constant of the filter of the velocity, s; 0 by default: w = v.
    effort : mapping of joint to float, "urdf" or None
        Limits L of tau, -L <= tau <= L, N m or N: by joint, the URDF's, or none.
    tracking : mapping of joint to float
        T, s, above 0: how soon the integral leaves what is beyond the limits; kp / ki by default.
    side : {"joint", "motor"}
        Inside a gear or an elastic joint, whether q and v are those of the joint, or of the motor.

    Notes
    -----
    States: "JOINT.integral", I, of joints with ki, and "JOINT.filter", w, of joints with a filter, which begins at v.
    The derivative is that of q alone: a jump of the target gives no impulse.

    References
    ----------
    Åström, Hägglund, PID Controllers: Theory, Design, and Tuning, 1995, sections 3.2 to 3.5 (tracking anti-windup).
    """

    target: Mapping[CoordinateJoint, PlaceSignal]
    kp: Annotated[Mapping[str, NotNegative], of("target", each=True)]
    ki: Annotated[Mapping[str, NotNegative], of("target")] = {}
    kd: Annotated[Mapping[str, NotNegative], of("target")] = {}
    filter: Annotated[Mapping[str, NotNegative], of("target")] = {}
    effort: Limits = None
    tracking: Annotated[Mapping[str, NotNegative], of("target")] = {}
    side: Literal["joint", "motor"] = "joint"

    def check(self, robot: Robot) -> None:
        """Require times of integrals, and limits of joints with a target."""
        for joint in self.ki:
            if self.effort is not None and not self.tracking.get(joint, self.kp[joint]):
                raise SceneError("an integral without kp needs a time", where=f"tracking.{joint}",
                                 remedy=f"tracking={{{joint!r}: 0.1}}")  # fmt: skip
        check_limits(self.effort, self.target, robot)

    def states(self, motion: KinematicState) -> Mapping[str, Scalar]:
        """I and w."""
        seen = motion.links if self.side == "joint" else motion
        speeds = {f"{joint}.filter": seen.v[seen.coordinate(joint)[1]] for joint, time in self.filter.items() if time}
        return {**{f"{joint}.integral": 0.0 for joint, gain in self.ki.items() if gain}, **speeds}

    def act(self, motion: KinematicState, loads: Loads) -> None:
        """Add tau, and give I' and w'."""
        seen = motion.links if self.side == "joint" else motion
        for joint, target in self.target.items():
            entry, dof = seen.coordinate(joint)
            error = minus(value_at(target, seen.t, seen.xp), seen.q[entry])
            speed, integral = seen.v[dof], motion.states.get(f"{joint}.integral", 0.0)
            if (name := f"{joint}.filter") in motion.states:
                loads.rates[name] = times(minus(speed, motion.states[name]), inverse(self.filter[joint]))
                speed = motion.states[name]
            damping = times(negative(number(self.kd.get(joint, 0.0))), speed)
            wanted = plus(times(number(self.kp[joint]), error), integral, damping)
            torque = clamped(wanted, joint, self.effort, motion, loads)
            if f"{joint}.integral" in motion.states:
                gain = number(self.ki[joint])
                rate = times(gain, error)
                if torque is not wanted:
                    pace = inverse(self.tracking[joint]) if joint in self.tracking else gain / number(self.kp[joint])
                    rate = plus(rate, times(pace, minus(torque, wanted)))
                loads.rates[f"{joint}.integral"] = rate
            loads.torque(dof, torque)


class GravityCompensation(_Limited, frozen=True):
    """Compensation of gravity: tau = g(q) = h(q, 0), from recursive Newton-Euler at rest.

    Parameters
    ----------
    joints : sequence of str or None
        The joints that are driven, each with one degree of freedom; None: all of these.
    effort : mapping of joint to float, "urdf" or None
        Limits of the torques, N m or N: by joint, the URDF's, or none.

    Notes
    -----
    g is that of the scene's robot, payloads included. Without gravity in the scene there are no torques.

    References
    ----------
    Siciliano et al., Robotics, 2009, section 8.5.1.
    """

    joints: tuple[str, ...] | None = None
    effort: Limits = None

    def check(self, robot: Robot) -> None:
        """Require joints of one degree of freedom, each named once."""
        joints = single_joints(robot) if self.joints is None else self.joints
        if not isinstance(joints, (list, tuple)) or not joints or any(joints.count(joint) > 1 for joint in joints):
            what, remedy = f"expected joints, each once, got {self.joints!r:.60}", "leave it out for all joints"
            raise SceneError(what, where="joints", remedy=remedy)
        for joint in joints:
            check_joint(joint, robot, "joints")
        check_limits(self.effort, joints, robot)

    def act(self, motion: KinematicState, loads: Loads) -> None:
        """Add g(q)."""
        zeros = [0.0] * motion.mech.nv
        torques = newton_euler(motion.mech, motion.own(), zeros, zeros, None)
        model, joints = motion.model, self.joints
        if joints is None:
            joints = tuple(model.names[i] for i in range(1, model.njoints) if model.nvs[i] == 1)
        for joint in joints:
            k = motion.dofs(joint)[0]
            if type(torques[k]) is not float or torques[k] != 0.0:
                loads.torque(k, clamped(torques[k], joint, self.effort, motion, loads))


class ComputedTorque(_Limited, frozen=True):
    """Inverse-dynamics control: tau = M(q) (a_ref + kd e' + kp e) + h(q, v), e = q_ref - q.

    The tracking error then obeys e'' + kd e' + kp e = 0.

    Parameters
    ----------
    path : mapping of joint to input
        q_ref of joints, rad or m: numbers, polynomials, sines or tables with cubic interpolation.
    kp : float
        1/s^2, not negative.
    kd : float
        1/s, not negative; 2 sqrt(kp) gives critical damping.
    effort : mapping of joint to float, "urdf" or None
        Limits of the torques, N m or N: by joint, the URDF's, or none.
    following : mapping of joint to mapping of joint to float
        q_ref of the other joints, as sums of factors times those of joints with a path: with {"wrist": {"shoulder":
        -1.0, "elbow": -1.0}}, three parallel joints keep what they carry level. Every joint needs one or the other.

    Notes
    -----
    M and h are those of the scene's robot, with its gravity and payloads. Other effects, such as friction, act as
    disturbances.

    References
    ----------
    Luh, Walker, Paul 1980, IEEE Transactions on Automatic Control 25(3). Siciliano et al., Robotics, 2009, section
    8.5.2.
    """

    path: Mapping[CoordinateJoint, PlaceSignal]
    kp: NotNegative
    kd: NotNegative
    effort: Limits = None
    following: Mapping[str, Mapping[str, float]] = {}

    def check(self, robot: Robot) -> None:
        """Require a path for every joint, twice differentiable; each joint has one coordinate."""
        for joint, factors in self.following.items():
            check_joint(joint, robot, "following", coordinate=True)
            if joint in self.path:
                raise SceneError(f"{joint!r} has a path of its own", where=f"following.{joint}", remedy="leave one out")
            check_subset(factors, self.path, f"following.{joint}", "joint with a path")
        missing = [joint for joint in robot.joint_names if joint not in {*self.path, *self.following}]
        if missing:
            floating = any(joint.kind == "free-flyer" for joint in robot.joints)
            remedy = "JointPD, for what is free has no motor and no path" if floating else "give every joint a path"
            raise SceneError(f"it has no path for {', '.join(map(repr, missing))}", where="path", remedy=remedy)
        for joint, path in self.path.items():
            if isinstance(path, Sampled) and path.interpolation != "cubic":
                what = "a path needs accelerations, which this interpolation does not have"
                raise SceneError(what, where=f"path.{joint}.interpolation", remedy='interpolation="cubic"')
        check_limits(self.effort, [*self.path, *self.following], robot)

    def act(self, motion: KinematicState, loads: Loads) -> None:
        """Add the inverse dynamics of a_ref + kd e' + kp e."""
        paths = {joint: derivatives_at(path, motion.t, motion.xp) for joint, path in self.path.items()}
        for joint, factors in self.following.items():
            parts = [[times(number(factor), x) for x in paths[other]] for other, factor in factors.items()]
            paths[joint] = tuple(plus(0.0, *column) for column in zip(*parts, strict=True))
        wanted: list[Scalar] = [0.0] * motion.mech.nv
        for joint, (q, v, a) in paths.items():
            entry, dof = motion.coordinate(joint)
            wanted[dof] = plus(
                a, times(number(self.kd), minus(v, motion.v[dof])), times(number(self.kp), minus(q, motion.q[entry]))
            )
        undamped = dataclasses.replace(motion.mech, damping=(0.0,) * motion.mech.nv)  # a disturbance, as all friction
        torques = newton_euler(undamped, motion.own(), motion.v, wanted, None)
        for joint in paths:
            dof = motion.dofs(joint)[0]
            loads.torque(dof, clamped(torques[dof], joint, self.effort, motion, loads))


class StateFeedback(_Limited, frozen=True):
    """Feedback of the state to joint torques: tau = torque - K (e, v), e = q - target, within limits.

    `tl.lqr` makes one that is optimal near its target.

    Parameters
    ----------
    gain : mapping of joint to tuple of float
        The row of K (2 nv) of each driven joint: N m or N per entry of e, then of v. Joints with one degree of freedom.
    target : tuple of float
        Configuration (nq,), in the robot's order; rad or m.
    torque : mapping of joint to float
        The torque that holds the robot at its target, N m or N; 0 by default.
    effort : mapping of joint to float, "urdf" or None
        Limits L of the torques, -L <= tau <= L, N m or N: by joint, the URDF's, or none.

    Notes
    -----
    e is q - target for angles and lengths. For a continuous joint it is sin(angle), for an orientation sin(angle) axis,
    the rotation being that from the target: both are smooth, count no turns and agree to first order with the tangent
    vector `robot.difference(target, q)`. The position of a free root is taken along the target's axes.

    References
    ----------
    Lee, Leok, McClamroch: Geometric tracking control of a quadrotor UAV on SE(3), CDC 2010 (the error of orientations).
    """

    gain: Mapping[SingleJoint, tuple[float, ...]]
    target: tuple[float, ...]
    torque: Annotated[Mapping[str, Effort], of("gain")] = {}
    effort: Limits = None

    def check(self, robot: Robot) -> None:
        """Require a target of the robot, and rows as long as its state is."""
        for joint, row in self.gain.items():
            if len(row) != 2 * robot.nv:
                raise SceneError(f"expected {2 * robot.nv} numbers, got {len(row)}", where=f"gain.{joint}",
                                 remedy="give one for each entry of q in the tangent space, then of v")  # fmt: skip
        if len(self.target) != robot.nq:
            raise SceneError(f"expected {robot.nq} numbers, got {len(self.target)}", where="target",
                             remedy="give a configuration (nq,)")  # fmt: skip
        configuration("target", self.target, robot.nq, robot.joints)
        check_limits(self.effort, self.gain, robot)

    def act(self, motion: KinematicState, loads: Loads) -> None:
        """Add torque - K (e, v)."""
        state = [*_errors(motion, [number(x) for x in self.target]), *motion.v]
        for joint, row in self.gain.items():
            torque = plus(number(self.torque.get(joint, 0.0)),
                          *(times(negative(number(k)), x) for k, x in zip(row, state, strict=True)))  # fmt: skip
            loads.torque(motion.dofs(joint)[0], clamped(torque, joint, self.effort, motion, loads))


def _errors(motion: KinematicState, target: list[Scalar]) -> list[Scalar]:
    """e (nv)."""
    errors: list[Scalar] = []
    for joint in joint_layouts(motion.model):
        p, x = target[joint.q], list(motion.q[joint.q])
        if joint.kind == "free-flyer":
            errors += [*_turned_back(p[3:], _minus(x[:3], p[:3])), *_rotation(p[3:], x[3:])]
        elif joint.kind == "planar":
            dx, dy, _ = _minus([*x[:2], 0.0], [*p[:2], 0.0])
            c, s = p[2:]
            errors += [plus(times(c, dx), times(s, dy)), minus(times(c, dy), times(s, dx)), _sine(p[2:], x[2:])]
        elif joint.kind == "quaternion":
            errors += _rotation(p, x)
        else:
            errors += [_sine(p, x)] if joint.kind == "cos-sin" else [minus(x[0], p[0])]
    return errors


def _minus(x: list[Scalar], p: list[Scalar]) -> Vec:
    return minus(x[0], p[0]), minus(x[1], p[1]), minus(x[2], p[2])


def _sine(p: list[Scalar], x: list[Scalar]) -> Scalar:
    """sin of the angle from one (cos, sin) pair to another."""
    return minus(times(p[0], x[1]), times(p[1], x[0]))


def _rotation(p: list[Scalar], x: list[Scalar]) -> Vec:
    """sin(angle) axis of the rotation from one quaternion (u, w) to another: 2 w u of conj(p) x."""
    (a, b, c, w), (ax, bx, cx, wx) = p, x
    turned = add(scale(w, (ax, bx, cx)), scale(negative(wx), (a, b, c)), cross((ax, bx, cx), (a, b, c)))
    cosine = plus(dot((a, b, c), (ax, bx, cx)), times(w, wx))  # of half the angle
    return scale(times(2.0, cosine), turned)


def _turned_back(p: list[Scalar], d: Vec) -> Vec:
    """R(p)^T d = d - 2 w u x d + 2 u x (u x d), with p = (u, w)."""
    u = (p[0], p[1], p[2])
    once = cross(u, d)
    return add(d, scale(times(-2.0, p[3]), once), scale(2.0, cross(u, once)))


def check_limits(limits: Limits, joints: Iterable[str], robot: Robot, field: str = "effort") -> None:
    """Require effort limits of driven joints, or "urdf" where the URDF gives them. Raises SceneError."""
    if limits is not None and limits != "urdf":
        check_subset(limits, joints, field, "driven joint")
    for joint in joints if limits == "urdf" else ():
        value = _urdf_limit(robot.model, joint)
        if not (math.isfinite(value) and value > 0):
            what = f"the URDF's effort limit of joint {joint!r} is {value:g}"
            raise SceneError(what, where=field, remedy="give limits by joint")


def limit_of(joint: str, limits: Limits, model: Any) -> float | None:
    """The limit of a joint's torque, N m or N; None where there is none."""
    return _urdf_limit(model, joint) if limits == "urdf" else number((limits or {}).get(joint))


def clamped(torque: Scalar, joint: str, limits: Limits, motion: KinematicState, loads: Loads) -> Scalar:
    """The torque of a joint within its limit L: min(max(torque, -L), L). The loads note where it is not smooth."""
    limit = limit_of(joint, limits, motion.model)
    if limit is None:
        return torque
    limit, xp = number(limit), motion.xp
    below, above = loads.beyond(joint, plus(torque, limit), minus(limit, torque), xp)
    return xp.where(below, -limit, xp.where(above, limit, torque))


def _urdf_limit(model: Any, joint: str) -> float:
    return float(model.effortLimit[model.idx_vs[model.getJointId(joint)]])
