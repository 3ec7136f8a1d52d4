"""Attempts of a method's steps on programs, in the native library: many steps of many columns in one call."""

import ctypes
import functools
from dataclasses import dataclass
from typing import Any

import numpy as np

from twolink.native.library import Handle, Pool, address, level, library, require
from twolink.native.machine import ALONE, FEW, MANY, WIDTHS, Program

Array = np.ndarray[Any, np.dtype[Any]]
KINDS = ("explicit", "implicit", "whole")


@dataclass(frozen=True, eq=False)
class Formulas:
    """What is advanced: x' = f(t, x, p), with x (size,), of which the first `moving` rows change.

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
    and end of the rows of q, then of v, of which a share of the largest entry is the least size that counts.
    """

    table: Array
    rounding: Array
    bias: Array
    first: Array
    moves: Array
    parts: tuple[int, int, int, int]
    share: float

    @functools.cached_property
    def pointer(self) -> "_Disturbance":
        """The structure for the library, which keeps the arrays alive."""
        arrays = [np.ascontiguousarray(a, dtype=float) for a in (self.table, self.rounding, self.bias, self.moves)]
        arrays.append(np.ascontiguousarray(self.first, dtype=np.int64))
        if any(a.shape != self.moves.shape[1:] for a in (arrays[1], arrays[2], arrays[4])):
            raise ValueError(f"disturbances of {[a.shape for a in arrays]}")
        parts = (ctypes.c_int * 4)(*self.parts)
        out = _Disturbance(*map(address, arrays), len(self.table), self.share, parts)
        out.arrays = arrays
        return out


class _Disturbance(ctypes.Structure):
    """tl_disturbance of native/program.h."""

    _fields_ = (*((name, ctypes.c_void_p) for name in ("table", "rounding", "bias", "moves", "first")),
                ("period", ctypes.c_int64), ("share", ctypes.c_double), ("parts", ctypes.c_int * 4))  # fmt: skip


class Stepper:
    """A method on formulas, in the native library; may be used by many threads at once."""

    def __init__(self, formulas: Formulas, scheme: Scheme) -> None:
        self.formulas, self.scheme = formulas, scheme
        self.rows = formulas.size + 10 + formulas.parameters
        self.handle = self._method()
        self._pools: dict[int, Pool] = {}

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
        """How many columns run side by side."""
        wanted = ALONE if columns == 1 else FEW if columns <= FEW else MANY
        fitting = (w for w in WIDTHS if w <= wanted and all(p.fits(w) for p in self.formulas.programs()))
        return next(fitting)

    def attempts(self, states: Array, count: int, look: int, disturbances: Disturbances | None = None) -> int:
        """Up to `count` attempts of each column of states (count + 1, rows, n), of which the first is given.

        Returns how many were made: fewer when all columns have arrived, or, every `look` attempts, half of them.
        """
        columns = states.shape[2]
        pool, pointer = self._pool(self.width(columns)), None
        if disturbances is not None:
            if disturbances.moves.shape != (self.formulas.moving, columns):
                raise ValueError(f"disturbances of {disturbances.moves.shape} for {columns} columns")
            pointer = ctypes.byref(disturbances.pointer)
        work = pool.take()
        try:
            made = library().tl_attempts(work.value, level(), columns, count, look, states.ctypes.data, pointer)
        finally:
            pool.give(work)
        require(min(made, 0), "steps")
        return int(made)

    def _pool(self, width: int) -> Pool:
        """Workspaces of this width."""
        pool = self._pools.get(width)
        return pool or self._pools.setdefault(width, Pool(functools.partial(self._workspace, width)))

    def _workspace(self, width: int) -> Handle:
        return Handle(library().tl_workspace_new(self.handle.value, width), library().tl_workspace_free)
