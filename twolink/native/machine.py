"""Programs: traced formulas that run over columns of numbers, by the native library or, without it, by NumPy."""

import ctypes
import functools
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from twolink.algorithms.namespaces import Array
from twolink.algorithms.tape import Symbol, Tape
from twolink.errors import TwolinkError
from twolink.native.assembly import assemble
from twolink.native.instructions import OPERATIONS, QUADS, WITH_SCALAR, Assembled
from twolink.native.library import Handle, Pool, address, level, library, require

WIDTHS = (16, 8, 4, 1)  # columns side by side
ALONE, FEW, MANY = 1, 4, 8  # the widths for one column, for up to so many, and for more
WIDE = 64  # columns from which the widest pays

_NUMPY: dict[str, Callable[..., Any]] = {
    "ADD": np.add, "SUB": np.subtract, "MUL": np.multiply, "DIV": np.divide, "SQRT": np.sqrt, "NEG": np.negative,
    "EXP": np.exp, "TANH": np.tanh, "ATAN2": np.arctan2, "COPY": np.positive,
    "ADD_K": np.add, "K_SUB": lambda a, k: k - a, "MUL_K": np.multiply, "K_DIV": lambda a, k: k / a, "POWER": np.power,
    "FMA": lambda a, b, c: a * b + c, "FMS": lambda a, b, c: a * b - c, "FNMA": lambda a, b, c: c - a * b,
    "FMA_K": lambda a, k, c: a * k + c, "FMS_K": lambda a, k, c: a * k - c,
    "DOT2": lambda a, b, c, d: a * b + c * d, "DOT2_MINUS": lambda a, b, c, d: a * b - c * d,
    "E_DOT2": lambda a, b, c, d, e: e + a * b + c * d, "E_DOT2_MINUS": lambda a, b, c, d, e: e + a * b - c * d,
    "E_MINUS_DOT2": lambda a, b, c, d, e: e - a * b - c * d,
    "E_DOT3": lambda a, b, c, d, e, f, g: e + a * b + c * d + f * g,
    "E_DOT4": lambda a, b, c, d, e, f, g, h, i: e + a * b + c * d + f * g + h * i,
    "LESS": lambda a, b: np.where(a < b, 1.0, 0.0), "LESS_EQUAL": lambda a, b: np.where(a <= b, 1.0, 0.0),
    "WHERE": lambda a, b, c: np.where((a < 0.0) | (a > 0.0), b, c),
}  # fmt: skip


def trace(formula: Callable[[Array, Tape], Iterable[Any]], inputs: int) -> Assembled:
    """The program of a formula of a vector (inputs,) of symbols and of the namespace.

    Raises TwolinkError where it needs too many registers.
    """
    tape = Tape()
    x = tape.variables(inputs)
    return assembled(tape, x, formula(x, tape))


def assembled(tape: Tape, inputs: Iterable[Any], outputs: Iterable[Any]) -> Assembled:
    """The program of outputs on a tape: symbols and constants."""
    outputs = list(outputs)
    ends = [x.key if isinstance(x, Symbol) else float(x) for x in outputs]
    operations = [(key, tape.operations[key]) for key in tape.needed(outputs)]
    return assemble(operations, [x.key for x in inputs], ends)


