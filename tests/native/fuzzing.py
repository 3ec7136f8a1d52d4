"""Calls of the native library with arguments that are wrong: run as a process, which a crash ends.

    python -m tests.native.fuzzing SEED COUNT

Prints, by entry, how many calls were refused and how many were fine.
"""

import collections
import ctypes
import sys
from typing import Any

import numpy as np

from tests.native.tapes import random_tape
from twolink.algorithms.tape import Tape
from twolink.native.library import OUTCOMES, library
from twolink.native.machine import WIDTHS, Program, assembled

WHOLE = (0, 1, -1, 2, 5, 16, 17, 255, 65_535, 65_536, 2**31 - 1, -(2**31))
LONG = (*WHOLE, 2**32, 2**40, 2**62, 2**63 - 1, -(2**63))
NUMBERS = (0.0, -0.0, 1.0, -1.0, np.nan, np.inf, -np.inf, 1e308, -1e308, 5e-324, 1e17)


class Calls:
    """Calls of the library, and what came of them. refused: codes. counting: entries that give what was made."""

    refused, counting = range(1, 5), ("tl_attempts", "tl_ticks")

    def __init__(self, seed: int) -> None:
        self.random, self.c, self.seen = np.random.default_rng(seed), library(), collections.Counter[str]()

    def nothing(self) -> None:
        """Null where an object is expected."""

    def once(self) -> None:
        """A call of each kind."""

    def note(self, entry: str, code: int) -> None:
        """Count an outcome, which is a code of the table or what an entry gives."""
        counts = entry in self.counting
        fine = code >= 0 if counts else code == 0
        assert fine or (-code in range(1, len(OUTCOMES)) if counts else code in self.refused), (entry, code)
        self.seen[f"{entry} {'fine' if fine else 'refused'}"] += 1

    def tell(self, count: int) -> None:
        """Make so many calls of each kind."""
        self.nothing()
        for _ in range(count):
            self.once()
        for name, times in sorted(self.seen.items()):
            print(name, times)


