"""Counting operations: the recursions run on symbols that record what was computed.

Equal operations on equal operands are one operation, as compilers see it; signs cost nothing.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any


def _binary(what: str, *, swapped: bool = False) -> Callable[[Symbol, Any], Symbol]:
    """An operator of symbols. swapped: the other operand stands on the left."""

    def operator(x: Symbol, other: Any) -> Any:
        if not isinstance(other, (Symbol, int, float)):
            return NotImplemented  # such as a jet, which takes a symbol as its value
        return x.tape.enter(what, other, x) if swapped else x.tape.enter(what, x, other)

    return operator


def _function(what: str) -> Callable[..., Symbol]:
    """A function of the namespace."""

    def function(tape: Tape, *operands: Any) -> Symbol:
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
    """All operations made, each once; it is also the namespace `xp` of the recursions."""

    sin, cos, sqrt, exp, tanh = map(_function, ("sin", "cos", "sqrt", "exp", "tanh"))
    atan2, less, where = map(_function, ("atan2", "less", "where"))
    symbol = Symbol

    def __init__(self) -> None:
        self.made: dict[tuple[Any, ...], Symbol] = {}
        self.operands: list[tuple[str, tuple[int, ...]]] = []

    def variable(self) -> Symbol:
        """A new input."""
        return self._new("variable", ())

    def enter(self, what: str, *operands: Any) -> Symbol:
        """The symbol of an operation, made now or before."""
        keys = [x.key if isinstance(x, Symbol) else float(x) for x in operands]
        if what in "+*":
            keys.sort(key=lambda k: (isinstance(k, float), k))
        key = (what, *keys)
        if key not in self.made:
            self.made[key] = self._new(what, tuple(k for k in keys if not isinstance(k, float)))
        return self.made[key]

    def inputs(self, output: Any) -> set[int]:
        """The numbers of the operations and variables that an output depends on, itself included."""
        found: set[int] = set()
        open_keys = [output.key] if isinstance(output, Symbol) else []
        while open_keys:
            key = open_keys.pop()
            if key not in found:
                found.add(key)
                open_keys += self.operands[key][1]
        return found

    def _new(self, what: str, operands: tuple[int, ...]) -> Symbol:
        self.operands.append((what, operands))
        return self.symbol(self, len(self.operands) - 1)

    def count(self, outputs: list[Any]) -> dict[str, int]:
        """How often each operation is needed for the outputs, by its sign or name."""
        needed = {x.key for x in outputs if isinstance(x, Symbol)}
        counts: Counter[str] = Counter()
        for key, (what, operands) in reversed(list(enumerate(self.operands))):  # operands have smaller numbers
            if key in needed:
                needed.update(operands)
                counts[what] += 1
        return {what: n for what, n in counts.items() if what not in ("variable", "neg")}
