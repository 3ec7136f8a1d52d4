"""Assembling: the operations of a tape become the instructions of a program (`native/program.h`).

1. Signs go: a node is known with a sign, and sums take it in.
2. Products that are used once go into the sums that use them: fused multiply-adds, then sums of two to four products.
3. Instructions are ordered by the longest way to the end, and kept in runs of one operation, since a dispatch costs as
   much as an instruction.
4. Registers are given by how long values live.
"""

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from twolink.algorithms.tape import Operation
from twolink.native.instructions import Assembled, Node, allocated, instructions_of, ordered

Signed = tuple[int, int] | float  # (sign, number of a node), or a constant


def assemble(operations: Sequence[tuple[int, Operation]], inputs: Sequence[int], outputs: Sequence[Node]) -> Assembled:
    """The program of a formula.

    Parameters
    ----------
    operations : sequence of (int, Operation)
        Numbers and operations in an order that they can be computed in, as `Tape.needed` gives it.
    inputs : sequence of int
        The numbers of the variables.
    outputs : sequence of int or float
        Numbers of operations or variables, or constants.

    Raises
    ------
    TwolinkError
        The formula needs more registers than a program can have.
    """
    nodes = _Nodes(len(inputs))
    refs: dict[int, Signed] = {key: (1, i) for i, key in enumerate(inputs)}
    for key, (what, *operands) in operations:
        refs[key] = nodes.made(what, [refs[x] if type(x) is int else float(x) for x in operands])
    ends = [nodes.plain(refs[x] if type(x) is int else float(x)) for x in outputs]
    found = dict(enumerate(nodes.all, nodes.base))
    uses = Counter(x for operands in (ends, *(node[1:] for node in nodes.all)) for x in operands if type(x) is int)
    _fuse(found, uses)
    _join(found, uses)
    return allocated(ordered(instructions_of(found)), len(inputs), ends)


class _Nodes:
    """Nodes without signs, each once: (operation, operands)."""

    def __init__(self, inputs: int) -> None:
        self.base = inputs
        self.all: list[tuple[Any, ...]] = []
        self._seen: dict[tuple[Any, ...], int] = {}
        self._constants: dict[float, int] = {}  # numbers below 0: the constant 1.0 is not the node 1

    def put(self, *node: Any) -> int:
        """The number of a node, made now or before."""
        known = self._constants
        name = tuple(x if type(x) is not float else known.setdefault(x, -1 - len(known)) for x in node)
        number = self._seen.get(name)
        if number is None:
            number = self._seen[name] = self.base + len(self.all)
            self.all.append(node)
        return number

    def plain(self, x: Signed) -> Node:
        """A node without a sign: a minus is made."""
        return x if isinstance(x, float) else x[1] if x[0] > 0 else self.put("NEG", x[1])

    def made(self, what: str, x: list[Signed]) -> Signed:
        """The node of a tape's operation."""
        match what:
            case "+":
                return self._sum(x[0], x[1])
            case "-":
                return self._sum(x[0], _negative(x[1]))
            case "*":
                return self._product(x[0], x[1])
            case "/":
                return self._quotient(x[0], x[1])
            case "neg":
                return _negative(x[0])
            case "sin" | "cos" | "tanh" if not isinstance(x[0], float):  # odd, even, odd
                return (1 if what == "cos" else x[0][0]), self.put(what.upper(), x[0][1])
            case "power":
                return 1, self.put("POWER", self.plain(x[0]), x[1])
            case "sin" | "cos" | "tanh" | "sqrt" | "exp" | "atan2" | "less" | "less_equal" | "where":
                return 1, self.put(what.upper(), *map(self.plain, x))
        raise ValueError(f"no instruction is known for {what!r}")

    def _sum(self, a: Signed, b: Signed) -> Signed:
        if isinstance(a, float) and isinstance(b, float):
            return a + b
        if isinstance(a, float):
            return self._sum(b, a)
        if isinstance(b, float):
            return a if b == 0.0 else (1, self.put("ADD_K" if a[0] > 0 else "K_SUB", a[1], b))
        if a[0] == b[0]:
            return a[0], self.put("ADD", *sorted((a[1], b[1])))
        return 1, (self.put("SUB", a[1], b[1]) if a[0] > 0 else self.put("SUB", b[1], a[1]))

    def _product(self, a: Signed, b: Signed) -> Signed:
        if isinstance(a, float) and isinstance(b, float):
            return a * b
        if isinstance(a, float):
            return self._product(b, a)
        if isinstance(b, float):
            sign = a[0] if b > 0 else -a[0]
            return (sign, a[1]) if abs(b) == 1.0 else (sign, self.put("MUL_K", a[1], abs(b)))
        return a[0] * b[0], self.put("MUL", *sorted((a[1], b[1])))

    def _quotient(self, a: Signed, b: Signed) -> Signed:
        if isinstance(a, float):
            if isinstance(b, float):
                return float(np.divide(a, b))
            return (b[0] if a >= 0 else -b[0]), self.put("K_DIV", b[1], abs(a))
        if isinstance(b, float):
            return a[0] * (1 if b >= 0 else -1), self.put("DIV", a[1], abs(b))
        return a[0] * b[0], self.put("DIV", a[1], b[1])


