"""Copies of functions with all that they remember, for a look at what hidden memory does to their answers.

`copy.deepcopy` gives a function back as it is. Here its closure, defaults, attributes and the globals that it names are
copied too. What cannot be copied, such as a generator, raises what copy.deepcopy raises.

What laws may change and no copy holds is watched: attributes of classes, names of modules, variables of the context.
They are not a solution's own, and may act in the next one where they change no answer in this one.
"""

import builtins
import contextvars
import copy
import functools
import sys
import sysconfig
import types
from collections.abc import Iterable, Iterator
from typing import Any

_INSTALLED = tuple(sysconfig.get_paths()[name] for name in ("purelib", "platlib"))
_Cached = type(functools.lru_cache(lambda: None))
_SHARED = types.ModuleType, type, types.BuiltinFunctionType


def copied(x: Any, memo: dict[int, Any]) -> Any:
    """A copy of a function, with what it remembers, or of anything else, as copy.deepcopy.

    memo: one for all things that may share what they remember, at first empty.
    """
    if id(x) in memo:
        return memo[id(x)]
    if isinstance(x, types.FunctionType):
        return _function(x, memo) if is_a_users(x) else x
    if isinstance(x, functools.partial):
        arguments, names = [copied(one, memo) for one in x.args], {k: copied(v, memo) for k, v in x.keywords.items()}
        return functools.partial(copied(x.func, memo), *arguments, **names)
    if isinstance(x, _Cached):
        return functools.lru_cache(**x.cache_parameters())(copied(x.__wrapped__, memo))
    for one in vars(x).values() if hasattr(x, "__dict__") and not isinstance(x, type) else ():
        if isinstance(one, types.FunctionType | _Cached):  # which deepcopy would not copy
            memo[id(one)] = copied(one, memo)
    return copy.deepcopy(x, memo)


def is_a_users(x: types.FunctionType | type) -> bool:
    """True if a function or class is not Python's own, ours, or an installed package's."""
    module = x.__module__ or ""
    top, file = module.partition(".")[0], getattr(sys.modules.get(module), "__file__", None)
    others = {*sys.stdlib_module_names, "twolink"} - {"__main__"}
    return not (top in others or top.startswith("_cython") or str(file).startswith(_INSTALLED))


def named_globals(function: types.FunctionType) -> dict[str, Any]:
    """The globals that the code of a function names, also in functions within it."""
    return {name: function.__globals__[name] for name in _names(function.__code__) if name in function.__globals__}


def _names(code: types.CodeType) -> set[str]:
    return set(code.co_names).union(*(_names(one) for one in code.co_consts if isinstance(one, types.CodeType)))


def _function(one: types.FunctionType, memo: dict[int, Any]) -> types.FunctionType:
    cells = tuple(memo.setdefault(id(cell), types.CellType()) for cell in one.__closure__ or ())
    known = memo.setdefault(id(one.__globals__), {"__builtins__": builtins, "__name__": one.__module__})
    new = memo[id(one)] = types.FunctionType(one.__code__, known, one.__name__, None, cells)
    memo.setdefault(id(memo), []).append(one)  # as deepcopy does: what is gone could lend its id
    for cell, source in zip(cells, one.__closure__ or (), strict=True):
        if _is_empty(cell) and not _is_empty(source):
            cell.cell_contents = _inside(source.cell_contents, memo)
    for name, value in named_globals(one).items():
        if name not in known:
            known[name] = _inside(value, memo)
    new.__defaults__ = one.__defaults__ and tuple(_inside(value, memo) for value in one.__defaults__)
    new.__kwdefaults__ = one.__kwdefaults__ and {k: _inside(v, memo) for k, v in one.__kwdefaults__.items()}
    new.__dict__.update({name: _inside(value, memo) for name, value in one.__dict__.items()})
    new.__qualname__, new.__module__ = one.__qualname__, one.__module__
    return new


def _inside(x: Any, memo: dict[int, Any]) -> Any:
    """A copy of what a function refers to; not of modules, classes and compiled functions."""
    return x if isinstance(x, _SHARED) else copied(x, memo)


def _is_empty(cell: types.CellType) -> bool:
    try:
        _ = cell.cell_contents
    except ValueError:
        return True
    return False


Place = tuple[dict[str, Any], str, str]  # a namespace, a name in it, and what both are called


class Watched:
    """The present attributes of the classes and modules of laws, and the context."""

    def __init__(self, laws: Iterable[Any]) -> None:
        self._known: set[int] = set()
        self._values = [(place, place[0].get(place[1]), _as_now(place[0].get(place[1])))
                        for law in laws for place in self._places(law)]  # fmt: skip
        self._context = dict(contextvars.copy_context().items())

    def changed(self) -> str:
        """The name of the first that is another one now; "": none."""
        for (names, name, called), value, before in self._values:
            if names.get(name) is not value or not _equal(value, before):
                return called
        for variable, value in contextvars.copy_context().items():
            if self._context.get(variable, self) is not value:
                return f"the context's {variable.name!r}"
        return ""

    def _places(self, x: Any) -> Iterator[Place]:
        """The attributes of the classes of a law, and those that its functions name."""
        if id(x) in self._known:
            return
        self._known.add(id(x))
        if isinstance(x, types.FunctionType):
            if not is_a_users(x):
                return
            for cell in x.__closure__ or ():
                yield from self._places(_content(cell))
            for value in named_globals(x).values():
                if isinstance(value, types.FunctionType | type):
                    yield from self._places(value)
        elif isinstance(x, types.MethodType):
            yield from self._places(x.__self__)
        elif isinstance(x, type):
            if is_a_users(x):
                for name, value in vars(x).items():
                    if isinstance(value, types.FunctionType):
                        yield from self._places(value)
                    elif not name.startswith(("__", "_abc_")):
                        yield vars(x), name, f"{x.__name__}.{name}"  # type: ignore[misc]
        elif not isinstance(x, types.ModuleType):
            for kind in type(x).__mro__:
                yield from self._places(kind)


def _content(cell: types.CellType) -> Any:
    try:
        return cell.cell_contents
    except ValueError:  # not yet bound
        return None


def _as_now(x: Any) -> Any:
    """A copy, or a text where there is none."""
    try:
        return copy.deepcopy(x)
    except Exception:  # of a user's own class any
        return repr(x)


def _equal(one: Any, other: Any) -> bool:
    try:
        return bool(one == other)
    except Exception:  # arrays and a user's own classes
        return repr(one) == repr(other)
