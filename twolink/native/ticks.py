"""Ticks of a traced law, in the native library: many of them, with the steps between, in one call."""

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from twolink.native.library import Handle, library
from twolink.native.machine import Program
from twolink.native.stepper import Attempts, Disturbances, Stepper

Array = np.ndarray[Any, np.dtype[Any]]
TICKS = 64  # in a call
STEPS = 4  # attempted steps a tick for which there is a place


@dataclass(frozen=True, eq=False)
class TickedLaw:
    """A law that acts at ticks: (t, rows of the state, numbers kept) -> (torques, numbers kept, divisors that are 0).

    rows: of the state. held, limits (m,): the rows that the torques are written to, and their bounds. kept: how many.
    """

    program: Program
    rows: Sequence[int]
    held: Sequence[int]
    limits: Array
    kept: int


class _Law(ctypes.Structure):
    """tl_traced_law of native/program.h."""

    _fields_ = (*((name, ctypes.c_void_p) for name in ("program", "registers", "rows", "held", "limits", "times", "u",
                                                       "z", "zeros", "at")),
                *((name, ctypes.c_int64) for name in ("torques", "kept", "ticks", "done")))  # fmt: skip


class Ticks:
    """Ticks of a law, with the attempted steps between them, of columns.

    Attributes
    ----------
    states : ndarray (attempts + 1, rows, n)
        Of which the first is given.
    u, z : ndarray (ticks, m, n), (ticks + 1, kept, n)
        The torques before their bounds; the numbers kept, of which the first are given.
    at : ndarray (ticks,)
        Which of the states each tick saw.
    """

    def __init__(self, stepper: Stepper, columns: int, law: TickedLaw, disturbances: Disturbances | None) -> None:
        self.states = np.empty((STEPS * TICKS + 1, stepper.rows, columns))
        self._attempts = Attempts(stepper, self.states, disturbances)
        program, width = law.program.require_handle(), stepper.width(columns)
        registers = Handle(library().tl_registers_new(program.value, width), library().tl_registers_free)
        self._rows, self._held = (np.array(one, dtype=np.int32) for one in (law.rows, law.held))
        self._limits, self._times, self._zeros = law.limits.astype(float).ravel(), np.empty(TICKS + 1), np.zeros(1)
        self.u, self.z = np.empty((TICKS, len(law.held), columns)), np.empty((TICKS + 1, law.kept, columns))
        self.at = np.empty(TICKS, dtype=np.int64)
        arrays = (self._rows, self._held, self._limits, self._times, self.u, self.z, self._zeros, self.at)
        self._uses = program, registers
        self._law = _Law(program.value, registers.value, *(one.ctypes.data for one in arrays), len(law.held), law.kept)

    def __call__(self, times: Array) -> tuple[int, int]:
        """Take the ticks at times (k,) up to the last, which is where they end: how many, and attempts."""
        law = self._law
        self._times[: len(times)] = times
        law.ticks, self._zeros[0] = len(times) - 1, 0.0
        made = self._attempts.with_law(ctypes.byref(law))
        return int(law.done), made

    @property
    def divided_by_zero(self) -> bool:
        """True if a divisor was 0."""
        return bool(self._zeros[0] != 0.0)
