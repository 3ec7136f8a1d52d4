"""Nanoseconds of an operation on this processor, measured once in a process on a formula like those of robots."""

import functools
import time
from typing import Any

import numpy as np

from twolink.algorithms.tape import Tape
from twolink.native.machine import ALONE, Program, trace

SIZE, ROUNDS = 12, 40  # numbers of the formula, and how often they are mixed: some hundred operations
BATCH, REPEATS = 1024, 5


@functools.cache
def nanoseconds_of_operation() -> tuple[float, float]:
    """(in a batch, alone): by the native library, or by NumPy without it."""
    found: list[Any] = [0]
    program = Program(trace(lambda x, tape: _mixed(x, tape, found), SIZE))
    x = np.random.default_rng(0).uniform(-1.0, 1.0, (BATCH, SIZE))
    few = BATCH if program.handle is not None else 1
    batch, alone = (_seconds(program, x[:count], width) / count for count, width in ((BATCH, None), (few, ALONE)))
    return 1e9 * batch / found[0], 1e9 * alone / found[0]


def _mixed(x: Any, tape: Tape, found: list[Any]) -> list[Any]:
    """Sums of products, as rotations have them; their number goes into `found`."""
    values = [*(tape.sin(one) for one in x[:2]), *x[2:]]
    for i in range(ROUNDS):
        a, b, c, d = (values[(i * k + k) % SIZE] for k in (1, 3, 5, 7))
        values[i % SIZE], values[(i + 4) % SIZE] = a * b - c * d, (a * c + b * d) * 0.5 + values[(i + 4) % SIZE]
        values[(i + 6) % SIZE] = values[(i + 6) % SIZE] * 0.5 + a
    found[0] = sum(tape.count(values).values())
    return values


def _seconds(program: Program, x: Any, width: int | None) -> float:
    """The least processor time of a call."""
    out, taken = np.empty((len(x), program.outputs)), []
    for _ in range(REPEATS):
        start = time.perf_counter()
        program.run([x], [out], width)
        taken.append(time.perf_counter() - start)
    return min(taken)
