"""Tracing: a law is called once with arrays that record what it computes, and becomes a program of the machine.

NumPy hands its functions to these arrays (`__array_ufunc__`, `__array_function__`). What is not known, such as a branch
on a value, a conversion to a number or a write into an array, ends the attempt, also where the law catches the error.
"""

from __future__ import annotations

import functools
import itertools
import math
import operator
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from twolink.algorithms.tape import Symbol, Tape, collection_paused
from twolink.loop.laws import Array, Measured, UntracedError, leaves_of, rebuilt
from twolink.loop.plain_functions import functions_of
from twolink.native.machine import Program, assembled

MOST = 20_000  # operations of a law: what has more takes longer to trace than to call


def _smaller(xp: Tape, a: Any, b: Any) -> Any:
    """min(a, b), which is not a number where one of them is not."""
    return xp.where(xp.less(a, b), a, xp.where(xp.less_equal(b, a), b, a + b))


def _larger(xp: Tape, a: Any, b: Any) -> Any:
    return xp.where(xp.less(b, a), a, xp.where(xp.less_equal(a, b), b, a + b))


def _power(_: Tape, a: Any, b: Any) -> Any:
    if isinstance(b, Symbol) or b not in range(1, 5):
        raise UntracedError("a power with another exponent than 1 to 4")
    return functools.reduce(operator.mul, [a] * int(b))


_ENTRYWISE: dict[Any, Callable[..., Any]] = {
    np.sin: Tape.sin, np.cos: Tape.cos, np.sqrt: Tape.sqrt, np.exp: Tape.exp, np.tanh: Tape.tanh,
    np.arctan2: Tape.atan2, np.tan: lambda xp, a: xp.sin(a) / xp.cos(a), np.arctan: lambda xp, a: xp.atan2(a, 1.0),
    np.minimum: _smaller, np.maximum: _larger, np.power: _power, np.square: lambda _, a: a * a,
    np.absolute: lambda xp, a: xp.where(xp.less(a, 0.0), -a, a),
    np.fabs: lambda xp, a: xp.where(xp.less(a, 0.0), -a, a),
    np.sign: lambda xp, a: xp.where(xp.less(0.0, a), 1.0, xp.where(xp.less(a, 0.0), -1.0, a)),
    np.hypot: lambda xp, a, b: xp.sqrt(a * a + b * b), np.positive: lambda _, a: a,
    np.deg2rad: lambda _, a: a * (math.pi / 180), np.radians: lambda _, a: a * (math.pi / 180),
    np.rad2deg: lambda _, a: a * (180 / math.pi), np.degrees: lambda _, a: a * (180 / math.pi),
    np.add: lambda _, a, b: a + b, np.subtract: lambda _, a, b: a - b, np.multiply: lambda _, a, b: a * b,
    np.negative: lambda _, a: -a,
}  # fmt: skip
_CONDITIONS: dict[Any, Callable[..., Any]] = {
    np.less: Tape.less, np.less_equal: Tape.less_equal,
    np.greater: lambda xp, a, b: xp.less(b, a), np.greater_equal: lambda xp, a, b: xp.less_equal(b, a),
    np.equal: lambda xp, a, b: xp.less_equal(a, b) * xp.less_equal(b, a),
    np.not_equal: lambda xp, a, b: 1.0 - xp.less_equal(a, b) * xp.less_equal(b, a),
}  # fmt: skip
_LOGIC: dict[Any, Callable[..., Any]] = {  # of conditions
    np.logical_and: lambda _, a, b: a * b, np.bitwise_and: lambda _, a, b: a * b,
    np.logical_or: lambda _, a, b: a + b - a * b, np.bitwise_or: lambda _, a, b: a + b - a * b,
    np.logical_not: lambda _, a: 1.0 - a, np.invert: lambda _, a: 1.0 - a,
}  # fmt: skip
_SHAPING = functions_of(
    np,
    "sum mean prod cumsum diff dot inner outer vdot cross trace concatenate stack vstack hstack column_stack reshape "
    "ravel transpose roll flip repeat tile atleast_1d squeeze expand_dims broadcast_to append copy moveaxis swapaxes",
)
_METHODS = {"sum", "mean", "prod", "cumsum", "dot", "reshape", "ravel", "transpose", "repeat", "squeeze", "copy",
            "trace"}  # fmt: skip
