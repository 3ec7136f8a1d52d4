"""Contact steps in the native library: many steps of a scene in one call."""

import ctypes
import itertools
from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol, cast

import numpy as np

from twolink.native.library import Handle, Pool, address, level, library, require
from twolink.native.machine import ALONE, Program

Array = np.ndarray[Any, np.dtype[Any]]


class Parts(NamedTuple):
    """A scene as arrays, in the order of `tl_contact_new` of native/contact/scene.c: sizes (14,), whole, numbers.

    program: of (t, q, v, numbers) for tau - h; None for bodies on which gravity alone acts. loops: of q for their gaps
    and rows; None without.
    """

    sizes: Sequence[int]
    whole: Array
    numbers: Array
    program: Program | None
    loops: Program | None


class Steps(NamedTuple):
    """Steps to take: begins and lengths, s, pieces, and whether they are told of (n,), as whole numbers of 8 bytes;
    numbers (pieces, m)."""

    t: Array
    h: Array
    piece: Array
    told: Array
    numbers: Array


class Found(NamedTuple):
    """Points of other pairs, which follow each other: (n,), and normal, position (n, 3)."""

    keys: Array
    pair: Array
    first: Array
    second: Array
    gap: Array
    normal: Array
    position: Array


class Finder(Protocol):
    """A finder of points for which the library has no formula, at poses of all bodies, the ground first."""

    def points(self, rotations: Array, origins: Array, reach: float) -> Found:
        """The points with gaps below the reach, m."""

    def overlap(self, rotations: Array, origins: Array) -> float:
        """The largest overlap, m."""


class Told(NamedTuple):
    """The outcome of steps: their number, words of those that are told of and of impacts, and whether bodies rest.

    record: counts of steps, halved ones, softened ones, by Newton, by proximal points, then the largest misses.
    """

    taken: int
    words: Array
    blow_words: Array
    rests: bool
    record: tuple[float, ...]


class _FoundPoints(ctypes.Structure):
    """tl_found of native/contact/scene.h."""

    _fields_ = (("count", ctypes.c_int64), *((name, ctypes.c_void_p) for name in Found._fields),
                ("overlap", ctypes.c_double))  # fmt: skip


_FINDER = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_double, ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p,
                           ctypes.POINTER(_FoundPoints))  # fmt: skip
_KINDS = (np.int64, np.int32, np.int32, np.int32, float, float, float)


class _Plan(ctypes.Structure):
    """tl_plan of native/contact/run.c."""

    _fields_ = (*((name, ctypes.c_void_p) for name in ("t", "h", "piece", "sampled", "numbers")),
                ("count", ctypes.c_int64), ("pieces", ctypes.c_int64), ("find", _FINDER),
                ("misses", ctypes.c_int64))  # fmt: skip


class _Start(ctypes.Structure):
    """tl_start of native/contact/run.c."""

    _fields_ = (*((name, ctypes.c_void_p) for name in ("q", "v", "memory")), ("words", ctypes.c_int64))


class _Told(ctypes.Structure):
    """tl_told of native/contact/run.c."""

    _fields_ = (("words", ctypes.c_void_p), ("blow_words", ctypes.c_void_p),
                *((name, ctypes.c_int64) for name in ("word_count", "blow_count", "rests")),
                ("record", ctypes.c_double * 7))  # fmt: skip


