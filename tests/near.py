"""Numbers that are near to others."""

import numpy as np
from numpy.typing import ArrayLike


def assert_near(found: ArrayLike, exact: ArrayLike, within: float) -> None:
    """Require as many numbers as there are others, or others for each row, and that they differ by less than a size."""
    found, exact = np.asarray(found), np.asarray(exact)
    assert found.ndim > exact.ndim or found.shape[:1] == exact.shape[:1], f"{found.shape} beside {exact.shape}"
    off = np.abs(found - exact)
    assert off.max() < within, f"{off.max():.3g} off at {np.unravel_index(off.argmax(), off.shape)}"
