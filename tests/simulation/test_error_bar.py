"""The error bar of two solutions, sample by sample."""

from __future__ import annotations

import numpy as np
import pytest

from twolink.simulation.error_bar import error_bar


@pytest.mark.parametrize("samples", [1, 2, 3, 4, 39, 40, 200])
def test_the_bar_is_the_largest_error_up_to_a_fortieth_of_the_samples_later(samples: int) -> None:
    rng = np.random.default_rng(samples)
    distance, rounding = np.exp(rng.normal(0.0, 3.0, (samples, 2))), rng.random((samples, 2))
    bar = error_bar(distance, rounding)
    np.testing.assert_array_equal(bar[0], 2.0 * distance[0])  # the start has no later errors
    for i in range(1, samples):
        end = i + 2 + samples // 40
        np.testing.assert_array_equal(
            bar[i], np.maximum(2.0 * distance[0], (2.0 * distance + rounding)[1:end].max(axis=0))
        )


def test_the_bar_is_not_a_number_from_where_an_error_is_none() -> None:
    bar = error_bar(np.array([0.0, 1.0, 1.0, 1.0, np.nan, 1.0]), np.zeros(6))
    assert np.isfinite(bar[:3]).all()
    assert np.isnan(bar[3:]).all()
