"""The chaotic double pendulum at t = 10 s, where errors of the start have grown 10^5-fold.

Two equal uniform rods, released from rest at the horizontal. The rods have 3 kg, so that every constant of the
equations, m L^2 / 12 among them, is a double exactly; the motion does not depend on the common mass.
"""

import numpy as np

import twolink as tl
from twolink.hard.high_precision import G
from twolink.lagrange.check import arm_urdf

SECONDS = 10.0
# th1, th2 absolute from downward; an independent program's, for g = 9.81.
PUBLISHED = (-0.74440708850904112, -14.345719734713967)


def test_double_precision_agrees_with_published_values() -> None:
    rods = tl.Scene(tl.load_robot(arm_urdf(1, 1, 3, 3)), effects=[tl.effects.Gravity((0.0, 0.0, -G))])
    run = tl.simulate(rods, SECONDS, accuracy=1e-9)
    off = np.abs(np.cumsum(run.q[-1]) + np.pi / 2 - PUBLISHED).max()
    assert run.error is not None
    assert off <= run.error[-1] <= 1e-9