class Fuzzer(Calls):
    """Sound arguments of each entry, of which some are made wrong."""

    def __init__(self, seed: int) -> None:
        super().__init__(seed)
        tape, inputs, outputs = random_tape(seed)
        self.one = assembled(tape, inputs, outputs)
        self.arrays = [np.ascontiguousarray(a) for a in (
            self.one.code, self.one.scalars, self.one.constant_at, self.one.constants, self.one.output_at)]  # fmt: skip
        made = ctypes.c_void_p()
        assert self.c.tl_program_new(*self.arguments_of_program(), ctypes.byref(made)) == 0
        self.program, self.made = made.value, ctypes.c_void_p()

    def arguments_of_program(self) -> list[Any]:
        """Those of tl_program_new, sound."""
        code, scalars, constant_at, constants, output_at = self.arrays
        return [self.one.inputs, len(output_at), self.one.registers, len(code) // 4, code.ctypes.data, len(scalars),
                scalars.ctypes.data, len(constants), constant_at.ctypes.data, constants.ctypes.data,
                output_at.ctypes.data]  # fmt: skip

    def wrong(self, values: list[Any], wholes: dict[int, Any], pointers: tuple[int, ...]) -> list[Any]:
        """One or two of the values made wrong: whole numbers, or pointers that are null."""
        out, places = list(values), [*wholes, *pointers]
        for at in self.random.choice(places, size=self.random.integers(1, 3)).tolist():
            out[at] = None if at in pointers else int(self.random.choice(wholes[at]))
        return out

    def once(self) -> None:
        """A program, columns, and a method with attempts and ticks."""
        self.programs()
        self.columns(self.program, self.one.inputs, len(self.arrays[4]))
        self.methods()

    def programs(self) -> None:
        """Codes of random numbers, and lengths that are too small, below 0 or too large to be."""
        keep = self.arrays[0].copy()
        code = self.arrays[0]
        for at in self.random.integers(len(code), size=self.random.integers(0, 4)):
            code[at] = self.random.integers(0, 65_536)
        sound = self.arguments_of_program()
        # A length above the true one tells the library to read what is not there: only shorter ones are tried.
        less = tuple(v for v in WHOLE if v <= 0)
        impossible = (*less, 2**31 - 1)
        wholes = {0: WHOLE, 1: less, 2: WHOLE, 3: (-1, 0, 1, 2**62, -(2**63), 2**33), 5: (*less, 65_536), 7: impossible}
        values = self.wrong(sound, wholes, (4, 6, 8, 9, 10)) if self.random.random() < 0.7 else sound
        if values[7] > values[2]:
            values[7] = 2**31 - 1
        made = ctypes.c_void_p()
        self.note("tl_program_new", code_of := self.c.tl_program_new(*values, ctypes.byref(made)))
        if code_of == 0:
            self.columns(made.value, values[0], values[1])
            self.c.tl_program_free(made)
        assert self.c.tl_program_new(*sound, None) in self.refused
        self.arrays[0][:] = keep

    def columns(self, program: Any, inputs: int, outputs: int) -> None:
        """Numbers of every kind, counts, widths, levels, and blocks of other sizes."""
        if not 0 <= inputs <= 64:
            return
        count, width = int(self.random.integers(0, 40)), int(self.random.choice(WIDTHS))
        registers = self.c.tl_registers_new(program, width)
        if not registers:
            return
        x = self.random.choice(NUMBERS, size=(max(count, 1), inputs))
        y = np.empty((max(count, 1), outputs))
        blocks = [_block(x), _block(y)]
        if self.random.random() < 0.3:
            blocks[int(self.random.integers(2))].size = int(self.random.choice([-1, 2**62, 2**63 - 1, 1000]))
        values = [program, 0, width, registers, count, 1, blocks[0], 1, blocks[1]]
        pointers = (0, 3, 6, 8)
        for at, value in enumerate(values):
            if at in pointers and not isinstance(value, int):
                values[at] = ctypes.addressof(value)
        wholes = {1: WHOLE[2:], 2: WHOLE, 4: (0, -1, -(2**63), 2**62, 2**63 - 1), 5: (-1, 0), 7: (-1, 0)}
        if self.random.random() < 0.7:
            values = self.wrong(values, wholes, pointers)
        self.note("tl_columns", self.c.tl_columns(*values))
        self.c.tl_registers_free(registers)

    def methods(self) -> None:
        """Sizes of every kind of a method, and attempts of what is made of them."""
        tape, inputs, _ = random_tape(int(self.random.integers(1000)))
        size, parameters = 3, len(inputs) - 4
        rate = assembled(tape, inputs, [inputs[2], inputs[3] * inputs[1], inputs[1] - inputs[3]])
        made, method = ctypes.c_void_p(), ctypes.c_void_p()
        arrays = [np.ascontiguousarray(a) for a in (
            rate.code, rate.scalars, rate.constant_at, rate.constants, rate.output_at)]  # fmt: skip
        assert self.c.tl_program_new(rate.inputs, 3, rate.registers, len(rate.code) // 4, arrays[0].ctypes.data,
                                     len(rate.scalars), arrays[1].ctypes.data, len(rate.constants),
                                     *(a.ctypes.data for a in arrays[2:]), ctypes.byref(made)) == 0  # fmt: skip
        sizes = np.array([size, size, parameters, 0, 1, 2, 1, 2, 0, 1, 0], dtype=np.int32)
        tableau, absolute = np.array([0.0, 0, 1, 0, 0.5, 0.5, 0, 1, -0.5, 0.5]), np.zeros(size, dtype=np.uint8)
        joints, entries = np.array([0, 1, 1, 3], dtype=np.int32), np.zeros(2, dtype=np.int32)
        if self.random.random() < 0.7:
            # Stages, errors, joints and entries say how long the arrays are: more than there are only if impossible.
            chosen = int(self.random.integers(11))
            lengths = {5: (-1, 0, 1, 17, 2**31 - 1), 6: (-1, 0, 3), 9: (-1, 0, 2**31 - 1), 10: (-1, 1, 2**31 - 1)}
            sizes[chosen] = self.random.choice(lengths.get(chosen, WHOLE))
            joints[self.random.integers(4)] = self.random.choice(WHOLE)
        values = [made.value, None, None, *(a.ctypes.data for a in (sizes, tableau, absolute, joints, entries))]
        if self.random.random() < 0.3:
            values[int(self.random.choice([0, 3, 4, 5, 6]))] = None
        self.note("tl_method_new", code := self.c.tl_method_new(*values, ctypes.byref(method)))
        if code == 0:
            self.attempts(method.value, int(sizes[0]), int(sizes[1]), int(sizes[2]))
            self.c.tl_method_free(method)
        self.c.tl_program_free(made)

    def attempts(self, method: Any, size: int, moving: int, parameters: int) -> None:
        """States of every kind, counts, and disturbances that begin or repeat nowhere."""
        from twolink.native.stepper import Disturbances  # its structure

        width, columns, count = int(self.random.choice(WIDTHS)), int(self.random.integers(1, 20)), 3
        assert not self.c.tl_workspace_new(method, 3)
        assert not self.c.tl_workspace_new(None, width)
        work = self.c.tl_workspace_new(method, width)
        states = np.zeros((count + 1, size + 10 + parameters, columns))
        states[0] = self.random.choice(NUMBERS, size=states[0].shape)
        table = self.random.uniform(-1, 1, (4, moving))
        first = self.random.choice([0, 1, 5, -1, -(2**63), 2**63 - 1], size=columns)
        if self.random.random() < 0.7:
            states[0] = self.random.uniform(0.0, 0.1, states[0].shape)
            states[0, size + 6] = 1.0  # the end
            first = np.abs(first) % 7
        parts = [0, 1, 1, moving]
        if self.random.random() < 0.3:
            parts[int(self.random.integers(4))] = int(self.random.choice(WHOLE))
        ones = np.ones(columns)
        one = Disturbances(table, ones, ones, first, np.ones((moving, columns)), tuple(parts), 0.1,
                           self.random.choice([0.0, 1.0, np.nan], size=columns))  # fmt: skip
        pointer = ctypes.addressof(one.pointer) if self.random.random() < 0.7 else None
        values = [work, 0, columns, count, 2, states.ctypes.data, pointer]
        wholes = {1: WHOLE[2:], 2: (0, -1, -(2**63), 2**62), 3: (0, -1, 2**62, 2**63 - 1), 4: (0, -1, -(2**63))}
        if self.random.random() < 0.5:
            values = self.wrong(values, wholes, (0, 5))
        self.note("tl_attempts", int(self.c.tl_attempts(*values)))
        self.ticks(work, width, columns, states, size)
        self.c.tl_workspace_free(work)

    def ticks(self, work: Any, width: int, columns: int, states: np.ndarray, size: int) -> None:
        """Laws whose rows, numbers and records are not there, and ticks at times of every kind."""
        from twolink.native.ticks import _Call, _Law  # its structure

        count, kept, places = 3, int(self.random.integers(0, 3)), np.repeat(states[:1], 21, axis=0)
        tape = Tape()
        x = tape.variables(3 + kept)
        one = Program(assembled(tape, x, [*(x[0] * x[-1] for _ in range(kept)), 0.0]))
        registers = self.c.tl_registers_new(one.require_handle().value, width)
        rows = self.random.choice([0, size - 1], size=2).astype(np.int32)
        times = np.sort(self.random.uniform(0.0, 0.1, count + 1))
        if self.random.random() < 0.3:
            rows[0] = self.random.choice([size, -1, 2**31 - 1])
            times = self.random.choice(NUMBERS, count + 1)
        places[0, size + 1] = 1.0  # long steps
        records = [rows, rows, np.ones(1), times, np.empty((count, 0, columns)), np.zeros((count + 1, kept, columns)),
                   np.zeros(1), np.empty(count, dtype=np.int64)]  # fmt: skip
        handle = one.require_handle().value
        fields = [handle, registers, *(a.ctypes.data for a in records), 0, kept, count, 0]
        wholes = {10: (-1, 2, 2**62), 11: (-1, kept + 1, 2**62), 12: (0, -1, -(2**63), 2**63 - 1)}
        if self.random.random() < 0.5:
            fields = self.wrong(fields, wholes, tuple(range(10)))
        law = ctypes.addressof(kept_law := _Law(*fields, _Call()))
        values = work, 0, columns, len(places) - 1, places.ctypes.data, None, law
        self.note("tl_ticks", int(self.c.tl_ticks(*values)))
        assert 0 <= kept_law.done <= max(0, fields[12]) or not self.seen["tl_ticks fine"]
        self.c.tl_registers_free(registers)

    def nothing(self) -> None:
        """Null where an object is expected, and widths and programs that do not belong together."""
        c = self.c
        for free in (c.tl_program_free, c.tl_registers_free, c.tl_method_free, c.tl_workspace_free):
            free(None)
        for width in WHOLE:
            assert c.tl_fits(None, width) == 0
            assert not c.tl_registers_new(None, width)
            assert bool(c.tl_registers_new(self.program, width)) == (width in WIDTHS) or width in WIDTHS
        x = np.zeros((40, self.one.inputs))
        y = np.zeros((40, len(self.arrays[4])))
        blocks = [ctypes.addressof(block) for block in (_block(x), _block(y))]
        narrow = c.tl_registers_new(self.program, 1)
        assert (
            c.tl_columns(self.program, 0, 8, narrow, 40, 1, blocks[0], 1, blocks[1]) in self.refused
        )  # of another width
        c.tl_registers_free(narrow)


def _block(a: np.ndarray) -> Any:
    """An array (n, size) as a block of the library."""
    from twolink.native.machine import _Block

    return _Block(a.ctypes.data, a.strides[1] // 8, a.strides[0] // 8, a.shape[1])


if __name__ == "__main__":
    Fuzzer(int(sys.argv[1])).tell(int(sys.argv[2]))