_BY_NAME = {one.__name__: one for one in (np.sin, np.cos, np.sqrt, np.exp, np.tanh, np.tan, np.arctan, np.arctan2)}


class _Trace:
    """The tape of a law, and why it cannot be traced, if it cannot."""

    def __init__(self) -> None:
        self.tape, self.failed = Tape(), ""
        self.divisors: list[Any] = []

    def fail(self, what: str) -> UntracedError:
        self.failed = self.failed or what
        return UntracedError(what)

    def inputs(self, shape: tuple[int, ...]) -> TracedArray:
        return TracedArray(self, self.tape.variables(math.prod(shape)).reshape(shape))

    def entries(self, x: Any) -> Array:
        """Entries of any array-like, symbols and floats, as an array of objects."""
        if isinstance(x, TracedArray):
            return x.entries
        return np.asarray(_ENTRY(np.asarray(x, dtype=object)), dtype=object)

    def quotient(self, _: Tape, a: Any, b: Any) -> Any:
        """a / b, and a note of b: where it is 0, Python may raise an error."""
        if not isinstance(b, Symbol):
            if b == 0.0:
                raise UntracedError("a division by 0")
            return a / b
        self.divisors.append(b)
        return a / b

    def by_entry(self, what: Any, rule: Callable[..., Any], operands: Any, *, boolean: bool = False) -> TracedArray:
        """An array of what a rule makes of entries."""

        def of(*entries: Any) -> Any:
            if any(isinstance(one, Symbol) for one in entries):
                return rule(self.tape, *entries)
            return float(what(*((bool(one) for one in entries) if what in _LOGIC else entries)))

        found = np.frompyfunc(of, len(operands), 1)(*map(self.entries, operands))
        return TracedArray(self, np.asarray(found, dtype=object), boolean=boolean)


