"""Functions that are seen to remember nothing, by their code: they need not be called again to find out.

Such a function computes with its arguments, constants, arrays that nothing writes to, the modules math and numpy, a
robot, and functions of this kind. What is not known to be harmless is not plain; that costs time only.
"""

import builtins
import dis
import inspect
import math
import types
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from twolink.robots.model import RobotModel


def functions_of(module: Any, names: str) -> set[Any]:
    """The functions of these names."""
    return {getattr(module, name) for name in names.split()}


_BUILTINS = functions_of(
    builtins,
    "abs all any bool complex dict divmod enumerate float int isinstance len list max min pow range reversed round set "
    "sorted str sum tuple zip",
)
_NUMPY = functions_of(
    np,
    "array asarray atleast_1d zeros zeros_like ones ones_like full full_like eye identity diag arange linspace dot "
    "vdot inner outer cross einsum tensordot trace sum prod mean max min argmax argmin where clip concatenate stack "
    "vstack hstack column_stack interp round array_equal isclose allclose transpose reshape ravel nan_to_num any all "
    "float64 ndarray cumsum diff flip roll repeat tile squeeze expand_dims broadcast_to append copy atleast_2d",
)
_INPUTS: dict[Any, int] = {
    np.clip: 3,
    np.where: 3,
    np.interp: 5,
    np.linspace: 5,
    np.full: 4,
    np.roll: 3,
    np.array: 2,
}
_LINALG = functions_of(np.linalg, "norm solve inv pinv lstsq det cholesky eigvals")
_MODULES = math, np, np.linalg
_CONSTANT = type(None), bool, int, float, complex, str, bytes, np.generic, np.ufunc, RobotModel, type(Ellipsis)
_STORES = {"STORE_GLOBAL", "DELETE_GLOBAL", "STORE_ATTR", "DELETE_ATTR", "STORE_NAME", "LOAD_NAME", "IMPORT_NAME",
           "LOAD_BUILD_CLASS", "LOAD_FROM_DICT_OR_GLOBALS", "LOAD_LOCALS"}  # fmt: skip
_WRITES = {"fill", "put", "itemset", "sort", "partition", "resize", "setfield", "setflags", "byteswap", "append",
           "extend", "insert", "pop", "popitem", "remove", "clear", "update", "setdefault", "add", "discard", "reverse",
           "data", "ctypes", "flat", "real", "imag"}  # fmt: skip
_LATER = inspect.CO_GENERATOR | inspect.CO_COROUTINE | inspect.CO_ASYNC_GENERATOR
_PASSED = "CACHE", "PRECALL", "EXTENDED_ARG", "PUSH_NULL"
_NOTHING = object()
_UNKNOWN = open  # stands for a name that is not there: it is not harmless


def seen(update: Any, state: Any) -> "LawCode | None":
    """The code of a plain law; None of another. A class may say of its objects that they are `plain`."""
    found = LawCode()
    if getattr(type(update), "plain", False) is True:
        return found
    plain = found.plain(update) and not (found.arrays and found.writes) and LawCode().harmless(state)
    return found if plain else None


