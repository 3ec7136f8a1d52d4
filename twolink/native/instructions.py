"""Instructions: in runs of one operation, since a dispatch costs as much as an instruction, and with registers."""

import heapq
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from twolink.algorithms.namespaces import Array
from twolink.errors import TwolinkError

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


@dataclass(eq=False)
class Instruction:
    """An operation, what it makes, the registers that it reads, by what they hold, and its scalar."""

    what: str
    makes: tuple[Any, ...]
    reads: tuple[Any, ...]
    scalar: float | None = None


def instructions_of(found: dict[int, tuple[Any, ...]]) -> list[Instruction]:
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
                out.append(Instruction("SINCOS", makes, (_operand(x[0]),)))
        elif what in WITH_SCALAR:
            out.append(Instruction(what, (number,), tuple(map(_operand, (x[0], *x[2:]))), float(x[1])))
        else:
            out.append(Instruction(what, (number,), tuple(map(_operand, x))))
    return out


def _operand(x: Node) -> Any:
    """An operand: a node, or a constant."""
    return x if type(x) is int else ("constant", x)


def ordered(instructions: list[Instruction]) -> list[Instruction]:
    """The instructions in runs of one operation, each time that whose first has the longest way to the end."""
    maker = {made: i for i, one in enumerate(instructions) for made in one.makes}
    users: list[list[int]] = [[] for _ in instructions]
    waiting = [0] * len(instructions)
    for i, one in enumerate(instructions):
        for before in {maker[x] for x in one.reads if x in maker}:
            users[before].append(i)
            waiting[i] += 1
    depth = [0] * len(instructions)  # how many there are on the longest way to the end: makers stand before users
    for i in reversed(range(len(instructions))):
        depth[i] = 1 + max((depth[user] for user in users[i]), default=0)
    ready: dict[str, list[tuple[int, int]]] = defaultdict(list)
    for i, one in enumerate(instructions):
        if not waiting[i]:
            heapq.heappush(ready[one.what], (-depth[i], i))
    out: list[Instruction] = []
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


def allocated(instructions: list[Instruction], inputs: int, ends: Sequence[Node]) -> Assembled:
    """The arrays of a program: registers for inputs and constants, then for values as long as they live."""
    constants = dict.fromkeys(x for one in instructions for x in one.reads if type(x) is tuple and x[0] == "constant")
    constants.update(dict.fromkeys(_operand(x) for x in ends if type(x) is not int))
    register: dict[Any, int] = {i: i for i in range(inputs)}
    register.update({x: inputs + i for i, x in enumerate(constants)})
    last: dict[Any, int] = {x: i for i, one in enumerate(instructions) for x in one.reads}
    last.update({_operand(x): len(instructions) for x in ends})
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
        raise TwolinkError(f"a formula needs {top} registers, a program has {MAX_REGISTERS}", code="native-library",
                           remedy="a robot with fewer joints, or engine=\"pinocchio\"")  # fmt: skip
    code = [x for what, rows in runs for x in (CODES[what], len(rows), 0, 0, *(x for row in rows for x in row))]
    return Assembled(
        inputs,
        top,
        np.array(code, dtype=np.uint16),
        np.array(list(scalars), dtype=float),
        np.array([value for _, value in constants], dtype=float),
        np.array([register[x] for x in constants], dtype=np.int32),
        np.array([register[_operand(x)] for x in ends], dtype=np.int32),
        len(instructions),
    )


def _row(one: Instruction, makes: list[int], reads: list[int], scalars: dict[float, int]) -> list[int]:
    """The quads of an instruction: [result, operands ...]; of a sine and cosine [sine, angle, cosine]."""
    if one.what == "SINCOS":
        row = [makes[0], reads[0], makes[1]]
    elif one.scalar is not None:
        row = [makes[0], reads[0], scalars.setdefault(one.scalar, len(scalars)), *reads[1:]]
    else:
        row = makes + reads
    return row + [0] * (4 * QUADS.get(one.what, 1) - len(row))
