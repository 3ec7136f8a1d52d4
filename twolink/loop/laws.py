"""Laws of controllers, of which every solution has its own, and their answers.

An object, or a method of one, is copied for each solution before its first call; the user's own is never called. A
class, or a functools.partial of one, makes a new object for each. All solutions call the same function. `Replay` finds
out where a law remembers what is not its solution's own: a function in its closure, any law in classes and modules.

States of laws are numbers: those of floats and arrays in tuples, lists and dicts.
"""

import copy
import functools
import itertools
import traceback
import types
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from twolink.effects.sampled_control import Controller
from twolink.errors import ControllerError, SceneError
from twolink.loop.copies import copied

Array = np.ndarray[Any, np.dtype[Any]]
Given = dict[str, Array]  # what a controller asked for (n, ...) by name
Copy = Callable[[Any, dict[int, Any]], Any]


@dataclass(eq=False)
class Own:
    """A solution's own part of a controller: the law that it calls, and the state."""

    law: Callable[..., Any]
    state: Any


def own_laws(controllers: Mapping[int, Controller], copy_of: Copy = copy.deepcopy) -> dict[int, Own]:
    """A new solution's own laws and states, by their controllers' places. Objects that they share stay in common."""
    memo: dict[int, Any] = {}
    laws = {}
    for place, one in controllers.items():
        law = _made(place, one.update) if is_made(one.update) else _copy(place, "update", one, copy_of, memo)
        laws[place] = Own(law, _copy(place, "state", one, copy.deepcopy, memo))
    return laws


def laws_apart(controllers: Mapping[int, Controller]) -> dict[int, Own]:
    """As `own_laws`, with copies of functions too, so that calls leave nothing behind in them."""
    return own_laws(controllers, copied)


def copied_laws(laws: Mapping[int, Own], controllers: Mapping[int, Controller]) -> dict[int, Own]:
    """Copies of laws of controllers, of functions too; those of classes are made anew."""
    memo: dict[int, Any] = {}
    made = {place: _made(place, one.update) for place, one in controllers.items() if is_made(one.update)}
    return {place: Own(made[place] if place in made else copied(one.law, memo), copy.deepcopy(one.state, memo))
            for place, one in laws.items()}  # fmt: skip


def is_made(update: Any) -> bool:
    """True if a controller has a class whose objects are laws, in place of a law."""
    return isinstance(update, type) or (isinstance(update, functools.partial) and isinstance(update.func, type))


def is_function(update: Any) -> bool:
    """True if the law is a function, which all solutions call."""
    while isinstance(update, functools.partial):
        update = update.func
    return isinstance(update, types.FunctionType)


def name_of(update: Any) -> str:
    """The name of a law in a text."""
    while isinstance(update, functools.partial):
        update = update.func
    return str(getattr(update, "__qualname__", type(update).__qualname__)).rpartition("<locals>.")[2]


def _made(place: int, update: Any) -> Any:
    try:
        law = update()
    except Exception as error:
        what = f"{name_of(update)}() raises {type(error).__name__}: {error}"
    else:
        if callable(law):
            return law
        what = f"objects of {name_of(update)} cannot be called"
    raise SceneError(what, where=f"effects[{place}].update", code="controller-not-made",
                          remedy="a class without arguments, or functools.partial of one, with "
                                 "__call__(self, t, y, state)")  # fmt: skip


def _copy(place: int, name: str, one: Controller, copy_of: Copy, memo: dict[int, Any]) -> Any:
    """A copy of a field of a controller. Raises SceneError, code "controller-not-copied"."""
    try:
        return copy_of(getattr(one, name), memo)
    except Exception as error:
        what = f"{name_of(one.update)} and what it refers to" if name == "update" else "it"
        raise SceneError(f"{what} cannot be copied: {type(error).__name__}: {error}", where=f"effects[{place}].{name}",
                         remedy="each solution needs its own: give a class, which is made anew for each, such as "
                                "functools.partial(Law, gain), in place of a function or an object",
                         code="controller-not-copied") from error  # fmt: skip


class Measured(SimpleNamespace):
    """The inputs that a controller asked for, by name: y.q or y["q"]."""

    def __getitem__(self, name: str) -> Any:
        return getattr(self, name)


def answer(place: int, joints: tuple[str, ...], own: Own, t: float, y: Measured, rows: int = 0) -> Array:
    """The torques u (m,) of a controller, by its place; its state becomes the new one. Raises ControllerError.

    rows: of how many solutions it is given, and must give, rows (rows, m); 0: it is given one solution's own.
    """
    try:
        returned = own.law(t, y, own.state)
    except Exception as error:
        raise failure(place, t, f"update raises {type(error).__name__}: {error}", code="controller-failed",
                      remedy='data["traceback"] says where; run is the motion so far',
                      traceback=traceback.format_exc()) from error  # fmt: skip
    count, what = len(joints), ""
    if isinstance(returned, tuple) and len(returned) == 2:
        try:
            u = np.asarray(returned[0], dtype=float)
        except (TypeError, ValueError):
            pass
        else:
            if u.shape == (rows, count) if rows else u.size == count and u.ndim < 2:
                own.state = returned[1]
                return u if u.ndim else u[None]
            what = f"u has the shape {u.shape}"
    what = what or f"update returns {returned!r:.80}"
    each = f" in each of {rows} rows" if rows else ""
    raise failure(place, t, what, remedy=f"return (u, state), u with {count} numbers{each}: {', '.join(joints)}",
                  code="controller-answer")  # fmt: skip


def failure(place: int, t: float, what: str, **parts: Any) -> ControllerError:
    """The error of a controller at a tick, by its place among the effects."""
    return ControllerError(what, where=f"effects[{place}] at t = {t:.9g} s", t=t, **parts)


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
