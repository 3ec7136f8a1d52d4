"""A long run against its closed form, beside those of the hard cases: a day of a pendulum by elliptic functions."""

import mpmath as mp
import numpy as np
import pytest

import twolink as tl
from tests.integrate.problems import GRAVITY, one_joint
from twolink.integrate.motion.scene_equations import equations_of
from twolink.integrate.solver import solve
from twolink.integrate.steps.methods import METHODS

DAY = 86_400.0


def pendulum_angle(start: float, t: float) -> mp.mpf:
    """The angle [rad] at a time t of a pendulum that is released at `start`: sin(q/2) = k sn(K - w t, k)."""
    with mp.workdps(40):
        k = mp.sin(mp.mpf(start) / 2)
        rate = mp.sqrt(mp.mpf(9.81) / (1 + mp.mpf(0.2)))  # of the body of `one_joint`: 1 kg at 1 m, 0.2 kg m^2
        return 2 * mp.asin(k * mp.ellipfun("sn", mp.ellipk(k**2) - rate * mp.mpf(t), m=k**2))


@pytest.mark.slow
def test_a_day_of_a_wide_swing_keeps_twelve_digits_in_extended_precision() -> None:
    """Rounding to doubles leaves 1e-9 of such a day."""
    equations = equations_of(tl.Scene(one_joint("revolute"), q=[1.0], effects=GRAVITY))
    found = solve(equations, METHODS["taylor"], np.array([0.0, DAY]), 1e-18, precision="extended").x[0, -1]
    assert abs(float(pendulum_angle(1.0, DAY) - mp.mpf(float(found)))) < 1e-12
