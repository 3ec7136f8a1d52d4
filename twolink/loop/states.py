"""States of laws as numbers: those of floats and arrays in tuples, lists and dicts."""

import itertools
from collections.abc import Iterator
from typing import Any

import numpy as np

Array = np.ndarray[Any, np.dtype[Any]]


class UntracedError(Exception):
    """The reason why a law is not traced. No user sees it: it stays Python."""


def leaves_of(state: Any) -> list[Any]:
    """The numbers and arrays of a state, in tuples, lists and dicts. Raises UntracedError for what else it has."""
    if state is None:
        return []
    if isinstance(state, (tuple, list)):
        return [*itertools.chain(*map(leaves_of, state))]
    if isinstance(state, dict):
        return [*itertools.chain(*map(leaves_of, state.values()))]
    if type(state) in (int, float, np.float64) or hasattr(type(state), "entries"):  # a traced array
        return [state]
    if isinstance(state, np.ndarray) and state.dtype.kind in "fiO":
        return [state]
    raise UntracedError(f"a state with a {type(state).__name__}")


def rebuilt(state: Any, leaves: Iterator[Any]) -> Any:
    """A state of the same form with other numbers."""
    if state is None:
        return None
    if isinstance(state, dict):
        return {name: rebuilt(one, leaves) for name, one in state.items()}
    if isinstance(state, (tuple, list)):
        parts = [rebuilt(one, leaves) for one in state]
        return type(state)(*parts) if hasattr(state, "_fields") else type(state)(parts)
    return next(leaves)


def numbers_of(state: Any) -> Array:
    """All numbers of a state (k,)."""
    return np.concatenate([np.zeros(0), *(np.ravel(one).astype(float) for one in leaves_of(state))])


def with_numbers(state: Any, numbers: Array) -> Any:
    """A state of the same form with these numbers (k,)."""
    found, begin = [], 0
    for leaf in leaves_of(state):
        part, begin = numbers[begin : begin + np.size(leaf)], begin + np.size(leaf)
        found.append(part.reshape(np.shape(leaf)).copy() if isinstance(leaf, np.ndarray) else type(leaf)(part[0]))
    return rebuilt(state, iter(found))


def stacked(state: Any, count: int) -> Any:
    """A state of the same form, whose arrays have so many rows of it, and whose numbers are columns of them."""
    leaves = (np.asarray(one) if isinstance(one, np.ndarray) else np.array([one]) for one in leaves_of(state))
    return rebuilt(state, (np.repeat(one[None], count, axis=0) for one in leaves))


def row_of(state: Any, i: int, like: Any) -> Any:
    """The state of one solution, of the form of `like`, from rows."""
    pairs = zip(leaves_of(state), leaves_of(like), strict=True)
    return rebuilt(like, (x[i].copy() if isinstance(one, np.ndarray) else type(one)(x[i, 0]) for x, one in pairs))
