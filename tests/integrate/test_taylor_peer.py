"""Taylor's method in 47 digits beside heyoka in 33: another program, another arithmetic, other constants' folding."""

import numpy as np
import pytest

import twolink as tl
from scripts import heyoka_peer
from tests.integrate.problems import box, rods
from twolink.integrate.digits import difference
from twolink.integrate.motion.scene_equations import equations_of
from twolink.integrate.solvers import taylor

pytest.importorskip("heyoka")


def robot(name: str) -> tl.Scene:
    one = tl.load_robot(name)
    return tl.Scene(one, np.linspace(0.3, -0.8, one.nq), effects=[tl.effects.Gravity()])


@pytest.mark.some(3)
@pytest.mark.parametrize("name", ["rods", "ur5", "box", "panda"])
def test_thirty_digits_agree(name: str) -> None:
    scene = {"rods": rods, "box": box}.get(name, lambda: robot(name))()
    equations, end = equations_of(scene), 1.0 if name == "rods" else 0.5
    times = np.linspace(0.0, end, 6)
    theirs = heyoka_peer.integrator(equations, 1e-33, "quad", compact_mode=True, opt_level=0)
    expected = heyoka_peer.parts_of(heyoka_peer.states_at(theirs, times, end / 16))
    quad = taylor.solve(equations, times, 1e-36, precision="quad").precise
    assert np.abs(difference(quad, expected)).max() < 1e-30
    extended = taylor.solve(equations, times, 1e-31, precision="extended").precise
    assert np.abs(difference(extended, quad)).max() < 1e-28
    double = taylor.solve(equations, times, 1e-15).x.T
    np.testing.assert_allclose(double, quad[..., 0], rtol=1e-13, atol=1e-13)
