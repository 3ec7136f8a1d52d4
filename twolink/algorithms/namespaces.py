"""Functions that plain arithmetic lacks, as a namespace xp of arrays of numbers; `tape.Tape` records formulas."""

from typing import Any

import numpy as np

Array = np.ndarray[Any, np.dtype[Any]]


class Numbers:
    """sin, cos, sqrt, exp, tanh, atan2, and choices by condition, of NumPy arrays."""

    sin, cos, sqrt, exp, tanh, atan2 = np.sin, np.cos, np.sqrt, np.exp, np.tanh, np.arctan2
    less, less_equal, both, where = np.less, np.less_equal, np.logical_and, np.where

    @staticmethod
    def power(x: Any, exponent: float) -> Any:
        """x to a constant power."""
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            return np.power(x, exponent)
