"""Contact steps in the native library: many steps of a scene in one call."""

import ctypes
from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol, cast

import numpy as np

from twolink.algorithms.namespaces import Array
from twolink.native.library import Handle, Pool, address, level, library, require
from twolink.native.machine import ALONE, Program


class Parts(NamedTuple):
    """A scene as arrays, in the order of `tl_contact_new` of native/contact/scene.c: sizes (16,), whole, numbers.

    program: of (t, q, v, numbers) for tau - h; None for bodies on which gravity alone acts. loops: of q for their gaps
    and rows; None without.
    """

    sizes: Sequence[int]
    whole: Array
    numbers: Array
    program: Program | None
    loops: Program | None


class Finder(Protocol):
    """A finder of points for which the library has no formula, at poses of all bodies, the ground first."""

    def points(self, rotations: Array, origins: Array, reach: float) -> Any:
        """The points (n,) with gaps below the reach, m, those of a pair after each other: the arrays of `_FOUND`."""

    def overlap(self, rotations: Array, origins: Array) -> float:
        """The largest overlap, m."""


class Told(NamedTuple):
    """The outcome of steps: their number, words of those that are told of and of impacts, and whether bodies rest.

    last, known: where the words of the last step begin, and the number of contacts in its memory. record: counts of
    steps, halved ones, softened ones, by Newton, by proximal points, then the largest misses.
    """

    taken: int
    words: Array
    blow_words: Array
    last: int
    known: int
    rests: bool
    record: tuple[float, ...]


_FOUND = {"key": np.int64, "pair": np.int32, "first": np.int32, "second": np.int32, "gap": float, "normal": float,
          "position": float}  # fmt: skip


class _FoundPoints(ctypes.Structure):
    """tl_found of native/contact/scene.h."""

    _fields_ = (("count", ctypes.c_int64), *((name, ctypes.c_void_p) for name in _FOUND),
                ("overlap", ctypes.c_double))  # fmt: skip


_FINDER = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_double, ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p,
                           ctypes.POINTER(_FoundPoints))  # fmt: skip


class _Told(ctypes.Structure):
    """tl_told of native/contact/run.c."""

    _fields_ = (("words", ctypes.c_void_p), ("blow_words", ctypes.c_void_p),
                *((name, ctypes.c_int64) for name in ("word_count", "blow_count", "last", "known", "rests")),
                ("record", ctypes.c_double * 7))  # fmt: skip


class StepPlan:
    """Steps to take: begins and lengths t, h (n,), s, pieces and marks (n,), and of each piece the numbers (pieces, m).

    The library reads them as one memory, and tells of the steps whose mark is not 0, of odd ones the overlap too.
    """

    def __init__(self, steps: int, numbers: Array) -> None:
        words = np.zeros(4 * steps + numbers.size)
        self.t, self.h, piece, mark = words[: 4 * steps].reshape(4, steps)
        self.piece, self.mark = piece.view(np.int64), mark.view(np.int64)
        self.numbers = words[4 * steps :].reshape(numbers.shape)
        self.numbers[:] = numbers
        self.arguments = address(words), steps, len(numbers)  # of tl_contact_run
        self._words = words


class ContactScene:
    """A scene in the native library, of which each thread that takes steps has one. misses: whether what touches within
    a step may be no point before. uses_python: whether the library asks for points.
    """

    def __init__(self, parts: Parts, finder: Finder | None = None, *, misses: bool = False) -> None:
        self._sizes, self.uses_python = tuple(int(size) for size in parts.sizes[1:4]), finder is not None
        self._pool = Pool(lambda: _Instance(parts, finder, misses=misses))
        self._pool.give(self._pool.take())  # what the library refuses is refused now

    def run(self, plan: StepPlan, first: int, count: int, q: Array, v: Array, memory: Array) -> Told:
        """Take steps up to their count, to bodies at rest, or to one that is not found. memory: words, see `Memory`."""
        if (q.size, v.size, plan.numbers.shape[1]) != self._sizes:
            raise ValueError(f"q {q.shape}, v {v.shape}, numbers {plan.numbers.shape} for {self._sizes}")
        one = self._pool.take()
        try:
            told: Told = one.run(plan, first, count, (q, v, memory))
            return told
        finally:
            self._pool.give(one)


class _Instance:
    """A scene that one thread at a time uses. points: those found last, which the library reads."""

    def __init__(self, parts: Parts, finder: Finder | None, *, misses: bool) -> None:
        self._programs, made = (parts.program, parts.loops), ctypes.c_void_p()
        sizes = np.array(parts.sizes, dtype=np.int32)
        whole, numbers = (
            np.ascontiguousarray(parts.whole, dtype=np.int32),
            np.ascontiguousarray(parts.numbers, dtype=float),
        )
        programs = [None if one is None else one.require_handle().value for one in self._programs]
        self._find = _FINDER() if finder is None else _FINDER(self._found)
        code = library().tl_contact_new(address(sizes), len(whole), address(whole), len(numbers), address(numbers),
                                        *programs, level(), self._find, misses, ctypes.byref(made))  # fmt: skip
        require(code, "a scene with contacts")
        self._handle = Handle(made.value, library().tl_contact_free)
        self._bodies, self._finder = int(sizes[0]), finder
        self._start, self._out = np.empty(0), _Told()
        self._reference = ctypes.byref(self._out)
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
            self._points = [np.ascontiguousarray(getattr(found, name), dtype=kind) for name, kind in _FOUND.items()]
            out.contents.count = len(found.key)
            for name, array in zip(_FOUND, self._points, strict=True):
                setattr(out.contents, name, array.ctypes.data)
        except BaseException as error:
            self._failed = error
            return 1
        return 0

    def run(self, plan: StepPlan, first: int, count: int, start: tuple[Array, Array, Array]) -> Told:
        """Take steps. Raises what the finder raises."""
        out, size, self._failed = self._out, sum(map(len, start)), None
        if size > len(self._start):  # to ask for an address takes longer than to copy some words
            self._start = np.empty(2 * size)
            self._begin = address(self._start)
        np.concatenate(start, out=self._start[:size])
        taken = library().tl_contact_run(self._handle.value, *plan.arguments, first, count, self._begin, size,
                                         self._reference)  # fmt: skip
        if self._failed is not None:
            raise self._failed
        require(min(taken, 0), "steps with contacts")
        words, blows = _copied(out.words, out.word_count), _copied(out.blow_words, out.blow_count)
        return Told(taken, words, blows, out.last, out.known, bool(out.rests), tuple(out.record))


def _copied(place: int, count: int) -> Array:
    """Words of the library (n,), as numbers."""
    return np.frombuffer(ctypes.string_at(place, 8 * count)) if count else np.empty(0)


def runs_alone(program: Program) -> bool:
    """True if the library can run a program for one state."""
    return program.handle is not None and program.fits(ALONE)