@dataclass
class LawCode:
    """The code of a law.

    arrays: whether functions refer to arrays, lists or dicts. writes: whether code may write to any. names: that the
    code has, and its operators. inputs: what functions take at most that write to none of them; np.sin(x, a) writes to
    a.
    """

    arrays: bool = False
    writes: bool = False
    inputs: int = 2
    names: set[str] = field(default_factory=set)
    known: set[int] = field(default_factory=set)

    def plain(self, one: Any) -> bool:
        """True if a function is plain, but for writing to what it refers to."""
        if not isinstance(one, types.FunctionType):
            return False
        if id(one) in self.known:
            return True
        self.known.add(id(one))
        try:
            cells = {name: cell.cell_contents for name, cell in zip(one.__code__.co_freevars, one.__closure__ or (),
                                                                    strict=True)}  # fmt: skip
        except ValueError:
            return False
        kept = (*(one.__defaults__ or ()), *(one.__kwdefaults__ or {}).values())
        return all(map(self.harmless, kept)) and self._code(one.__code__, cells, one.__globals__)

    def _code(self, code: types.CodeType, cells: dict[str, Any], known: dict[str, Any]) -> bool:
        """True if code is plain. cells: what its free variables are; known: its globals."""
        if code.co_flags & _LATER and code.co_name != "<genexpr>":
            return False
        self.names.update(code.co_names)
        module: Any = None  # on top of the stack
        straight, stack = _is_straight(code), [_NOTHING] * 2  # what is known of it
        for one in dis.get_instructions(code):
            name, value = one.opname, one.argval
            if name in _PASSED:
                stack += [_NOTHING] * (name == "PUSH_NULL")
                continue
            loaded: Any = _NOTHING
            if module is not None:
                if name not in ("LOAD_ATTR", "LOAD_METHOD"):
                    return False
                loaded = getattr(module, value, _UNKNOWN)
            elif name == "LOAD_GLOBAL":
                loaded = known.get(value, getattr(builtins, value, _UNKNOWN))
            elif name in ("LOAD_DEREF", "LOAD_CLASSDEREF", "LOAD_CLOSURE") and value in cells:
                loaded = cells[value]
            elif name in _STORES or (name in ("STORE_DEREF", "DELETE_DEREF") and value in cells):
                return False
            elif name in ("LOAD_ATTR", "LOAD_METHOD"):
                if value.startswith("__"):
                    return False
                self.inputs = 1 if value == "dot" else self.inputs  # x.dot(y, a) of arrays writes to a
            self.inputs = min(self.inputs, getattr(loaded, "nin", self.inputs))
            if name.startswith("BINARY"):
                self.names.add(one.argrepr or "[]")
            if name.startswith("CALL"):
                called = stack[-(one.arg or 0) - 2 :][:2] if straight else []
                called = [x for x in called if not (x is _NOTHING or isinstance(x, types.ModuleType))]
                most = min(map(_inputs, called), default=self.inputs)
                self.writes |= name == "CALL_FUNCTION_EX" or (one.arg or 0) > most
            stack = _pushed(stack, one, loaded)
            self.writes |= _writes(name, value, one.argrepr)
            module = loaded if any(loaded is one for one in _MODULES) else None
            if loaded is not _NOTHING and module is None and not self.harmless(loaded):
                return False
        inner = [one for one in code.co_consts if isinstance(one, types.CodeType)]
        return module is None and all(self._code(one, cells, known) for one in inner)

    def harmless(self, x: Any) -> bool:
        """True if a function may refer to x."""
        if type(x) in (np.ndarray, list, dict):
            self.arrays = True
            values = () if isinstance(x, np.ndarray) else x.values() if isinstance(x, dict) else x
            return not getattr(x, "dtype", np.dtype(float)).hasobject and all(map(self.harmless, values))
        if isinstance(x, _CONSTANT):
            return True
        if type(x) in (tuple, frozenset):
            return all(map(self.harmless, x))
        if isinstance(x, types.FunctionType) and not x.__module__.startswith("numpy"):
            return self.plain(x)
        if isinstance(x, type):
            return x in _BUILTINS or x in _NUMPY
        if isinstance(x, types.BuiltinFunctionType) and x.__module__ == "math":
            return True
        return _has_hash(x) and (x in _BUILTINS or x in _NUMPY or x in _LINALG)


def _is_straight(code: types.CodeType) -> bool:
    """True if code has no jumps and exchanges nothing, so that its stack can be followed."""
    moves = {*dis.hasjrel, *dis.hasjabs, dis.opmap["SWAP"], dis.opmap["COPY"]}
    return not any(one.opcode in moves for one in dis.get_instructions(code))


def _pushed(stack: list[Any], one: dis.Instruction, loaded: Any) -> list[Any]:
    """The stack, as far as it is known, after an instruction; the place beside a function holds it too."""
    # Of 3.11 the arguments of a call go by an instruction before it.
    more = -(one.arg or 0) - 1 if one.opname == "CALL" else dis.stack_effect(one.opcode, one.arg, jump=False)
    stack = stack + [_NOTHING] * more if more >= 0 else stack[:more]
    new = min(len(stack), max(1, more + one.opname.startswith(("LOAD_ATTR", "LOAD_METHOD"))))
    return [*stack[: len(stack) - new], *[loaded] * new]


def _inputs(called: Any) -> int:
    """The number of arguments before one that something would write to."""
    if isinstance(called, types.FunctionType) and not (called.__module__ or "").startswith("numpy"):
        return 255  # whose own code is looked at
    return int(getattr(called, "nin", _INPUTS.get(called, 2) if _has_hash(called) else 2))


def _has_hash(x: Any) -> bool:
    try:
        hash(x)
    except Exception:  # of a user's own class any
        return False
    return True


def _writes(name: str, value: Any, text: str) -> bool:
    """True if an instruction may write to an array, list or dict."""
    if name in ("STORE_SUBSCR", "DELETE_SUBSCR", "STORE_SLICE"):
        return True
    if name in ("BINARY_OP", "INPLACE_ADD") and text.endswith("="):
        return True
    if name in ("KW_NAMES", "LOAD_CONST") and isinstance(value, tuple | str):
        return "out" in (value if isinstance(value, tuple) else (value,))
    return name in ("LOAD_ATTR", "LOAD_METHOD") and value in _WRITES
