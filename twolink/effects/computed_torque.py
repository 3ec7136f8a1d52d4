"""Computed torque: control with which the tracking error obeys a linear equation."""

from collections.abc import Mapping

from twolink.algorithms.recursions import newton_euler
from twolink.algorithms.spatial import Scalar, minus, plus, times
from twolink.dynamics import Robot
from twolink.effects.effect import Effect, NotNegative, number
from twolink.effects.inputs import Input, derivatives_at
from twolink.effects.joint_checks import Limits, check_joints, check_limits, check_subset, clamped
from twolink.effects.motion import Loads, Motion
from twolink.effects.sampled import Sampled
from twolink.errors import SceneError


class ComputedTorque(Effect, frozen=True):
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

    path: Mapping[str, Input]
    kp: NotNegative
    kd: NotNegative
    effort: Limits = None
    following: Mapping[str, Mapping[str, float]] = {}

    @property
    def analytic(self) -> bool:
        """Whether there are no limits: a torque is not smooth where it reaches its limit."""
        return self.effort is None

    def check(self, robot: Robot) -> None:
        """Require a path for every joint, twice differentiable; each joint has one coordinate."""
        check_joints(self.path, robot, "path", coordinates=True)
        if self.following:
            check_joints(self.following, robot, "following", coordinates=True)
        for joint, factors in self.following.items():
            if joint in self.path:
                raise SceneError(f"{joint!r} has a path of its own", where=f"following.{joint}", remedy="leave one out")
            check_subset(factors, self.path, f"following.{joint}", "joint with a path")
        missing = [joint for joint in robot.joint_names if joint not in {*self.path, *self.following}]
        if missing:
            floating = robot.joints[0].kind == "free-flyer"
            remedy = "give every joint a path" + (": the robot's free root has no motor" if floating else "")
            raise SceneError(f"it has no path for {', '.join(map(repr, missing))}", where="path", remedy=remedy)
        for joint, path in self.path.items():
            if isinstance(path, Sampled) and path.interpolation != "cubic":
                what = "a path needs accelerations, which this interpolation does not have"
                raise SceneError(what, where=f"path.{joint}.interpolation", remedy='interpolation="cubic"')
        check_limits(self.effort, [*self.path, *self.following], robot)

    def act(self, motion: Motion, loads: Loads) -> None:
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
        torques = newton_euler(motion.mech, motion.own(), motion.v, wanted, None)
        for joint in paths:
            dof = motion.dofs(joint)[0]
            loads.torque(dof, clamped(torques[dof], joint, self.effort, motion, loads))