class Program:
    """A program that can be called, from many threads at once.

    Parameters
    ----------
    arrays : Assembled
    constants : ndarray (k,), optional
        Values of the last k inputs, which are then none of the program's.
    """

    def __init__(self, arrays: Assembled, constants: Array | None = None) -> None:
        given = np.zeros(0) if constants is None else np.asarray(constants, dtype=float)
        self.inputs, self.outputs = arrays.inputs - len(given), len(arrays.output_at)
        self.arrays = arrays
        self._constants = np.concatenate([arrays.constants, given])
        places = np.arange(self.inputs, arrays.inputs)
        self._constant_at = np.concatenate([arrays.constant_at, places]).astype(np.int32)
        self.handle = None if library() is None else self._native()
        self._pools: dict[int, Pool] = {}

    def _native(self) -> Handle:
        """The library's program."""
        one, made = self.arrays, ctypes.c_void_p()
        arrays = [np.ascontiguousarray(a) for a in (one.code, one.scalars, one.output_at)]
        code = library().tl_program_new(
            self.inputs, self.outputs, one.registers, len(one.code) // 4, address(arrays[0]), len(one.scalars),
            address(arrays[1]), len(self._constants), address(self._constant_at), address(self._constants),
            address(arrays[2]), ctypes.byref(made),
        )  # fmt: skip
        require(code, "a program")
        return Handle(made.value, library().tl_program_free)

    def require_handle(self) -> Handle:
        """The library's program. Raises TwolinkError where there is no library."""
        if self.handle is None:
            raise TwolinkError("there is no native library", remedy="pip install .", code="native-library")
        return self.handle

    def fits(self, width: int) -> bool:
        """True if so many columns fit side by side."""
        return self.arrays.registers * width <= 65_536

    def __call__(self, x: Array, out: Array | None = None) -> Array:
        """The outputs (outputs, n) of inputs (inputs, n), of any strides; or (outputs,) of (inputs,)."""
        x = np.asarray(x, dtype=float)
        if len(x) != self.inputs:
            raise TwolinkError(f"a program of {self.inputs} inputs got {len(x)}", code="native-library")
        if x.ndim == 1:
            return self._of_one(x)
        if out is None:
            out = np.empty((self.outputs, x.shape[1]))
        self.run([x.T], [out.T])
        return out

    def run(self, inputs: Sequence[Array], outputs: Sequence[Array], width: int | None = None) -> None:
        """Write the outputs (n, size) for inputs (n, size) each, float64 of any strides, that follow each other.

        width: how many columns run side by side; by default as many as pay.
        """
        inputs = [a if a.flags.aligned else np.array(a) for a in inputs]  # the library counts strides in doubles
        if self.handle is None:
            x = np.concatenate([a.T for a in inputs]) if len(inputs) > 1 else inputs[0].T
            found, begin = _by_numpy(self.arrays, self._constants, self._constant_at, x), 0
            for out in outputs:
                out.T[:] = found[begin : begin + out.shape[1]]
                begin += out.shape[1]
            return
        count = len(inputs[0])
        pool = self._pool(width or widest([self], count, WIDTHS[0] if count > WIDE else MANY))
        registers = pool.take()
        try:
            code = library().tl_columns(
                self.handle.value, level(), registers.width, registers.handle.value, count, len(inputs),
                _blocks(inputs), len(outputs), _blocks(outputs),
            )  # fmt: skip
        finally:
            pool.give(registers)
        require(code, "a program")

    def _of_one(self, x: Array) -> Array:
        """The outputs of one column, through memory that is at hand: converting arrays takes longer than computing."""
        if self.handle is None:
            return _by_numpy(self.arrays, self._constants, self._constant_at, x[:, None])[:, 0]
        pool = self._pool(ALONE)
        registers = pool.take()
        try:
            registers.x[:] = x
            library().tl_columns(*registers.arguments)
            return np.asarray(registers.y.copy())
        finally:
            pool.give(registers)

    def _pool(self, width: int) -> Pool:
        """Registers of this width."""
        return self._pools.get(width) or self._pools.setdefault(width, Pool(functools.partial(_Registers, self, width)))


def widest(programs: Sequence[Program], columns: int, most: int = MANY) -> int:
    """The width at which programs run side by side on so many columns."""
    wanted = ALONE if columns == 1 else FEW if columns <= FEW else most
    return next(width for width in WIDTHS if width <= wanted and all(one.fits(width) for one in programs))


