"""Computed torque: control with which the tracking error obeys a linear equation."""

from collections.abc import Mapping

from twolink.algorithms.recursions import newton_euler
from twolink.algorithms.spatial import Scalar, minus, plus, times
from twolink.dynamics import Robot
from twolink.effects.effect import Effect, NotNegative, number
from twolink.effects.inputs import Input, derivatives_at
from twolink.effects.joint_checks import Limits, check_joints, check_limits, clamped
from twolink.effects.motion import Loads, Motion
from twolink.effects.sampled import Sampled
from twolink.errors import SceneError


class ComputedTorque(Effect, frozen=True):
    """Inverse-dynamics control: tau = M(q) (a_ref + kd e' + kp e) + h(q, v), e = q_ref - q.

    The tracking error then obeys e'' + kd e' + kp e = 0.

    Parameters
    ----------
    path : mapping of joint to input
        q_ref of every joint, rad or m: numbers, polynomials, sines or tables with cubic interpolation.
    kp : float
        1/s^2, not negative.
    kd : float
        1/s, not negative; 2 sqrt(kp) gives critical damping.
    effort : mapping of joint to float, "urdf" or None
        Limits of the torques, N m or N: by joint, the URDF's, or none.

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

    @property
    def analytic(self) -> bool:
        """Whether there are no limits: a torque is not smooth where it reaches its limit."""
        return self.effort is None

    def check(self, robot: Robot) -> None:
        """Require a path for every joint, twice differentiable; each joint has one coordinate."""
        check_joints(self.path, robot, "path", coordinates=True)
        missing = [joint for joint in robot.joint_names if joint not in self.path]
        if missing:
            floating = robot.joints[0].kind == "free-flyer"
            remedy = "give every joint a path" + (": the robot's free root has no motor" if floating else "")
            raise SceneError(f"it has no path for {', '.join(map(repr, missing))}", where="path", remedy=remedy)
        for joint, path in self.path.items():
            if isinstance(path, Sampled) and path.interpolation != "cubic":
                what = "a path needs accelerations, which this interpolation does not have"
                raise SceneError(what, where=f"path.{joint}.interpolation", remedy='interpolation="cubic"')
        check_limits(self.effort, self.path, robot)

    def act(self, motion: Motion, loads: Loads) -> None:
        """Add the inverse dynamics of a_ref + kd e' + kp e."""
        wanted: list[Scalar] = [0.0] * motion.mech.nv
        for joint, path in self.path.items():
            entry, dof = motion.coordinate(joint)
            q, v, a = derivatives_at(path, motion.t, motion.xp)
            wanted[dof] = plus(
                a, times(number(self.kd), minus(v, motion.v[dof])), times(number(self.kp), minus(q, motion.q[entry]))
            )
        torques = newton_euler(motion.mech, motion.own(), motion.v, wanted, None)
        for joint in self.path:
            dof = motion.dofs(joint)[0]
            loads.torque(dof, clamped(torques[dof], joint, self.effort, motion, loads))
