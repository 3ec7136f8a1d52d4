"""Forces in joints by position, velocity and time."""

import math
from collections.abc import Mapping

from twolink.algorithms.motion import Motion
from twolink.algorithms.spatial import plus, times
from twolink.dynamics import Robot
from twolink.effects.checks import check_joints, check_subset, check_values_or_urdf, values_by_dof
from twolink.effects.effect import Effect, Loads, NotNegative, finite, number
from twolink.effects.inputs import Input, value_at


class Torque(Effect, frozen=True):
    """Torques and forces in joints: tau_k = u_k(t).

    Parameters
    ----------
    inputs : mapping of joint to input
        u, N m or N: numbers, `Polynomial`, `Sine` or `Sampled` tables. Joints with one degree of freedom.
    """

    inputs: Mapping[str, Input]

    def check(self, robot: Robot) -> None:
        """Require joints with one degree of freedom."""
        check_joints(self.inputs, robot, "inputs", dofs=True)

    def act(self, motion: Motion, loads: Loads) -> None:
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

    damping: Mapping[str, NotNegative] | None = None

    def check(self, robot: Robot) -> None:
        """Require joints, or damping in the URDF."""
        check_values_or_urdf(self.damping, robot.model.damping, robot, "damping")

    def act(self, motion: Motion, loads: Loads) -> None:
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

    stiffness: Mapping[str, NotNegative]
    rest: Mapping[str, float] = {}

    def check(self, robot: Robot) -> None:
        """Require joints with one coordinate."""
        check_joints(self.stiffness, robot, "stiffness", coordinates=True)
        check_subset(self.rest, self.stiffness, "rest", "joint with a stiffness")

    def act(self, motion: Motion, loads: Loads) -> None:
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