class TracedArray:
    """An array whose entries are symbols and numbers. boolean: they are 1 or 0, as those of a condition."""

    __slots__ = ("boolean", "entries", "trace")
    __hash__ = None  # type: ignore[assignment]

    def __init__(self, trace: _Trace, entries: Array, *, boolean: bool = False) -> None:
        self.trace, self.entries, self.boolean = trace, entries, boolean

    @property  # type: ignore[misc]
    def __class__(self) -> Any:
        """The class that it stands for: `isinstance` answers as for NumPy's arrays."""
        return np.ndarray if self.entries.ndim else np.float64

    shape = property(lambda self: self.entries.shape)
    ndim = property(lambda self: self.entries.ndim)
    size = property(lambda self: self.entries.size)
    dtype = property(lambda self: np.dtype(bool if self.boolean else float))
    T = property(lambda self: TracedArray(self.trace, self.entries.T, boolean=self.boolean))

    def __array_ufunc__(self, what: Any, method: str, *operands: Any, **options: Any) -> Any:
        """The result of a function of NumPy by entry."""
        trace = self.trace
        if method != "__call__" or options:
            raise trace.fail(f"np.{what.__name__} with {', '.join(options) or method}")
        conditions = [_is_condition(one) for one in operands]
        if what is np.matmul:
            return TracedArray(trace, np.asarray(np.matmul(*map(trace.entries, operands)), dtype=object))
        if what in _LOGIC and all(conditions):
            return trace.by_entry(what, _LOGIC[what], operands, boolean=True)
        if what in _CONDITIONS:
            return trace.by_entry(what, _CONDITIONS[what], operands, boolean=True)
        if what is np.true_divide:
            return trace.by_entry(what, trace.quotient, operands)
        if what not in _ENTRYWISE or all(conditions):
            raise trace.fail(f"np.{what.__name__}{' of conditions' if all(conditions) else ''}")
        return trace.by_entry(what, _ENTRYWISE[what], operands)

    def __array_function__(self, what: Any, _: Any, given: Any, options: Mapping[str, Any]) -> Any:
        """The result of another function of NumPy."""
        trace = self.trace
        if what is np.where and len(given) == 3 and _is_condition(given[0]):
            return trace.by_entry(what, Tape.where, given)
        if what is np.clip:
            return self._clipped(*given, **options)
        if what in (np.max, np.min, np.amax, np.amin) and len(given) == 1 and not options:
            return given[0].max() if what in (np.max, np.amax) else given[0].min()
        if what is np.linalg.norm and len(given) == 1 and not options and np.ndim(trace.entries(given[0])) == 1:
            return np.sqrt(np.sum(np.square(given[0])))
        if what in (np.zeros_like, np.ones_like) and not options:
            return (np.zeros if what is np.zeros_like else np.ones)(self.shape)
        if what not in _SHAPING or "out" in options:
            raise trace.fail(f"np.{getattr(what, '__name__', what)}")
        return TracedArray(trace, np.asarray(what(*map(self._bare, given), **options), dtype=object))

    def _bare(self, x: Any) -> Any:
        """Arrays of entries in place of traced ones."""
        if isinstance(x, (list, tuple)):
            return type(x)(map(self._bare, x))
        return self.trace.entries(x) if type(x) is TracedArray or type(x) is np.ndarray else x

    def _clipped(self, x: Any, low: Any = None, high: Any = None, **options: Any) -> Any:
        low, high = options.pop("a_min", options.pop("min", low)), options.pop("a_max", options.pop("max", high))
        if options:
            raise self.trace.fail(f"np.clip with {', '.join(options)}")
        x = x if low is None else np.maximum(x, low)
        return x if high is None else np.minimum(x, high)

    def clip(self, *given: Any, **options: Any) -> Any:
        """Entries within bounds."""
        return self._clipped(self, *given, **options)

    def max(self) -> Any:
        """The largest entry."""
        return functools.reduce(np.maximum, self.ravel())

    def min(self) -> Any:
        """The smallest entry."""
        return functools.reduce(np.minimum, self.ravel())

    def astype(self, kind: Any) -> Any:
        """A copy, as floats."""
        if np.dtype(kind) != float:
            raise self.trace.fail(f"astype({kind!r})")
        return TracedArray(self.trace, self.entries)

    def __getitem__(self, key: Any) -> Any:
        if any(isinstance(one, (TracedArray, list, np.ndarray)) for one in (key if isinstance(key, tuple) else (key,))):
            raise self.trace.fail("an index that is an array")
        return TracedArray(self.trace, np.asarray(self.entries[key], dtype=object), boolean=self.boolean)

    def __len__(self) -> int:
        return len(self.entries)

    def __iter__(self) -> Iterator[Any]:
        return (self[i] for i in range(len(self.entries)))

    def __getattr__(self, name: str) -> Any:
        if name in _METHODS:
            method = getattr(self.entries, name)
            return lambda *given, **options: TracedArray(
                self.trace, np.asarray(method(*map(self._bare, given), **options), dtype=object))  # fmt: skip
        if name in _BY_NAME:  # which NumPy calls of the entries of arrays of objects
            return functools.partial(_BY_NAME[name], self)
        if not name.startswith("__"):
            self.trace.fail(f"the attribute {name!r}")
        raise AttributeError(name)

    __array_priority__ = 1000.0


def _fails(what: str) -> Any:
    def method(self: TracedArray, *_: Any) -> Any:
        raise self.trace.fail(what)

    return method


def _operator(what: Any) -> tuple[Any, Any]:
    return lambda self, other: what(self, other), lambda self, other: what(other, self)


for _name, _ufunc in {"add": np.add, "sub": np.subtract, "mul": np.multiply, "truediv": np.true_divide, "pow": np.power,
                      "matmul": np.matmul, "and": np.bitwise_and, "or": np.bitwise_or}.items():  # fmt: skip
    for _prefix, _method in zip(("", "r"), _operator(_ufunc), strict=True):
        setattr(TracedArray, f"__{_prefix}{_name}__", _method)
    setattr(TracedArray, f"__i{_name}__", _fails("a write into an array"))
