"""What tests assert of numbers and runs: that they are near, agree within bars."""

import numpy as np
from numpy.typing import ArrayLike

import twolink as tl


def assert_near(found: ArrayLike, exact: ArrayLike, within: float) -> None:
    """Require as many numbers as there are others, or others for each row, and that they differ by less than a size."""
    found, exact = np.asarray(found), np.asarray(exact)
    assert found.ndim > exact.ndim or found.shape[:1] == exact.shape[:1], f"{found.shape} beside {exact.shape}"
    off = np.abs(found - exact)
    assert off.shape == found.shape, f"{found.shape} beside {exact.shape}"
    assert off.max() < within, f"{off.max():.3g} off at {np.unravel_index(off.argmax(), off.shape)}"


def assert_within(found: ArrayLike, exact: ArrayLike, bars: ArrayLike) -> None:
    """Require rows (n, ...) that are within bars (n,) of others."""
    off = np.abs(np.subtract(found, exact))
    over = off.reshape(len(off), -1).max(axis=1) - bars
    assert (over <= 0.0).all(), f"{over.max():.3g} beyond the bar of row {over.argmax()}"


def assert_agree(one: tl.Trajectory, other: tl.Trajectory) -> None:
    """Require two runs whose configurations are within the bars of both."""
    assert_within(one.q, other.q, one.error + other.error)
