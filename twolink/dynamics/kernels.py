"""Kernels: a function traced over a robot's constants as a program, and calling it on batches.

All checks of the values are traced into the program as one more output, the guard: a number that is finite if and only
if all inputs and outputs are finite, and quaternions and (cos, sin) pairs have length 1. A batch whose guard is not
finite is answered by Pinocchio, after a check of each value.
"""

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from twolink.algorithms.functions import Function
from twolink.algorithms.mechanism import mechanism
from twolink.algorithms.tape import Tape
from twolink.dynamics.threads import do_all, is_forked_child, is_shared, thread_count
from twolink.native.instructions import Assembled
from twolink.native.library import Pool
from twolink.native.machine import Program, SmallBatch, assembled
from twolink.robots.joint_layout import UNIT_TOLERANCE, joint_layouts

CHUNK = 4096  # states that a thread takes at once: a multiple of every vector's length
SHARED_FROM = 4_000_000  # operations in a batch from which threads that share its chunks pay
FEW_NUMBERS = 2**15  # in the memory of small batches, through which they go
SINE = 20  # operations of a sine or cosine


@dataclass(frozen=True)
class Kernel:
    """A traced function of states.

    sizes: entries of each argument, run-time parameters last, one each. arrays: of its program, whose last output is
    the guard. operations: counted in the formula.
    """

    name: str
    shape: tuple[int, ...]
    sizes: tuple[int, ...]
    arrays: Assembled
    operations: dict[str, int]

    @property
    def work(self) -> int:
        """Floating-point operations a state."""
        return _work(self.operations)

    @functools.cached_property
    def program(self) -> Program:
        """The program that runs."""
        return Program(self.arrays)

    @functools.cached_property
    def _small(self) -> Pool:
        """Memory for small batches, of each thread that makes one."""
        entries = math.prod(self.shape)
        return Pool(lambda: SmallBatch(self.program, self._few, self.sizes, (entries, 1)))

    @functools.cached_property
    def _few(self) -> int:
        """The number of states of a small batch, at most."""
        width = sum(self.sizes) + math.prod(self.shape) + 1
        return min(256, max(8, FEW_NUMBERS // width // 8 * 8))

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name not in ("program", "_small", "_few")}

    def __call__(self, arguments: Sequence[np.ndarray]) -> np.ndarray | None:
        """The results (n, *shape) for arguments (n, size) each; None when the guard is not finite.

        Where the memory of all arguments holds one state a column (transposed views), so does the result's.
        """
        count, entries = len(arguments[0]), math.prod(self.shape)
        columns = not arguments[0].flags.c_contiguous and all(map(_is_columns, arguments))
        if 0 < count <= self._few and not columns and self.program.handle is not None:
            return self._of_few(arguments, count)
        result = np.empty((entries, count)).T if columns else np.empty((count, entries))
        guard = np.empty((count, 1))
        if count * self.work < SHARED_FROM or is_forked_child() or is_shared():
            self.program.run(arguments, (result, guard))
        else:

            def evaluate(begin: int) -> None:
                part = slice(begin, begin + CHUNK)
                self.program.run([a[part] for a in arguments], (result[part], guard[part]))

            do_all(range(0, count, CHUNK), evaluate, thread_count())
        if not math.isfinite(guard.sum()):
            return None
        return result if len(self.shape) == 1 else result.reshape(count, *self.shape)

    def _of_few(self, arguments: Sequence[np.ndarray], count: int) -> np.ndarray | None:
        """As a call, for few states."""
        memory = self._small.take()
        try:
            result: np.ndarray = memory.outputs[0][:count]
            for into, values in zip(memory.inputs, arguments, strict=True):
                into[:count] = values
            memory.run(count)
            if not math.isfinite(sum(memory.outputs[1][:count].ravel().tolist())):
                return None
            return result.copy() if len(self.shape) == 1 else result.reshape(count, *self.shape).copy()
        finally:
            self._small.give(memory)


def _work(operations: Mapping[str, int]) -> int:
    return sum(n * (SINE if what in ("sin", "cos") else 1) for what, n in operations.items())


def _is_columns(a: np.ndarray) -> bool:
    return a.ndim == 2 and a.flags.f_contiguous and not (a.flags.c_contiguous and a.shape[1] > 1)


def build(model: pin.Model, function: Function, parameters: Sequence[str] = ()) -> Kernel:
    """Trace the function's cheapest variant over the model's constants.

    parameters: physical constants kept as run-time inputs (names: `mechanism.parameter_names`).
    """
    traced = [_traced(model, function, i, parameters) for i in function.candidates(mechanism(model))]
    counts = [tape.count(outputs) for tape, _, outputs in traced]
    best = min(range(len(traced)), key=lambda i: _work(counts[i]) + counts[i].get("*", 0))
    tape, inputs, outputs = traced[best]
    q = inputs[: function.arguments[0][1]]
    arrays = assembled(tape, inputs, [*outputs, _guard(tape, model, inputs, outputs, q)])
    sizes = (*(size for _, size in function.arguments), *(1 for _ in parameters))
    return Kernel(function.name, function.shape, sizes, arrays, counts[best])


def _traced(
    model: pin.Model, function: Function, variant: int, parameters: Sequence[str]
) -> tuple[Tape, list[Any], list[Any]]:
    """A variant on a tape: the tape, its inputs and its outputs."""
    tape = Tape()
    arguments = {name: list(tape.variables(size)) for name, size in function.arguments}
    constants = {name: tape.variable() for name in parameters}
    outputs = function.variants[variant](mechanism(model, constants), dict(arguments), tape)
    return tape, [*(x for values in arguments.values() for x in values), *constants.values()], outputs


def _guard(tape: Tape, model: pin.Model, inputs: Sequence[Any], outputs: Sequence[Any], q: Sequence[Any]) -> Any:
    """The guard: the sum of all inputs and outputs, or NaN where a condition fails."""
    total = sum(inputs[1:], inputs[0]) + sum(outputs)
    for joint in joint_layouts(model):
        if joint.normalized is not None:
            defect = sum(x * x for x in q[joint.normalized]) - 1.0
            total = tape.where(tape.less((2 * UNIT_TOLERANCE) ** 2, defect * defect), math.nan, total)
    return total