for _name, _ufunc in {"lt": np.less, "le": np.less_equal, "gt": np.greater, "ge": np.greater_equal, "eq": np.equal,
                      "ne": np.not_equal}.items():  # fmt: skip
    setattr(TracedArray, f"__{_name}__", _operator(_ufunc)[0])
for _name, _ufunc in (("neg", np.negative), ("pos", np.positive), ("abs", np.absolute), ("invert", np.invert)):
    setattr(TracedArray, f"__{_name}__", functools.partialmethod(lambda self, what: what(self), _ufunc))
setattr(TracedArray, "__setitem__", _fails("a write into an array"))  # noqa: B010 beside the others
setattr(TracedArray, "__bool__", _fails("a branch on a value"))  # noqa: B010
for _name in ("float", "int", "index", "complex", "round", "trunc", "floor", "ceil"):
    setattr(TracedArray, f"__{_name}__", _fails(f"a conversion of a value ({_name})"))
for _name in ("mod", "floordiv", "divmod", "rmod", "rfloordiv", "rdivmod", "contains"):
    setattr(TracedArray, f"__{_name}__", _fails(f"the operator {_name!r}"))


def _entry(x: Any) -> Any:
    """A symbol or a float from what an array of objects has."""
    return x.entries.item() if type(x) is TracedArray else x if isinstance(x, Symbol) else float(x)


_ENTRY = np.frompyfunc(_entry, 1, 1)


def _is_condition(x: Any) -> bool:
    return x.boolean if type(x) is TracedArray else np.asarray(x).dtype == bool


class TracedLaw(NamedTuple):
    """A law as a program: (t, what is given, the state's numbers) -> (torques, the new state's numbers, zeros).

    zeros: how many divisors are 0; divides: whether there are any.
    """

    program: Program
    operations: int
    divides: bool


def traced(law: Callable[..., Any], given: Mapping[str, tuple[int, ...]], state: Any, outputs: int) -> TracedLaw:
    """The program of a law.

    Parameters
    ----------
    law : callable
        (t, y, state) -> (u, state).
    given : mapping of str to tuple of int
        The shapes of what it is given, by name.
    state : object
        That of the start.
    outputs : int
        The number of torques.

    Raises
    ------
    UntracedError
        It does something that is not known.
    """
    trace = _Trace()
    try:
        with collection_paused():
            return _traced(trace, law, given, state, outputs)
    except UntracedError as error:
        raise UntracedError(trace.failed or str(error)) from error
    except Exception as error:  # of a user's own function any
        raise UntracedError(trace.failed or f"{type(error).__name__}: {error}") from error


def _traced(
    trace: _Trace, law: Callable[..., Any], given: Mapping[str, tuple[int, ...]], state: Any, outputs: int
) -> TracedLaw:
    t = trace.inputs(())
    y = {name: trace.inputs(shape) for name, shape in given.items()}
    kept = [trace.inputs(np.shape(leaf)) for leaf in leaves_of(state)]
    returned = law(t, Measured(**y), rebuilt(state, iter(kept)))
    if not (isinstance(returned, tuple) and len(returned) == 2):
        raise UntracedError("it does not return (u, state)")
    u, new = trace.entries(returned[0]), leaves_of(returned[1])
    if u.size != outputs or u.ndim > 1:
        raise UntracedError(f"u has the shape {u.shape}")
    after = [trace.entries(one) for one in new]
    marks = iter([0.0] * (len(after) + len(kept)))
    if [one.shape for one in after] != [one.shape for one in kept] or rebuilt(returned[1], marks) != rebuilt(
        state, marks
    ):
        raise UntracedError("its state changes its form")
    inputs = [*itertools.chain(*(one.entries.ravel().tolist() for one in (t, *y.values(), *kept)))]
    xp = trace.tape
    zeros = functools.reduce(operator.add, (xp.less_equal(one * one, 0.0) for one in trace.divisors), 0.0)
    ends = [*itertools.chain(*(one.ravel().tolist() for one in (u, *after))), zeros]
    if trace.failed:
        raise UntracedError(trace.failed)
    count = len(xp.needed(ends))
    if count > MOST:
        raise UntracedError(f"{count} operations")
    return TracedLaw(Program(assembled(xp, inputs, ends)), count, bool(trace.divisors))