class _Block(ctypes.Structure):
    """tl_block of native/program.h."""

    _fields_ = (("at", ctypes.c_void_p), *((name, ctypes.c_int64) for name in ("row", "column", "size")))


def _blocks(arrays: Sequence[Array]) -> Any:
    """Arrays (n, size) as blocks of the library."""
    blocks = ((a.ctypes.data, a.strides[1] // 8, a.strides[0] // 8, a.shape[1]) for a in arrays)
    return (_Block * len(arrays))(*(_Block(*block) for block in blocks))


class SmallBatch:
    """Memory for so many columns of a program, through which calls take less time than by converting arrays.

    inputs: arrays (rows, size), which follow each other as the program's inputs; outputs: the same.
    """

    def __init__(self, program: Program, rows: int, inputs: Sequence[int], outputs: Sequence[int]) -> None:
        self.inputs = [np.empty((rows, size)) for size in inputs]
        self.outputs = [np.empty((rows, size)) for size in outputs]
        self._program, self._registers = program, _Registers(program, widest([program], rows))  # which do not keep it
        program_at, lanes = self._registers.arguments[:2]
        # as ctypes' own objects, which take half the time of converting them at each call
        self._before = (ctypes.c_void_p(program_at), ctypes.c_int(lanes), ctypes.c_int(self._registers.width),
                        ctypes.c_void_p(self._registers.handle.value))  # fmt: skip
        self._after = (ctypes.c_int(len(inputs)), _blocks(self.inputs), ctypes.c_int(len(outputs)),
                       _blocks(self.outputs))  # fmt: skip
        self._call = library().tl_columns

    def run(self, count: int) -> None:
        """Compute the first `count` rows."""
        require(self._call(*self._before, count, *self._after), "a program")


class _Registers:
    """Registers of a program, and memory for one column with the arguments of its call."""

    def __init__(self, program: Program, width: int) -> None:
        handle = program.require_handle()
        self.handle = Handle(library().tl_registers_new(handle.value, width), library().tl_registers_free)
        self.width, self.x, self.y = width, np.empty(program.inputs), np.empty(program.outputs)
        blocks = _blocks([self.x[None]]), 1, _blocks([self.y[None]])
        self.arguments = (handle.value, level(), width, self.handle.value, 1, 1, *blocks)


def _by_numpy(arrays: Assembled, constants: Array, constant_at: Array, x: Array) -> Array:
    """The outputs of a program by NumPy, instruction by instruction: the referee of the native library."""
    registers: list[Any] = [None] * arrays.registers
    registers[: len(x)] = list(x)
    for place, value in zip(constant_at.tolist(), constants.tolist(), strict=True):
        registers[place] = np.full(x.shape[1], value)
    scalars = arrays.scalars.tolist()
    with np.errstate(all="ignore"):
        for what, row in _instructions(arrays.code.tolist()):
            if what == "SINCOS":
                registers[row[0]], registers[row[2]] = np.sin(registers[row[1]]), np.cos(registers[row[1]])
                continue
            operands = [scalars[i] if k == 1 and what in WITH_SCALAR else registers[i]
                        for k, i in enumerate(row[1 : 1 + _operands(what)])]  # fmt: skip
            registers[row[0]] = _NUMPY[what](*operands)
    return np.array([registers[i] for i in arrays.output_at]).reshape(len(arrays.output_at), x.shape[1])


def _operands(what: str) -> int:
    """The number of operands of an operation."""
    function = _NUMPY[what]
    return function.nin if isinstance(function, np.ufunc) else function.__code__.co_argcount


def _instructions(code: list[int]) -> Iterator[tuple[str, list[int]]]:
    """The instructions of a code: operation and places."""
    at = 0
    while at < len(code):
        what, begin = OPERATIONS[code[at]], at + 4
        width = 4 * QUADS.get(what, 1)
        at = begin + width * code[at + 1]
        for place in range(begin, at, width):
            yield what, code[place : place + width]
