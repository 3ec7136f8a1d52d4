"""Random formulas of every operation, and their values by NumPy from the tape's list of operations alone."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from twolink.algorithms.tape import Symbol, Tape

Array = np.ndarray[Any, np.dtype[Any]]
NUMPY: dict[str, Callable[..., Any]] = {
    "+": np.add, "-": np.subtract, "*": np.multiply, "/": np.divide, "neg": np.negative, "sin": np.sin, "cos": np.cos,
    "sqrt": np.sqrt, "exp": np.exp, "tanh": np.tanh, "atan2": np.arctan2, "power": np.power,
    "less": lambda a, b: np.where(a < b, 1.0, 0.0), "less_equal": lambda a, b: np.where(a <= b, 1.0, 0.0),
    "where": lambda a, b, c: np.where(a != 0.0, b, c),
}  # fmt: skip
OPERATIONS = tuple(NUMPY)
KINKS = ("less", "less_equal", "where")
INPUTS, LENGTH, OUTPUTS = 6, 120, 9


def random_tape(seed: int, *, smooth: bool = False) -> tuple[Tape, Sequence[Symbol], list[Any]]:
    """A tape, its inputs and some outputs. smooth: without kinks, and of numbers that stay small."""
    random, tape = np.random.default_rng(seed), Tape()
    inputs = list(tape.variables(INPUTS))
    known: list[Any] = [*inputs, 0.5, -1.25]
    kinds = [what for what in OPERATIONS if not (smooth and what in KINKS)]
    # Sums of products most often, as in dynamics: they are what is fused.
    weights = np.array([8.0 if what in "+-*" else 1.0 for what in kinds])
    for _ in range(LENGTH):
        what = str(random.choice(kinds, p=weights / weights.sum()))
        recent = known[-12:] if random.random() < 0.7 else known
        a, b, c = (recent[i] for i in random.integers(len(recent), size=3))
        known.append(_made(tape, what, a, b, c))
    outputs = [known[i] for i in random.integers(len(known) - 30, len(known), size=OUTPUTS - 1)]
    return tape, inputs, [*outputs, 2.5]


def _made(tape: Tape, what: str, a: Any, b: Any, c: Any) -> Any:
    """The symbol of an operation, with operands that keep numbers moderate."""
    if not any(isinstance(x, Symbol) for x in (a, b, c)):
        return a
    match what:
        case "+":
            return 0.5 * a + 0.5 * b
        case "-":
            return a * c - 0.25 * b
        case "*":
            return tape.tanh(a) * b if isinstance(a, Symbol) else a * b
        case "/":
            return a / (1.5 + b * b)
        case "neg":
            return -a
        case "sqrt" | "power":
            positive = 1.0 + a * a
            if not isinstance(positive, Symbol):
                return positive
            return tape.sqrt(positive) if what == "sqrt" else tape.power(positive, -0.75)
        case "sin" | "cos" | "exp" | "tanh":
            x = a if isinstance(a, Symbol) else b if isinstance(b, Symbol) else c
            return getattr(tape, what)(tape.tanh(x) if what == "exp" else x)
        case "atan2":
            return tape.atan2(a, 2.0 + b * b)
        case "where":
            return tape.where(tape.less(a, b), c, b)
    return getattr(tape, what)(a, b)


def evaluated(tape: Tape, inputs: Sequence[Any], outputs: Sequence[Any], x: Array) -> Array:
    """The outputs (m, n) of inputs (k, n)."""
    values: dict[int, Any] = {symbol.key: row for symbol, row in zip(inputs, x, strict=True)}
    with np.errstate(all="ignore"):
        for key in tape.needed(outputs):
            what, *operands = tape.operations[key]
            values[key] = NUMPY[what](*(values[k] if type(k) is int else k for k in operands))
    found = [values[y.key] if isinstance(y, Symbol) else float(y) for y in outputs]
    return np.array([np.broadcast_to(y, x.shape[1]) for y in found])
