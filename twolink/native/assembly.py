"""Assembling: the operations of a tape become the instructions of a program (`native/program.h`).

1. Signs go: a node is known with a sign, and sums take it in.
2. Products that are used once go into the sums that use them: fused multiply-adds, then sums of two to four products.
3. Instructions are ordered by the longest way to the end, and kept in runs of one operation, since a dispatch costs as
   much as an instruction.
4. Registers are given by how long values live.
"""

import heapq
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from twolink.algorithms.tape import Operation

Array = np.ndarray[Any, np.dtype[Any]]
OPERATIONS = (
    "ADD", "SUB", "MUL", "FMA", "FMS", "FNMA", "ADD_K", "K_SUB", "MUL_K", "FMA_K", "FMS_K", "DIV", "K_DIV", "SQRT",
    "NEG", "SINCOS", "EXP", "TANH", "ATAN2", "LESS", "LESS_EQUAL", "WHERE", "POWER", "DOT2", "DOT2_MINUS", "E_DOT2",
    "E_DOT2_MINUS", "E_MINUS_DOT2", "COPY", "E_DOT3", "E_DOT4",
)  # fmt: skip
CODES = {name: code for code, name in enumerate(OPERATIONS)}
QUADS = {"DOT2": 2, "DOT2_MINUS": 2, "E_DOT2": 2, "E_DOT2_MINUS": 2, "E_MINUS_DOT2": 2, "E_DOT3": 2, "E_DOT4": 3}
WITH_SCALAR = {"ADD_K", "K_SUB", "MUL_K", "FMA_K", "FMS_K", "K_DIV", "POWER"}
LONGEST_RUN = 65_000
MAX_REGISTERS = 65_535
Node = int | float  # the number of a node, or a constant
Signed = tuple[int, int] | float  # (sign, number of a node), or a constant


@dataclass(frozen=True, eq=False)
class Assembled:
    """The arrays of a program, as `native/program.h` has them; they are kept in the disk cache."""

    inputs: int
    registers: int
    code: Array
    scalars: Array
    constants: Array
    constant_at: Array
    output_at: Array
    instructions: int