class ContactScene:
    """A scene in the native library, of which each thread that takes steps has one. misses: whether what touches within
    a step may be no point before."""

    def __init__(self, parts: Parts, finder: Finder | None = None, *, misses: bool = False) -> None:
        self._parts, self._finder, self._misses = parts, finder, misses
        self._sizes = tuple(int(size) for size in parts.sizes[1:4])
        self._pool = Pool(lambda: _Instance(parts, finder))
        self._pool.give(self._pool.take())  # what the library refuses is refused now

    def run(self, steps: Steps, q: Array, v: Array, memory: Array) -> Told:
        """Take steps up to their end, to bodies at rest, or to one that is not found. memory: words, see `Memory`."""
        (nq, nv, m), count = self._sizes, len(steps.t)
        wholes = [x.view(float) for x in (steps.piece, steps.told)]
        arrays = (steps.t, steps.h, *wholes, steps.numbers.ravel(), q, v, memory)
        sizes = (count, count, count, count, m * len(steps.numbers), nq, nv, memory.size)
        if tuple([x.size for x in arrays]) != sizes:
            raise ValueError(f"steps of {[x.shape for x in arrays]}")
        packed = np.concatenate(arrays)  # whose address is one, for to ask for it takes longer than to copy some words
        begin, one = packed.ctypes.data, self._pool.take()
        at = [begin + 8 * before for before in itertools.accumulate(sizes[:-1], initial=0)]
        try:
            plan = _Plan(*at[:5], count, len(steps.numbers), one.find, self._misses)
            told: Told = one.run(plan, _Start(*at[5:], memory.size))
            return told
        finally:
            self._pool.give(one)


class _Instance:
    """A scene that one thread at a time uses. points: those found last, which the library reads."""

    def __init__(self, parts: Parts, finder: Finder | None) -> None:
        self._programs, made = (parts.program, parts.loops), ctypes.c_void_p()
        sizes = np.array(parts.sizes, dtype=np.int32)
        whole, numbers = (np.ascontiguousarray(parts.whole, dtype=np.int32), _numbers(parts.numbers))
        programs = [None if one is None else one.require_handle().value for one in self._programs]
        code = library().tl_contact_new(address(sizes), len(whole), address(whole), len(numbers), address(numbers),
                                        *programs, level(), ctypes.byref(made))  # fmt: skip
        require(code, "a scene with contacts")
        self._handle = Handle(made.value, library().tl_contact_free)
        self._bodies, self._finder = int(sizes[0]), finder
        self.find = _FINDER() if finder is None else _FINDER(self._found)
        self._points: list[Array] = []
        self._failed: BaseException | None = None

    def _found(self, reach: float, wants_overlap: int, turned: int, origin: int, out: Any) -> int:
        """Ask the finder. What it raises is raised when the library is back."""
        try:
            count, finder = self._bodies, cast(Finder, self._finder)
            rotations, origins = _copied(turned, 9 * count).reshape(-1, 3, 3), _copied(origin, 3 * count).reshape(-1, 3)
            if wants_overlap:
                out.contents.overlap = finder.overlap(rotations, origins)
                return 0
            found = finder.points(rotations, origins, reach)
            self._points = [np.ascontiguousarray(x, dtype=kind) for x, kind in zip(found, _KINDS, strict=True)]
            out.contents.count = len(found.keys)
            for name, array in zip(Found._fields, self._points, strict=True):
                setattr(out.contents, name, array.ctypes.data)
        except BaseException as error:
            self._failed = error
            return 1
        return 0

    def run(self, plan: _Plan, begin: _Start) -> Told:
        """Take steps. Raises what the finder raises."""
        out, self._failed = _Told(), None
        taken = library().tl_contact_run(self._handle.value, *map(ctypes.byref, (plan, begin, out)))
        if self._failed is not None:
            raise self._failed
        if taken < 0:
            require(taken, "steps with contacts")
        words, blows = _copied(out.words, out.word_count), _copied(out.blow_words, out.blow_count)
        return Told(int(taken), words, blows, bool(out.rests), tuple(out.record))


def _numbers(x: Array) -> Array:
    return np.ascontiguousarray(x, dtype=float)


def _copied(place: int, count: int) -> Array:
    """Words of the library (n,), as numbers."""
    return np.frombuffer(ctypes.string_at(place, 8 * count)) if count else np.empty(0)


def runs_alone(program: Program) -> bool:
    """True if the library can run a program for one state."""
    return program.handle is not None and program.fits(ALONE)
