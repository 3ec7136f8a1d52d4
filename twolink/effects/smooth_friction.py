"""Dry friction of joints, smoothed."""

import math
from collections.abc import Mapping

from twolink.algorithms.spatial import times
from twolink.dynamics import Robot
from twolink.effects.effect import Effect, NotNegative, finite
from twolink.effects.joint_checks import check_values_or_urdf, values_by_dof
from twolink.effects.motion import Loads, Motion


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

    friction: Mapping[str, NotNegative] | None = None
    scale: float = 0.01

    def check(self, robot: Robot) -> None:
        """Require joints, or friction in the URDF, and a scale above 0."""
        finite(self.scale, "scale", least=math.ulp(0.0))
        check_values_or_urdf(self.friction, robot.model.friction, robot, "friction")

    def act(self, motion: Motion, loads: Loads) -> None:
        """Add -f tanh(v / s)."""
        for k, f in values_by_dof(self.friction, motion.model.friction, motion).items():
            if f:
                loads.torque(k, times(-f, motion.xp.tanh(times(1.0 / self.scale, motion.v[k]))))
