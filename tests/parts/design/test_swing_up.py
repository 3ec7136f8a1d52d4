"""The bundled swing-up: an arm whose elbow has no motor is brought upright and held there against a push."""

import numpy as np
import pytest

import twolink as tl

UP = [np.pi / 2, 0.0]
CAUGHT, PUSHED = 2.0, 4.0  # s


@pytest.fixture(scope="module")
def swing_up() -> tl.Trajectory:
    return tl.simulate(tl.load_scene("swing-up"))


def test_it_is_caught_upright_and_returns_there_after_a_push(swing_up: tl.Trajectory) -> None:
    run = swing_up
    off = np.abs(run.q - UP).max(axis=1)
    assert off[0] == pytest.approx(np.pi)
    assert [(event.kind, event.t) for event in run.events] == [("engage", CAUGHT)]
    assert off[(run.t >= CAUGHT) & (run.t < PUSHED)].max() < 0.01
    assert off[run.t > PUSHED].max() > 0.1  # the push is felt
    assert off[-1] < 1e-3
    assert np.abs(run.v[-1]).max() < 1e-3
    assert run.error is not None
    assert run.error.max() <= 1e-6


def test_the_elbow_has_no_motor(swing_up: tl.Trajectory) -> None:
    damping = next(e for e in tl.load_scene("swing-up").effects if isinstance(e, tl.effects.JointDamping)).damping
    np.testing.assert_allclose(swing_up.tau[:, 1], -damping["elbow"] * swing_up.v[:, 1], atol=1e-12)
    assert np.abs(swing_up.tau[:, 0]).max() <= 60.0
