"""Long runs against closed forms: a day of a pendulum by elliptic functions, and a million turns."""

import math

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
def test_a_verified_day_of_a_pendulum() -> None:
    run = tl.simulate(
        tl.Scene(one_joint("revolute"), q=[0.3], effects=GRAVITY), DAY, accuracy=1e-9, samples_per_second=20 / DAY
    )
    error = [abs(float(pendulum_angle(0.3, t) - mp.mpf(float(q)))) for t, q in zip(run.t, run.q[:, 0], strict=True)]
    assert run.error is not None
    assert (error <= run.error).all()
    assert run.error[-1] <= 1e-9


@pytest.mark.slow
def test_a_day_of_a_wide_swing_keeps_twelve_digits_in_extended_precision() -> None:
    """Rounding to doubles leaves 1e-9 of such a day."""
    equations = equations_of(tl.Scene(one_joint("revolute"), q=[1.0], effects=GRAVITY))
    found = solve(equations, METHODS["taylor"], np.array([0.0, DAY]), 1e-18, precision="extended").x[0, -1]
    assert abs(float(pendulum_angle(1.0, DAY) - mp.mpf(float(found)))) < 1e-12


@pytest.mark.slow
def test_a_million_turns() -> None:
    """A wheel at 10 rad/s, whose state is the cosine and the sine of its angle."""
    end = 2e6 * math.pi / 10
    wheel = tl.Scene(one_joint("continuous"), v=[10.0])
    c, s = solve(equations_of(wheel), METHODS["taylor"], np.array([0.0, end]), 1e-16).x[:2, -1]
    with mp.workdps(30):
        angle = 10 * mp.mpf(end)
        error = mp.atan2(s * mp.cos(angle) - c * mp.sin(angle), c * mp.cos(angle) + s * mp.sin(angle))
    assert abs(float(error)) < 1e-9
