"""Taylor's method on programs, in the native library, in numbers of 1, 2 or 3 doubles: 16, 31 or 47 digits."""

import ctypes

import numpy as np

from twolink.algorithms.namespaces import Array
from twolink.errors import TwolinkError
from twolink.native.instructions import OPERATIONS
from twolink.native.library import OUTCOMES, Handle, address, level, library, require
from twolink.native.machine import Program
from twolink.native.stepper import Disturbances

NOT_FINITE = OUTCOMES.index("the state is not finite")
NO_SERIES = OUTCOMES.index("an operation has no Taylor series")  # and the number of the operation


class Series:
    """One solution by Taylor's method, as far as it has been advanced.

    Parameters
    ----------
    rate : Program
        (t, x, constants) -> x' (moving,), then rates that co-decide the length of steps.
    order : int
        The highest power of time in the polynomial of a step.
    t : float
        The time of the start, s.
    x : ndarray (moving, parts)
        The start, in numbers that are sums of 1, 2 or 3 doubles.
    constants : ndarray (k,)
        The values of the inputs behind x.
    longest : float
        No step is longer, s.

    Raises
    ------
    TwolinkError
        An operation of the rate has no recurrence (code "no-taylor-series").

    Attributes
    ----------
    t : float
        The time at which the last step begins, s.
    steps : int
        How many steps there were.
    """

    def __init__(self, rate: Program, order: int, t: float, x: Array, constants: Array, longest: float) -> None:
        self.t, self.steps, self.shape, made = t, 0, x.shape, ctypes.c_void_p()
        x, constants = np.ascontiguousarray(x, dtype=float), np.ascontiguousarray(constants, dtype=float)
        if 1 + len(x) + len(constants) != rate.inputs:
            raise ValueError(f"a rate of {rate.inputs} inputs got {1 + len(x) + len(constants)}")
        code = library().tl_taylor_new(rate.require_handle().value, level(), len(x), order, x.shape[1], t, address(x),
                                       address(constants), longest, ctypes.byref(made))  # fmt: skip
        if code >= NO_SERIES:
            raise TwolinkError(f"Taylor's method has no recurrence for {OPERATIONS[code - NO_SERIES]}",
                               remedy='method="dop853"', code="no-taylor-series")  # fmt: skip
        require(code, "Taylor's method")
        self._handle = Handle(made.value, library().tl_taylor_free)

    def advance(self, times: Array, out: Array, limit: int, disturbances: Disturbances | None = None) -> int:
        """Write states (moving, parts) at increasing times, in up to `limit` steps; returns how many were written.

        Raises FloatingPointError where the motion is not finite.
        """
        if out.shape[1:] != self.shape or len(out) < len(times):
            raise ValueError(f"states of {self.shape} at {len(times)} times for an array of {out.shape}")
        reached, rows, pointer = np.zeros(2), self.shape[0], None
        if disturbances is not None:
            if disturbances.moves.shape != (rows, 1) or disturbances.table.shape[1] != rows:
                raise ValueError(f"disturbances of {disturbances.moves.shape} for states of {self.shape}")
            pointer = ctypes.byref(disturbances.pointer)
        done = int(library().tl_taylor_advance(self._handle.value, level(), len(times), address(times), address(out),
                                               pointer, limit, address(reached)))  # fmt: skip
        self.t, self.steps = float(reached[0]), int(reached[1])
        if done == -NOT_FINITE:
            raise FloatingPointError(OUTCOMES[NOT_FINITE])
        require(min(done, 0), "Taylor's method")
        return done
