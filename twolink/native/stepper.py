"""Attempts of a method's steps on programs, in the native library: many steps of many columns in one call."""

import ctypes
import functools
import math
import weakref
from dataclasses import dataclass
from typing import Any

import numpy as np

from twolink.algorithms.namespaces import Array
from twolink.native.library import Handle, Pool, address, level, library, require
from twolink.native.machine import Program, widest

KINDS = ("explicit", "implicit", "whole")


@dataclass(frozen=True, eq=False)
class Formulas:
    """The system to advance: x' = f(t, x, p), with x (size,), of which the first `moving` rows change.

    rate: (t, x, p) -> x' (moving,); of kind "whole", (t, x, p, h) -> x after a step. projection: (x, p) -> x on its
    manifold (moving,), or None. jacobian: (t, x, p) -> the entries `entries` (k, 2), row and column, of df/dx, of
    implicit methods. absolute (moving,): whether an entry's error is compared with the tolerance alone. joint_rows
    (j, 4): begin and end of the rows of q and of v of each joint.
    """

    rate: Program
    projection: Program | None
    jacobian: Program | None
    size: int
    moving: int
    parameters: int
    absolute: Array
    joint_rows: Array
    entries: Array

    def programs(self) -> list[Program]:
        """All of them."""
        return [one for one in (self.rate, self.projection, self.jacobian) if one is not None]


@dataclass(frozen=True, eq=False)
class Scheme:
    """A method as arrays: a (stages, stages), with the diagonal of an implicit one, b, c, and rows e of estimates."""

    kind: str
    adaptive: bool
    a: Array
    b: Array
    c: Array
    e: Array
    order: int
    iterations: int = 0


@dataclass(frozen=True, eq=False)
class Disturbances:
    """Of n columns: rounding and bias (n,), relative; first (n,): the row of the table that each begins with.

    table (period, moving): random numbers from -1 to 1. moves (moving, n): 0 where nothing is disturbed. parts: begin
    and end of the rows of q, then of v, of which a share of the largest entry is the least size that counts. embedded
    (n,): 1 where a solution goes on by the embedded formula, x + h sum_j (b_j - e_j) k_j; by default nowhere.
    """

    table: Array
    rounding: Array
    bias: Array
    first: Array
    moves: Array
    parts: tuple[int, int, int, int]
    share: float
    embedded: Array | None = None

    def added(self, attempts: Array, x: Array, steps: float = 1.0) -> Array:
        """Amounts to add to columns x (moving, n) after attempts (n,): sqrt(steps) r |x|, r random, and steps b x.

        b: the bias. steps: how many are disturbed at once.
        """
        size = np.abs(x)
        for begin, end in (self.parts[:2], self.parts[2:]):
            part = size[begin:end]
            np.fmax(part, self.share * part.max(axis=0, initial=0.0), out=part)
        random = self.table[(attempts + self.first) % len(self.table)].T
        return np.asarray((math.sqrt(steps) * random * (self.rounding * size) + steps * self.bias * x) * self.moves)

    @functools.cached_property
    def pointer(self) -> "_Disturbance":
        """The structure for the library, which keeps the arrays alive."""
        embedded = np.zeros(len(self.rounding)) if self.embedded is None else self.embedded
        given = (self.table, self.rounding, self.bias, self.moves, embedded)
        arrays = [np.ascontiguousarray(a, dtype=float) for a in given]
        arrays.append(np.ascontiguousarray(self.first, dtype=np.int64))
        if any(a.shape != self.moves.shape[1:] for a in (arrays[1], arrays[2], arrays[4], arrays[5])):
            raise ValueError(f"disturbances of {[a.shape for a in arrays]}")
        parts = (ctypes.c_int * 4)(*self.parts)
        out = _Disturbance(*map(address, arrays), len(self.table), self.share, parts)
        out.arrays = arrays
        return out


class _Disturbance(ctypes.Structure):
    """tl_disturbance of native/program.h."""

    _fields_ = (*((name, ctypes.c_void_p) for name in ("table", "rounding", "bias", "moves", "embedded", "first")),
                ("period", ctypes.c_int64), ("share", ctypes.c_double), ("parts", ctypes.c_int * 4))  # fmt: skip


