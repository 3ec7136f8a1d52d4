"""Tapes: formulas run on symbols that record what was computed, to count it, to write code from it, or to run it again.

Equal operations on equal operands are one operation, as compilers see it; signs cost nothing.
"""

from __future__ import annotations

import contextlib
import gc
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import numpy as np

Operation = tuple[Any, ...]  # what, then the operands: numbers of operations (int) or constants (float)


@contextlib.contextmanager
def collection_paused() -> Iterator[None]:
    """No search for unreachable objects: a tape has none, and so many objects that it takes half the time."""
    was = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was:
            gc.enable()


def _binary(what: str, *, swapped: bool = False) -> Callable[[Symbol, Any], Symbol]:
    """An operator of symbols. swapped: the other operand stands on the left."""

    commutes = what in "+*"

    def operator(x: Symbol, other: Any) -> Any:
        if isinstance(other, Symbol):  # as `enter` does, in half the time
            a, b = x.key, other.key
            return x.tape.made((what, b, a) if (b < a if commutes else swapped) else (what, a, b))
        if not isinstance(other, (int, float)):
            return NotImplemented  # such as a jet, which takes a symbol as its value
        return x.tape.enter(what, other, x) if swapped else x.tape.enter(what, x, other)

    return operator


def _function(what: str) -> Callable[..., Any]:
    """A function of the namespace, of symbols or arrays of them."""

    def function(tape: Tape, *operands: Any) -> Any:
        if any(isinstance(x, np.ndarray) and x.ndim for x in operands):
            return np.frompyfunc(lambda *entries: tape.enter(what, *entries), len(operands), 1)(*operands)
        return tape.enter(what, *operands)

    return function


class Symbol:
    """A value with the number of the operation that made it."""

    __slots__ = ("key", "tape")

    def __init__(self, tape: Tape, key: int) -> None:
        self.tape, self.key = tape, key

    __add__ = __radd__ = _binary("+")
    __mul__ = __rmul__ = _binary("*")
    __sub__, __rsub__ = _binary("-"), _binary("-", swapped=True)
    __truediv__, __rtruediv__ = _binary("/"), _binary("/", swapped=True)

    def __neg__(self) -> Symbol:
        return self.tape.enter("neg", self)


class Tape:
    """All operations made, each once; it is also the namespace `xp` of formulas.

    operations: by their numbers. Operands have smaller numbers than what is made of them.
    """

    sin, cos, sqrt, exp, tanh, less, where = map(_function, ("sin", "cos", "sqrt", "exp", "tanh", "less", "where"))
    less_equal, atan2 = _function("less_equal"), _function("atan2")
    symbol = Symbol

    def __init__(self) -> None:
        self.operations: list[Operation] = []
        self._made: dict[tuple[Any, ...], Symbol] = {}
        self._constants: dict[float, int] = {}  # numbers below 0: the constant 1.0 is not the operation 1

    @staticmethod
    def lift(x: Any) -> Any:
        """x itself: a symbol or a constant."""
        return x

    @staticmethod
    def both(a: Any, b: Any) -> Any:
        """The conjunction of two conditions: 1 or 0."""
        return a * b

    def power(self, x: Any, exponent: float) -> Symbol:
        """x to a constant power."""
        return self.enter("power", x, float(exponent))

    def variable(self) -> Symbol:
        """A new input."""
        return self._new(("variable",))

    def variables(self, count: int) -> np.ndarray[Any, np.dtype[Any]]:
        """New inputs, an array of objects."""
        out = np.empty(count, dtype=object)
        for i in range(count):
            out[i] = self.variable()
        return out

    def enter(self, what: str, *operands: Any) -> Symbol:
        """The symbol of an operation, made now or before."""
        keys = [x.key if isinstance(x, Symbol) else float(x) for x in operands]
        if what in "+*":
            keys.sort(key=lambda key: (isinstance(key, float), key))  # constants last
        return self.made((what, *keys))

    def made(self, operation: Operation) -> Symbol:
        """The symbol of an operation on numbers of operations and constants, in their order."""
        name, known = operation, self._constants
        for key in operation:
            if type(key) is float:
                name = tuple(x if type(x) is not float else known.setdefault(x, -1 - len(known)) for x in operation)
                break
        found = self._made.get(name)
        if found is None:
            self.operations.append(operation)
            found = self._made[name] = self.symbol(self, len(self.operations) - 1)
        return found

    def inputs(self, output: Any) -> set[int]:
        """The numbers of the operations and variables that an output depends on, itself included."""
        return set(self._behind([output]))

    def needed(self, outputs: Iterable[Any]) -> list[int]:
        """The numbers of the operations behind outputs, in an order that they can be computed in; no variables."""
        return [key for key in sorted(self._behind(outputs)) if self.operations[key][0] != "variable"]

    def _behind(self, outputs: Iterable[Any]) -> set[int]:
        """The numbers of all operations and variables behind outputs."""
        found: set[int] = set()
        open_keys = [output.key for output in outputs if isinstance(output, Symbol)]
        while open_keys:
            key = open_keys.pop()
            if key not in found:
                found.add(key)
                open_keys += [k for k in self.operations[key][1:] if type(k) is int]
        return found

    def _new(self, operation: Operation) -> Symbol:
        self.operations.append(operation)
        return self.symbol(self, len(self.operations) - 1)

    def count(self, outputs: Sequence[Any]) -> dict[str, int]:
        """Counts of the operations that the outputs need, by sign or name."""
        counts = Counter(self.operations[key][0] for key in self.needed(outputs))
        return {what: n for what, n in counts.items() if what != "neg"}
