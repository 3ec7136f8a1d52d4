"""Copies of functions with all that they remember, for a look at what hidden memory does to their answers.

`copy.deepcopy` gives a function back as it is. Here its closure, defaults, attributes and the globals that it names are
copied too. What cannot be copied, such as a generator, raises what copy.deepcopy raises.
"""

import builtins
import copy
import functools
import sys
import sysconfig
import types
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