class Stepper:
    """A method on formulas, in the native library; may be used by many threads at once."""

    def __init__(self, formulas: Formulas, scheme: Scheme) -> None:
        self.formulas, self.scheme = formulas, scheme
        self.rows = formulas.size + 10 + formulas.parameters
        self.handle = self._method()
        self._pools: dict[int, Pool] = {}
        self._widths: dict[int, int] = {}

    def _method(self) -> Handle:
        """The library's method."""
        one, scheme, made = self.formulas, self.scheme, ctypes.c_void_p()
        sizes = np.array([one.size, one.moving, one.parameters, KINDS.index(scheme.kind), scheme.adaptive,
                          len(scheme.b), len(scheme.e), scheme.order, scheme.iterations, len(one.joint_rows),
                          len(one.entries)], dtype=np.int32)  # fmt: skip
        tableau = np.concatenate([scheme.a.ravel(), scheme.b, scheme.c, scheme.e.ravel()]).astype(float)
        arrays = (sizes, tableau, one.absolute.astype(np.uint8), np.ascontiguousarray(one.joint_rows, dtype=np.int32),
                  np.ascontiguousarray(one.entries, dtype=np.int32))  # fmt: skip
        programs = (p and p.handle and p.handle.value for p in (one.rate, one.projection, one.jacobian))
        require(library().tl_method_new(*programs, *map(address, arrays), ctypes.byref(made)), "a method")
        return Handle(made.value, library().tl_method_free)

    def width(self, columns: int) -> int:
        """The number of columns that run side by side."""
        return widest(self.formulas.programs(), columns)

    def attempts(self, states: Array, count: int, look: int, disturbances: Disturbances | None = None) -> int:
        """Up to `count` attempts of each column of states (count + 1, rows, n), of which the first is given.

        Returns how many were made: fewer when all columns have arrived, or, every `look` attempts, half of them.
        """
        pool = self._pool(states.shape[2])
        work = pool.take()
        try:
            return Attempts(self, states, disturbances, work)(count, look)
        finally:
            pool.give(work)

    def on(self, states: Array, disturbances: Disturbances | None = None) -> "Attempts":
        """`attempts` on states (most + 1, rows, n) that stay where they are: (count, look) -> how many were made.

        One thread at a time may call it; what it works with returns to the stepper when it is no longer used.
        """
        pool = self._pool(states.shape[2])
        work = pool.take()
        made = Attempts(self, states, disturbances, work)
        # The finalizer keeps the workspace: with __del__ the collector could free it first.
        weakref.finalize(made, pool.give, work).atexit = False
        return made

    def _pool(self, columns: int) -> Pool:
        """Workspaces for so many columns."""
        width = self._widths.get(columns) or self._widths.setdefault(columns, self.width(columns))
        return self._pools.get(width) or self._pools.setdefault(width, Pool(functools.partial(self._workspace, width)))

    def _workspace(self, width: int) -> Handle:
        return Handle(library().tl_workspace_new(self.handle.value, width), library().tl_workspace_free)


class Attempts:
    """Attempts on states that stay where they are, with a workspace that nothing else uses."""

    def __init__(self, stepper: Stepper, states: Array, disturbances: Disturbances | None, work: Handle) -> None:
        columns = states.shape[2]
        if states.shape[1] != stepper.rows or not (states.flags.c_contiguous and states.dtype == float):
            raise ValueError(f"states of {states.shape} and {states.dtype} for {stepper.rows} rows")
        if disturbances is not None and disturbances.moves.shape != (stepper.formulas.moving, columns):
            raise ValueError(f"disturbances of {disturbances.moves.shape} for {columns} columns")
        self._most, self._uses = len(states) - 1, (stepper, states, disturbances)
        self._fixed = (work.value, level(), columns)
        self._places = (states.ctypes.data, None if disturbances is None else ctypes.byref(disturbances.pointer))
        self._call = library().tl_attempts

    def __call__(self, count: int, look: int) -> int:
        """Up to `count` attempts; how many were made."""
        if count > self._most:
            raise ValueError(f"{count} attempts in a place for {self._most}")
        made = self._call(*self._fixed, count, look, *self._places)
        require(min(made, 0), "steps")
        return int(made)

    def with_law(self, law: Any) -> int:
        """Attempts with the ticks of a law between them; how many were made."""
        made = library().tl_ticks(*self._fixed, self._most, *self._places, law)
        require(min(made, 0), "ticks")
        return int(made)
