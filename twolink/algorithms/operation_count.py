"""Counting operations: the recursions run on symbols that only remember what was computed.

Equal operations on equal operands are one operation, as compilers see it; signs cost nothing.
"""

from __future__ import annotations

from typing import Any


class Symbol:
    """A value that remembers how it was made."""

    __slots__ = ("key", "tape")

    def __init__(self, tape: Tape, key: int) -> None:
        self.tape, self.key = tape, key

    def __add__(self, other: Any) -> Symbol:
        return self.tape.enter("+", self, other)

    def __mul__(self, other: Any) -> Symbol:
        return self.tape.enter("*", self, other)

    def __sub__(self, other: Any) -> Symbol:
        return self.tape.enter("-", self, other)

    def __rsub__(self, other: Any) -> Symbol:
        return self.tape.enter("-", other, self)

    def __truediv__(self, other: Any) -> Symbol:
        return self.tape.enter("/", self, other)

    def __rtruediv__(self, other: Any) -> Symbol:
        return self.tape.enter("/", other, self)

    def __neg__(self) -> Symbol:
        return self.tape.enter("neg", self)

    __radd__ = __add__
    __rmul__ = __mul__


class Tape:
    """All operations made, each once; it is also the namespace `xp` of the recursions."""

    def __init__(self) -> None:
        self.made: dict[tuple[Any, ...], Symbol] = {}
        self.operands: list[tuple[str, tuple[int, ...]]] = []

    def variable(self) -> Symbol:
        """A fresh input."""
        return self._new("variable", ())

    def sin(self, x: Any) -> Symbol:
        """The sine."""
        return self.enter("sin", x)

    def cos(self, x: Any) -> Symbol:
        """The cosine."""
        return self.enter("cos", x)

    def sqrt(self, x: Any) -> Symbol:
        """The square root."""
        return self.enter("sqrt", x)

    def tanh(self, x: Any) -> Symbol:
        """The hyperbolic tangent."""
        return self.enter("tanh", x)

    def less(self, x: Any, y: Any) -> Symbol:
        """Whether x < y."""
        return self.enter("less", x, y)

    def where(self, condition: Any, yes: Any, no: Any) -> Symbol:
        """yes where the condition holds, else no."""
        return self.enter("where", condition, yes, no)

    def enter(self, what: str, *operands: Any) -> Symbol:
        """The symbol of an operation, made now or met before."""
        keys = [x.key if isinstance(x, Symbol) else float(x) for x in operands]
        if what in "+*":
            keys.sort(key=lambda k: (isinstance(k, float), k))
        key = (what, *keys)
        if key not in self.made:
            self.made[key] = self._new(what, tuple(k for k in keys if not isinstance(k, float)))
        return self.made[key]

    def _new(self, what: str, operands: tuple[int, ...]) -> Symbol:
        self.operands.append((what, operands))
        return Symbol(self, len(self.operands) - 1)

    def count(self, outputs: list[Any]) -> dict[str, int]:
        """How often each operation is needed for the outputs, by its sign or name."""
        seen: set[int] = set()
        stack = [x.key for x in outputs if isinstance(x, Symbol)]
        counts: dict[str, int] = {}
        while stack:
            key = stack.pop()
            if key in seen:
                continue
            seen.add(key)
            what, operands = self.operands[key]
            if what not in ("variable", "neg"):
                counts[what] = counts.get(what, 0) + 1
            stack.extend(operands)
        return counts
