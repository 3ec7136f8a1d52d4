"""Sensitivities at times of one's own, and by code that serves other numbers too."""

import numpy as np

import twolink as tl
from tests.near import assert_near
from twolink.scenes.parameters import scene_with
from twolink.simulation.sensitivities import sensitivities_at

NAMES = ["forearm.mass", "q"]
TABLE = tl.effects.Sampled((0.0, 0.35, 0.8, 2.0), (0.5, -1.0, 2.0, 0.0))
SCENE = tl.Scene(tl.load_robot("arm"), [0.4, 0.3], effects=[
    tl.effects.Gravity(), tl.effects.JointDamping({"elbow": 0.2}), tl.effects.Torque({"elbow": TABLE})])  # fmt: skip


def matrix(s: tl.Sensitivities, name: str) -> np.ndarray:
    return np.concatenate([s.q[name], s.v[name]], axis=1)


def test_code_for_any_numbers_gives_the_same_derivatives_within_their_bars() -> None:
    times = np.linspace(0.0, 1.0, 21)
    for mass in (1.5, 1.9):
        own = scene_with(SCENE, {"forearm.mass": mass})
        s, t = (sensitivities_at(own, NAMES, times, 1e-7, numbers_as_inputs=shared) for shared in (True, False))
        assert np.abs(s.run.q - t.run.q).max() <= s.run.error[-1] + t.run.error[-1]
        for name in NAMES:
            off = np.abs(matrix(s, name) - matrix(t, name)).max(axis=(1, 2))
            assert (off <= s.error[name] + t.error[name]).all()


def test_a_motion_that_begins_later_goes_on_as_the_whole_one() -> None:
    """S(t2, 0) = S(t2, t1) S(t1, 0), under a torque that is a table in time."""
    times = np.linspace(0.0, 1.2, 25)
    whole = sensitivities_at(SCENE, ["q", "v"], times, 1e-8)
    k = 10
    middle = tl.Scene(SCENE.base, whole.run.q[k], whole.run.v[k], SCENE.effects)
    later = sensitivities_at(middle, ["q", "v"], times[k:], 1e-8)
    assert_near(later.run.q, whole.run.q[k:], 1e-7)
    first, second = (np.concatenate([matrix(s, "q"), matrix(s, "v")], axis=2) for s in (whole, later))
    assert_near(second @ first[k], first[k:], 1e-6)
