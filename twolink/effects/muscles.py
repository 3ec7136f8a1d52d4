"""Muscles: forces of Hill type, with activation."""

import math
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar

from twolink.algorithms.motion import KinematicState
from twolink.algorithms.spatial import Scalar, minus, plus, times
from twolink.dynamics import Robot
from twolink.effects.effect import AboveZero, CoordinateJoint, Effect, Loads, NotNegative, Place, inverse, number, of
from twolink.effects.inputs import Input, value_at, values_met
from twolink.errors import SceneError

WIDTH = 0.45  # gamma of the force-length curve
STRETCH, SHAPE = 0.6, 5.0  # strain at which the passive force is that of the muscle, and its exponential shape
CURVATURE, LENGTHENING = 0.25, 1.4  # A_f and F_len of the force-velocity curve
SLACK = 1e-3  # beyond 0 and 1: differences of runs take such steps


class Muscle(Effect, frozen=True):
    """A muscle of Hill type on a stiff tendon: tau_j = r_j F, F = F_0 (a f_l(l) f_v(l') + f_p(l)).

        l = 1 - sum_j r_j (q_j - rest_j) / l_0,   a' = (u - a) / T

    l is the fibres' length over l_0. T is T_a (1/2 + 3 a / 2) while the excitation u is above a, else
    T_d / (1/2 + 3 a / 2).

    Parameters
    ----------
    name : str
        Of the muscle, such as "biceps".
    arm : mapping of joint to float
        r, the moment arm, m: above 0 where a shorter muscle turns the joint forward. Joints with one coordinate.
    force : float
        F_0, the largest isometric force, N.
    length : float
        l_0, the fibres' length at which that is, m, above 0.
    excitation : input
        u, from 0 to 1.
    rest : mapping of joint to float
        Where the fibres have the length l_0, rad; 0 by default.
    speed : float
        The fastest shortening, l_0 per second, above 0.
    rise, fall : float
        T_a and T_d, s, above 0.
    start : float
        a at the start, from 0 to 1.

    Notes
    -----
    States: "NAME.activation", a. Curves and their constants are Thelen's for young adults, without the dependence of
    the fastest shortening on a: f_l = exp(-(l - 1)^2 / 0.45); f_p = (exp(5 (l - 1) / 0.6) - 1) / (exp(5) - 1) for
    l > 1; and for f_v Hill's hyperbola with A_f = 0.25 and F_len = 1.4, without force where fibres shorten faster.

    References
    ----------
    Thelen 2003, Journal of Biomechanical Engineering 125(1), 70-77. Hill 1938, Proceedings of the Royal Society B 126.
    """

    name: str
    arm: Mapping[CoordinateJoint, float]
    force: NotNegative
    length: AboveZero
    excitation: Input
    rest: Annotated[Mapping[str, Place], of("arm")] = {}
    speed: AboveZero = 10.0
    rise: AboveZero = 0.015
    fall: AboveZero = 0.050
    start: NotNegative = 0.0

    analytic: ClassVar[bool] = False  # its curves have kinks

    def check(self, robot: Robot) -> None:
        """Require excitation and activation from 0 to 1."""
        del robot
        for field in ("excitation", "start"):
            beyond = [x for x in values_met(getattr(self, field)) if not -SLACK <= x <= 1.0 + SLACK]
            if beyond:
                raise SceneError(f"expected numbers from 0 to 1, got {beyond[0]:g}", where=field,
                                 remedy="1 is all of the muscle")  # fmt: skip

    def states(self, motion: KinematicState) -> Mapping[str, Scalar]:
        """a."""
        del motion
        return {f"{self.name}.activation": number(self.start)}

    def act(self, motion: KinematicState, loads: Loads) -> None:
        """Add r_j F, and give a'."""
        name, xp = f"{self.name}.activation", motion.xp
        a, u = motion.states[name], value_at(self.excitation, motion.t, xp)
        slower, change = plus(0.5, times(1.5, a)), minus(u, a)
        rates = change * inverse(self.rise) / slower, change * inverse(self.fall) * slower
        loads.rates[name] = xp.where(xp.less(0.0, change), *rates)
        length, rate = 1.0, 0.0
        for joint, arm in self.arm.items():
            entry, dof = motion.coordinate(joint)
            share = times(number(arm), inverse(self.length))
            length = minus(length, times(share, minus(motion.q[entry], number(self.rest.get(joint, 0.0)))))
            rate = minus(rate, times(share, motion.v[dof]))
        active = times(a, times(_at_length(length, xp), _at_speed(times(inverse(self.speed), rate), xp)))
        force = times(number(self.force), plus(active, _passive(length, xp)))
        for joint, arm in self.arm.items():
            loads.torque(motion.coordinate(joint)[1], times(number(arm), force))


def _at_length(length: Scalar, xp: Any) -> Scalar:
    """f_l."""
    apart = minus(length, 1.0)
    return xp.exp(times(-1.0 / WIDTH, times(apart, apart)))


def _at_speed(rate: Scalar, xp: Any) -> Scalar:
    """f_v, of the rate of the length over the fastest shortening."""
    shortening = (rate + 1.0) / (1.0 - rate * (1.0 / CURVATURE))
    slope = 2.0 + 2.0 / CURVATURE
    lengthening = (LENGTHENING - 1.0 + slope * LENGTHENING * rate) / (LENGTHENING - 1.0 + slope * rate)
    return xp.where(xp.less(rate, 0.0), xp.where(xp.less(rate, -1.0), 0.0, shortening), lengthening)


def _passive(length: Scalar, xp: Any) -> Scalar:
    """f_p."""
    pull = (xp.exp((SHAPE / STRETCH) * minus(length, 1.0)) - 1.0) * (1.0 / (math.exp(SHAPE) - 1.0))
    return xp.where(xp.less(1.0, length), pull, 0.0)
