"""Ticks of a law, in the native library: many of them, with the steps between, in one call."""

import ctypes
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from twolink.algorithms.namespaces import Array
from twolink.native.library import Handle, library
from twolink.native.machine import Program
from twolink.native.stepper import Disturbances, Stepper

TICKS = 256  # in a call
STEPS = 4  # attempted steps a tick for which there is a place


@dataclass(frozen=True, eq=False)
class TickedLaw:
    """A law that acts at ticks: a program, or a function (how many ticks before in this call, t, x) -> torques (m, n).

    program: (t, rows of the state, numbers kept) -> (torques, numbers kept, divisors that are 0). held, limits (m,):
    the rows that the torques are written to, and their bounds.
    """

    held: Sequence[int]
    limits: Array
    program: Program | None = None
    rows: Sequence[int] = ()
    kept: int = 0
    call: Callable[[int, float, Array], Array] | None = None


_Call = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_int64, ctypes.c_int64)


class _Law(ctypes.Structure):
    """tl_traced_law of native/program.h."""

    _fields_ = (*((name, ctypes.c_void_p) for name in ("program", "registers", "rows", "held", "limits", "times", "u",
                                                       "z", "zeros", "at")),
                *((name, ctypes.c_int64) for name in ("torques", "kept", "ticks", "done")),
                ("call", _Call))  # fmt: skip


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
    error : BaseException or None
        That of a function, whose tick was not taken.
    """

    def __init__(self, stepper: Stepper, columns: int, law: TickedLaw, disturbances: Disturbances | None) -> None:
        self.states = np.empty((STEPS * TICKS + 1, stepper.rows, columns))
        self._attempts, self._call = stepper.on(self.states, disturbances), law.call
        self._program = None if law.program is None else law.program.require_handle()
        self._registers = None
        if self._program is not None:
            registers = library().tl_registers_new(self._program.value, stepper.width(columns))
            self._registers = Handle(registers, library().tl_registers_free)
        self._rows, self._held = (np.array(one, dtype=np.int32) for one in (law.rows, law.held))
        self._limits, self._times, self._zeros = law.limits.astype(float).ravel(), np.empty(TICKS + 1), np.zeros(1)
        self.u, self.z = np.empty((TICKS, len(law.held), columns)), np.empty((TICKS + 1, law.kept, columns))
        self.at = np.empty(TICKS, dtype=np.int64)
        self.error: BaseException | None = None
        arrays = (self._rows, self._held, self._limits, self._times, self.u, self.z, self._zeros, self.at)
        handles = (one and one.value for one in (self._program, self._registers))
        self._law = _Law(*handles, *(one.ctypes.data for one in arrays), len(law.held), law.kept, 0, 0,
                         _Call() if law.call is None else _Call(self._ask))  # fmt: skip

    def __call__(self, times: Array) -> tuple[int, int]:
        """Take the ticks at times (k,) up to the last, which is where they end: how many, and attempts."""
        law = self._law
        self._times[: len(times)] = times
        law.ticks, self._zeros[0], self.error = len(times) - 1, 0.0, None
        made = self._attempts.with_law(ctypes.byref(law))
        return int(law.done), made

    def _ask(self, tick: int, state: int) -> int:
        """Ask the function; 0 if it answered."""
        try:
            self.u[tick] = self._call(tick, self._times.item(tick), self.states[state])  # type: ignore[misc]
        except BaseException as error:  # which cannot pass through the library
            self.error = error
            return 1
        return 0

    @property
    def divided_by_zero(self) -> bool:
        """True if a divisor was 0."""
        return bool(self._zeros[0] != 0.0)
