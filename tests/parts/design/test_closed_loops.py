"""Closed loops: linear equations of independent joints, against sensitivities; equilibria and regulators of them."""

import numpy as np
import pytest

import twolink as tl
from tests.parts.design.test_linearize import difference_of, of_state
from tests.refusals import refusal
from twolink.errors import SceneError

CRANK = tl.load_scene("crank-spring")


@pytest.mark.slow
def test_along_a_motion_it_is_the_rate_of_sensitivities() -> None:
    s = tl.sensitivities(CRANK, wrt=["q", "v"], duration=0.3, accuracy=1e-9, samples_per_second=200)
    run = s.run
    about = tl.linearize(CRANK, run.q[4:-4:8], run.v[4:-4:8], t=run.t[4:-4:8])
    assert about.names == ("q.crank_joint", "v.crank_joint")
    whole = of_state(s)
    own = whole[:, [about.independent[0], 3 + about.independent[0]]]
    middle = own[4:-4:8]
    np.testing.assert_allclose(about.lift @ middle, whole[4:-4:8], atol=1e-9)
    np.testing.assert_allclose(about.A @ middle, 200 * difference_of(own)[::8], atol=1e-9)


@pytest.mark.slow
def test_equilibria_keep_loops_closed() -> None:
    found = tl.equilibria(CRANK, [0.7, -0.5, -2.8])[0]
    assert found.stability == "asymptotically stable"
    assert np.abs(found.a).max() < 1e-12
    scene = tl.Scene(CRANK.base, found.q, effects=CRANK.effects)
    assert np.abs(scene.q - tl.simulate(scene, 1.0).q[-1]).max() < 1e-6


@pytest.mark.slow
def test_a_motor_at_the_crank_holds_the_mechanism() -> None:
    regulator = tl.lqr(CRANK, [4.0, 1.0], 0.1, [1.0, 1.0, -0.5], inputs=["crank_joint"])
    closed = tl.Scene(CRANK.base, CRANK.q, effects=[*CRANK.effects, regulator])
    at_rest = tl.linearize(closed, regulator.target)
    assert at_rest.stability == "asymptotically stable"
    run = tl.simulate(closed, 8.0)
    left = np.abs(run.q[-1] - regulator.target).max()
    assert left < 2.0 * np.exp(at_rest.eigenvalues[0].real * 8.0)


def test_a_singular_position_is_named() -> None:
    with refusal(SceneError, code="singular-position"):
        tl.linearize(tl.load_scene("four-bar"), np.zeros(5))
