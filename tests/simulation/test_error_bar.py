"""The error bar of two solutions, sample by sample."""

from __future__ import annotations

import numpy as np
import pytest

import twolink as tl
from twolink.hard import truths
from twolink.hard.truths import extended_reference
from twolink.simulation.error_bar import CHANCE, PARTED, error_bar
from twolink.simulation.sampling import spread_out


@pytest.mark.parametrize("samples", [1, 2, 3, 4, 39, 40, 200])
def test_the_bar_is_the_largest_error_up_to_a_fortieth_of_the_samples_later(samples: int) -> None:
    rng = np.random.default_rng(samples)
    distance, rounding = np.exp(rng.normal(0.0, 3.0, (samples, 2))), rng.random((samples, 2))
    bar, wide = error_bar(distance, rounding, 2.0), 2.0 * distance
    wide[wide > PARTED] *= CHANCE  # how far solutions are that have parted is chance
    np.testing.assert_array_equal(bar[0], wide[0])  # the start has no later errors
    for i in range(1, samples):
        end = i + 2 + samples // 40
        np.testing.assert_array_equal(bar[i], np.maximum(wide[0], (wide + rounding)[1:end].max(axis=0)))


def test_the_bar_is_not_a_number_from_where_an_error_is_none() -> None:
    bar = error_bar(np.array([0.0, 1.0, 1.0, 1.0, np.nan, 1.0]), np.zeros(6))
    assert np.isfinite(bar[:3]).all()
    assert np.isnan(bar[3:]).all()


@pytest.mark.parametrize("period", [0.5, 1.0, 4.0, 20.0, 37.5, 100.0])
def test_no_motion_has_the_same_phase_at_all_looks(period: float) -> None:
    """Equally spaced checks, 25 samples apart, see periods of 25 samples and their parts at one phase only."""
    checks = spread_out(10_001, 400)
    assert checks[0] == 0
    assert checks[-1] == 10_000
    assert 400 <= len(checks) <= 402
    assert np.diff(checks).max() <= 2 * 26
    seen = np.abs(np.sin(2 * np.pi * checks / period)) if period > 1 else np.abs(np.sin(np.pi * checks / (25 * period)))
    for i in range(len(checks) - 11):  # what a bar checks ahead
        assert seen[i : i + 11].max() > 0.5


@pytest.mark.parametrize("method", ["taylor", "dop853"])
def test_bars_hold_between_the_looks(method: str) -> None:
    """A swing of 20 s at 16,001 samples, of which 402 are looked at."""
    scene = tl.load_scene("arm-swing")
    run = tl.simulate(scene, 20.0, accuracy=1e-7, method=method, samples_per_second=800)
    reference, doubt = extended_reference(scene, run.t)
    true = truths.distance(scene.robot, run.q.astype(np.longdouble), reference)
    assert doubt.max() < 0.01 * true.max()
    assert (true <= run.error)[1:].all()
    assert len(np.unique(run.error)) < 402