class ProgramTooLargeError(Exception):
    """A formula needs more registers than a program can have."""


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
    ProgramTooLargeError
    """
    nodes = _Nodes(len(inputs))
    refs: dict[int, Signed] = {key: (1, i) for i, key in enumerate(inputs)}
    for key, (what, *operands) in operations:
        refs[key] = nodes.made(what, [refs[x] if type(x) is int else float(x) for x in operands])
    ends = [nodes.plain(refs[x] if type(x) is int else float(x)) for x in outputs]
    found = _live(nodes, ends)
    uses = _uses(found, ends)
    _fuse(found, uses)
    _join(found, uses)
    instructions = _ordered(_instructions(found))
    return _allocated(instructions, len(inputs), ends)


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
            a, b = b, a
        assert not isinstance(a, float)
        if isinstance(b, float):
            return a if b == 0.0 else (1, self.put("ADD_K" if a[0] > 0 else "K_SUB", a[1], b))
        if a[0] == b[0]:
            return a[0], self.put("ADD", *sorted((a[1], b[1])))
        return 1, (self.put("SUB", a[1], b[1]) if a[0] > 0 else self.put("SUB", b[1], a[1]))

    def _product(self, a: Signed, b: Signed) -> Signed:
        if isinstance(a, float) and isinstance(b, float):
            return a * b
        if isinstance(a, float):
            a, b = b, a
        assert not isinstance(a, float)
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


def _live(nodes: _Nodes, ends: Iterable[Node]) -> dict[int, tuple[Any, ...]]:
    """The nodes behind the ends, in order."""
    wanted = {x for x in ends if type(x) is int}
    for number in range(nodes.base + len(nodes.all) - 1, nodes.base - 1, -1):
        if number in wanted:
            wanted.update(x for x in nodes.all[number - nodes.base][1:] if type(x) is int)
    return {number: nodes.all[number - nodes.base] for number in sorted(wanted) if number >= nodes.base}


def _uses(found: dict[int, tuple[Any, ...]], ends: Iterable[Node]) -> dict[int, int]:
    """How often each node is used."""
    uses: dict[int, int] = defaultdict(int)
    for operands in (tuple(ends), *(node[1:] for node in found.values())):
        for x in operands:
            if type(x) is int:
                uses[x] += 1
    return uses


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


@dataclass(eq=False)
class _Instruction:
    """An operation, what it makes, the registers that it reads, by what they hold, and its scalar."""

    what: str
    makes: tuple[Any, ...]
    reads: tuple[Any, ...]
    scalar: float | None = None


def _instructions(found: dict[int, tuple[Any, ...]]) -> list[_Instruction]:
    """Nodes as instructions; sine and cosine of an angle are one."""
    angles: dict[Any, dict[str, int]] = defaultdict(dict)
    for number, (what, *x) in found.items():
        if what in ("SIN", "COS"):
            angles[x[0]][what] = number
    out = []
    for number, (what, *x) in found.items():
        if what in ("SIN", "COS"):
            pair = angles[x[0]]
            if min(pair.values()) == number:
                makes = (pair.get("SIN", ("unused", number)), pair.get("COS", ("unused", -number)))
                out.append(_Instruction("SINCOS", makes, (_held(x[0]),)))
        elif what in WITH_SCALAR:
            out.append(_Instruction(what, (number,), tuple(map(_held, (x[0], *x[2:]))), float(x[1])))
        else:
            out.append(_Instruction(what, (number,), tuple(map(_held, x))))
    return out


def _held(x: Node) -> Any:
    """What a register holds: a node, or a constant."""
    return x if type(x) is int else ("constant", x)


def _ordered(instructions: list[_Instruction]) -> list[_Instruction]:
    """The instructions in runs of one operation, each time that whose first has the longest way to the end."""
    maker = {made: i for i, one in enumerate(instructions) for made in one.makes}
    users: list[list[int]] = [[] for _ in instructions]
    waiting = [0] * len(instructions)
    for i, one in enumerate(instructions):
        for before in {maker[x] for x in one.reads if x in maker}:
            users[before].append(i)
            waiting[i] += 1
    depth = _depths(users, waiting)
    ready: dict[str, list[tuple[int, int]]] = defaultdict(list)
    for i, one in enumerate(instructions):
        if not waiting[i]:
            heapq.heappush(ready[one.what], (-depth[i], i))
    out: list[_Instruction] = []
    now = ""
    while len(out) < len(instructions):
        if not ready.get(now):
            now = min((queue[0][0], -len(queue), what) for what, queue in ready.items() if queue)[2]
        i = heapq.heappop(ready[now])[1]
        out.append(instructions[i])
        for user in users[i]:
            waiting[user] -= 1
            if not waiting[user]:
                heapq.heappush(ready[instructions[user].what], (-depth[user], user))
    return out


def _depths(users: list[list[int]], waiting: list[int]) -> list[int]:
    """How many instructions the longest way from each to the end has."""
    left, order = waiting[:], [i for i, count in enumerate(waiting) if not count]
    for i in order:
        for user in users[i]:
            left[user] -= 1
            if not left[user]:
                order.append(user)
    depth = [0] * len(users)
    for i in reversed(order):
        depth[i] = 1 + max((depth[user] for user in users[i]), default=0)
    return depth


def _allocated(instructions: list[_Instruction], inputs: int, ends: Sequence[Node]) -> Assembled:
    """The arrays of a program: registers for inputs and constants, then for values as long as they live."""
    constants = dict.fromkeys(x for one in instructions for x in one.reads if type(x) is tuple and x[0] == "constant")
    constants.update(dict.fromkeys(_held(x) for x in ends if type(x) is not int))
    register: dict[Any, int] = {i: i for i in range(inputs)}
    register.update({x: inputs + i for i, x in enumerate(constants)})
    last: dict[Any, int] = {x: i for i, one in enumerate(instructions) for x in one.reads}
    last.update({_held(x): len(instructions) for x in ends})
    free: list[int] = []
    top, scalars = len(register), dict[float, int]()
    runs: list[tuple[str, list[list[int]]]] = []
    for i, one in enumerate(instructions):
        reads = [register[x] for x in one.reads]
        free += [register[x] for x in dict.fromkeys(one.reads) if last[x] == i and type(x) is int and x >= inputs]
        for made in one.makes:
            if free:
                register[made] = free.pop()
            else:
                register[made], top = top, top + 1
        free += [register[made] for made in one.makes if made not in last]
        row = _row(one, [register[made] for made in one.makes], reads, scalars)
        if runs and runs[-1][0] == one.what and len(runs[-1][1]) < LONGEST_RUN:
            runs[-1][1].append(row)
        else:
            runs.append((one.what, [row]))
    if top > MAX_REGISTERS or len(scalars) > MAX_REGISTERS:
        raise ProgramTooLargeError
    code = [x for what, rows in runs for x in (CODES[what], len(rows), 0, 0, *(x for row in rows for x in row))]
    return Assembled(
        inputs,
        top,
        np.array(code, dtype=np.uint16),
        np.array(list(scalars), dtype=float),
        np.array([value for _, value in constants], dtype=float),
        np.array([register[x] for x in constants], dtype=np.int32),
        np.array([register[_held(x)] for x in ends], dtype=np.int32),
        len(instructions),
    )


def _row(one: _Instruction, makes: list[int], reads: list[int], scalars: dict[float, int]) -> list[int]:
    """The quads of an instruction: [result, operands ...]; of a sine and cosine [sine, angle, cosine]."""
    if one.what == "SINCOS":
        row = [makes[0], reads[0], makes[1]]
    elif one.scalar is not None:
        row = [makes[0], reads[0], scalars.setdefault(one.scalar, len(scalars)), *reads[1:]]
    else:
        row = makes + reads
    return row + [0] * (4 * QUADS.get(one.what, 1) - len(row))
