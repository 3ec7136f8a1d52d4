"""A long run against its closed form, beside those of the hard cases: a day of a pendulum by elliptic functions."""

import mpmath as mp
import numpy as np
import pytest

import twolink as tl
from tests.integrate.problems import GRAVITY, one_joint
from twolink.hard.truths import swing
from twolink.integrate.motion.scene_equations import equations_of
from twolink.integrate.solver import solve
from twolink.integrate.steps.methods import METHODS

DAY = 86_400.0


@pytest.mark.slow
def test_a_day_of_a_wide_swing_keeps_twelve_digits_in_extended_precision() -> None:
    """Rounding to doubles leaves 1e-9 of such a day."""
    equations = equations_of(tl.Scene(one_joint("revolute"), q=[1.0], effects=GRAVITY))
    times = np.array([0.0, DAY])
    found = solve(equations, METHODS["taylor"], times, 1e-18, precision="extended").x[0, -1]
    with mp.workdps(40):
        rate = mp.sqrt(mp.mpf(9.81) / (1 + mp.mpf(0.2)))  # of the body of `one_joint`: 1 kg at 1 m, 0.2 kg m^2
    assert abs(swing(1.0, rate)(times)[-1, 0] - found) < 1e-12
