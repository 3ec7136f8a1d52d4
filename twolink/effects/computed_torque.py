"""Computed torque: control that makes the tracking error obey a linear equation."""

from __future__ import annotations

from collections.abc import Mapping

from twolink.algorithms.recursions import newton_euler
from twolink.algorithms.spatial import Scalar, minus, plus, times
from twolink.dynamics import Robot
from twolink.effects.effect import Effect, finite
from twolink.effects.inputs import Input, check_input, derivatives_at, twice_differentiable
from twolink.effects.joint_checks import Limits, check_joints, check_limits, clamped
from twolink.effects.motion import Loads, Motion
from twolink.errors import SceneError


class ComputedTorque(Effect, frozen=True):
    """tau = M(q) (a_ref + kd e' + kp e) + h(q, v), e = q_ref - q: then e'' + kd e' + kp e = 0.

    (Luh, Walker, Paul 1980; Siciliano et al. 2009, section 8.5.2.) The model is the scene's own, with its gravity and
    payloads; other effects, such as friction, are disturbances to it.

    path: q_ref of every joint, rad or m: numbers, polynomials, sines or tables with cubic interpolation. kp: 1/s^2.
    kd: 1/s; 2 sqrt(kp) is critical. effort: limits by joint, or "urdf".
    """

    path: Mapping[str, Input]
    kp: float
    kd: float
    effort: Limits = None

    @property
    def analytic(self) -> bool:
        """Not where a limit of effort acts."""
        return self.effort is None

    def check(self, robot: Robot) -> None:
        """The path names every joint, and each has one coordinate; it can be differentiated twice."""
        check_joints(self.path, robot, "path", coordinates=True)
        missing = [joint for joint in robot.joint_names if joint not in self.path]
        if missing:
            raise SceneError(f"it does not say where {', '.join(map(repr, missing))} should go", where="path",
                             remedy="give every joint a path: the robot's free root has no motor"
                             if robot.joints[0].kind == "free-flyer" else "give every joint a path")  # fmt: skip
        for joint, given in self.path.items():
            check_input(given, f"path.{joint}")
            if not twice_differentiable(given):
                raise SceneError("a path needs accelerations, which this interpolation does not have",
                                 where=f"path.{joint}.interpolation", remedy='interpolation="cubic"')  # fmt: skip
        finite(self.kp, "kp", least=0.0)
        finite(self.kd, "kd", least=0.0)
        check_limits(self.effort, self.path, robot)

    def act(self, motion: Motion, loads: Loads) -> None:
        """Inverse dynamics of a_ref + kd e' + kp e."""
        wanted: list[Scalar] = [0.0] * motion.mech.nv
        for joint, given in self.path.items():
            entry, dof = motion.coordinate(joint)
            q, v, a = derivatives_at(given, motion.t, motion.xp)
            wanted[dof] = plus(
                a,
                times(float(self.kd), minus(v, motion.v[dof])),
                times(float(self.kp), minus(q, motion.q[entry])),
            )
        torques = newton_euler(motion.mech, motion.own(), motion.v, wanted, None)
        for joint in self.path:
            dof = motion.dofs(joint)[0]
            loads.torque(dof, clamped(torques[dof], joint, self.effort, motion, loads))