def _negative(x: Signed) -> Signed:
    return -x if isinstance(x, float) else (-x[0], x[1])


def _fuse(found: dict[int, tuple[Any, ...]], uses: dict[int, int]) -> None:
    """Products that are used once become part of the sum or difference that uses them."""

    def product(x: Any) -> tuple[Any, ...] | None:
        node = found.get(x) if type(x) is int and uses[x] == 1 else None
        return node if node is not None and node[0] in ("MUL", "MUL_K") else None

    for number, (what, *x) in list(found.items()):
        if what == "ADD":
            for term, other in ((x[0], x[1]), (x[1], x[0])):
                if p := product(term):
                    found[number] = ("FMA" if p[0] == "MUL" else "FMA_K", p[1], p[2], other)
                    del found[term]
                    break
        elif what == "SUB" and (p := product(x[1])):
            found[number] = ("FNMA", p[1], p[2], x[0]) if p[0] == "MUL" else ("FMA_K", p[1], -p[2], x[0])
            del found[x[1]]
        elif what == "SUB" and (p := product(x[0])):
            found[number] = ("FMS" if p[0] == "MUL" else "FMS_K", p[1], p[2], x[1])
            del found[x[0]]


def _join(found: dict[int, tuple[Any, ...]], uses: dict[int, int]) -> None:
    """A fused sum that is the last operand of one other becomes part of it: sums of up to four products."""
    for number in list(found):
        what, *x = found.get(number, ("",))
        inner = x[2] if what in ("FMA", "FMS", "FNMA") else None
        if type(inner) is not int or inner not in found or uses[inner] != 1:
            continue
        joined = _joined(what, x, *found[inner])
        if joined:
            found[number] = joined
            del found[inner]


def _joined(what: str, x: list[Any], inner: str, *p: Any) -> tuple[Any, ...] | None:
    """The node of a fused sum `what` of x[0] x[1] and of an inner one with operands p; None where there is none."""
    a, b = x[0], x[1]
    match what, inner:
        case "FMA", "MUL":
            return "DOT2", p[0], p[1], a, b
        case "FNMA", "MUL":
            return "DOT2_MINUS", p[0], p[1], a, b
        case "FMS", "MUL":
            return "DOT2_MINUS", a, b, p[0], p[1]
        case "FMA", "FMA":
            return "E_DOT2", p[0], p[1], a, b, p[2]
        case "FNMA", "FMA":
            return "E_DOT2_MINUS", p[0], p[1], a, b, p[2]
        case "FNMA", "FNMA":
            return "E_MINUS_DOT2", p[0], p[1], a, b, p[2]
        case "FMA", "FNMA":
            return "E_DOT2_MINUS", a, b, p[0], p[1], p[2]
        case "FMA", "E_DOT2":
            return "E_DOT3", *p, a, b
        case "FMA", "E_DOT3":
            return "E_DOT4", *p, a, b
    return None
