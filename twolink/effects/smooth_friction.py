"""Dry friction of joints, smoothed."""

from __future__ import annotations

import math
from collections.abc import Mapping

from twolink.algorithms.spatial import times
from twolink.dynamics import Robot
from twolink.effects.effect import Effect, finite
from twolink.effects.joint_checks import check_joints, check_values
from twolink.effects.motion import Loads, Motion
from twolink.errors import SceneError


class SmoothFriction(Effect, frozen=True):
    """tau = -f tanh(v / s) in each joint named, or in all joints with the friction their URDF gives.

    It differs from Coulomb's -f sign(v) by f (1 - tanh(|v| / s)): less than 0.5 % of f where |v| > 3 s. It does not
    stick: under a load L < f the joint creeps at v = s atanh(L / f). Below s it is viscous damping f / s, and the
    smaller s, the stiffer the equations.

    friction: f by joint, N m or N; of a joint with several degrees of freedom the same for each. Left out: the URDF's.
    scale: s, rad/s or m/s.
    """

    friction: Mapping[str, float] | None = None
    scale: float = 0.01

    def check(self, robot: Robot) -> None:
        """Names are joints; friction is not negative; the scale is above 0."""
        finite(self.scale, "scale", least=math.ulp(0.0))
        if self.friction is None:
            if not robot.model.friction.any():
                raise SceneError("the URDF gives no joint friction", where="friction",
                                 remedy="give it by joint, or leave the effect out")  # fmt: skip
            return
        check_joints(self.friction, robot, "friction")
        check_values(self.friction, "friction", least=0.0)

    def act(self, motion: Motion, loads: Loads) -> None:
        """-f tanh(v / s)."""
        given = dict(enumerate(motion.model.friction.tolist()))
        if self.friction is not None:
            given = {k: float(f) for joint, f in self.friction.items() for k in motion.dofs(joint)}
        for k, f in given.items():
            if f:
                loads.torque(k, times(-f, motion.xp.tanh(times(1.0 / self.scale, motion.v[k]))))
