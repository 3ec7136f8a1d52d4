"""Derivatives of what is on a tape, on the same tape: forward, with only the entries that are not the constant 0."""

from collections.abc import Iterable, Sequence
from typing import Any

from twolink.algorithms.tape import Symbol, Tape, collection_paused

Derivatives = dict[int, Any]  # by the number of the variable


@collection_paused()
def jacobian(tape: Tape, outputs: Sequence[Any], variables: Iterable[Any]) -> tuple[list[tuple[int, int]], list[Any]]:
    """The places (row, column) and the values, symbols or constants, of d outputs / d variables that are not 0.

    Kinks have the derivative of the side that is taken.
    """
    column = {x.key: i for i, x in enumerate(variables)}
    known: dict[int, Derivatives] = {key: {key: 1.0} for key in column}
    needed = tape.needed(outputs)
    symbols = {key: Symbol(tape, key) for key in (*column, *needed)}
    for key in needed:
        what, *operands = tape.operations[key]
        x = [symbols.get(k, Symbol(tape, k)) if type(k) is int else k for k in operands]
        parts = [known.get(k, {}) if type(k) is int else {} for k in operands]
        if any(parts):
            known[key] = _derivatives(tape, what, x, parts, symbols[key])
    places, values = [], []
    for row, output in enumerate(outputs):
        for key, value in sorted(known.get(output.key, {}).items() if isinstance(output, Symbol) else ()):
            if not (isinstance(value, float) and value == 0.0):
                places.append((row, column[key]))
                values.append(value)
    return places, values


def _derivatives(tape: Tape, what: str, x: list[Any], parts: list[Derivatives], made: Symbol) -> Derivatives:
    """Derivatives of one operation, from those of its operands."""
    if what in ("less", "less_equal"):
        return {}
    if what == "where":
        keys = dict.fromkeys((*parts[1], *parts[2]))
        return {k: tape.where(x[0], parts[1].get(k, 0.0), parts[2].get(k, 0.0)) for k in keys}
    out: Derivatives = {}
    for own, slope in zip(parts, _slopes(tape, what, x, made), strict=False):
        if own:
            value = slope()
            for key, derivative in own.items():
                term = _times(value, derivative)
                out[key] = term if key not in out else out[key] + term
    return out


def _slopes(tape: Tape, what: str, x: list[Any], made: Symbol) -> list[Any]:
    """Functions that give d made / d operand, each made only where it is asked for."""
    match what:
        case "+":
            return [lambda: 1.0, lambda: 1.0]
        case "-":
            return [lambda: 1.0, lambda: -1.0]
        case "*":
            return [lambda: x[1], lambda: x[0]]
        case "/":
            return [lambda: 1.0 / x[1], lambda: -(made / x[1])]
        case "neg":
            return [lambda: -1.0]
        case "sin":
            return [lambda: tape.cos(x[0])]
        case "cos":
            return [lambda: -tape.sin(x[0])]
        case "sqrt":
            return [lambda: 0.5 / made]
        case "exp":
            return [lambda: made]
        case "tanh":
            return [lambda: 1.0 - made * made]
        case "power":
            return [lambda: tape.power(x[0], x[1] - 1.0) * x[1]]
        case "atan2":
            return [lambda: x[1] / (x[0] * x[0] + x[1] * x[1]), lambda: -x[0] / (x[0] * x[0] + x[1] * x[1])]
    raise ValueError(f"{what!r} has no derivative")


def _times(a: Any, b: Any) -> Any:
    """a b; a factor of 1 leaves no operation, of -1 a sign."""
    for one, other in ((a, b), (b, a)):
        if isinstance(one, float) and abs(one) == 1.0:
            return other if one > 0 else -other
    return a * b
