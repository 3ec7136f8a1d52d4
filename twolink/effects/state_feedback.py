"""Feedback of the whole state."""

from collections.abc import Mapping

from twolink.algorithms.spatial import Scalar, Vec, add, cross, dot, minus, negative, plus, scale, times
from twolink.dynamics import Robot
from twolink.dynamics.arguments import configuration
from twolink.effects.effect import Effect, number
from twolink.effects.joint_checks import Limits, check_joints, check_limits, check_subset, clamped
from twolink.effects.motion import Loads, Motion
from twolink.errors import SceneError
from twolink.robots.joint_layout import joint_layouts


class StateFeedback(Effect, frozen=True):
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

    gain: Mapping[str, tuple[float, ...]]
    target: tuple[float, ...]
    torque: Mapping[str, float] = {}
    effort: Limits = None

    @property
    def analytic(self) -> bool:
        """Whether there are no limits: a torque is not smooth where it reaches its limit."""
        return self.effort is None

    def check(self, robot: Robot) -> None:
        """Require a target of the robot, and rows as long as its state is."""
        check_joints(self.gain, robot, "gain", dofs=True)
        for joint, row in self.gain.items():
            if len(row) != 2 * robot.nv:
                raise SceneError(f"expected {2 * robot.nv} numbers, got {len(row)}", where=f"gain.{joint}",
                                 remedy="give one for each entry of q in the tangent space, then of v")  # fmt: skip
        if len(self.target) != robot.nq:
            raise SceneError(f"expected {robot.nq} numbers, got {len(self.target)}", where="target",
                             remedy="give a configuration (nq,)")  # fmt: skip
        configuration("target", self.target, robot.nq, robot.joints)
        check_subset(self.torque, self.gain, "torque", "joint with a gain")
        check_limits(self.effort, self.gain, robot)

    def act(self, motion: Motion, loads: Loads) -> None:
        """Add torque - K (e, v)."""
        state = [*_errors(motion, [number(x) for x in self.target]), *motion.v]
        for joint, row in self.gain.items():
            torque = plus(number(self.torque.get(joint, 0.0)),
                          *(times(negative(number(k)), x) for k, x in zip(row, state, strict=True)))  # fmt: skip
            loads.torque(motion.dofs(joint)[0], clamped(torque, joint, self.effort, motion, loads))


def _errors(motion: Motion, target: list[Scalar]) -> list[Scalar]:
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
