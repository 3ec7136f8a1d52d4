"""State that laws may change and no copy holds: attributes of classes, names of modules, variables of the context.

They are not a solution's own, and may act in the next one where they change no answer in this one.
"""

import contextvars
import copy
import types
from collections.abc import Iterable, Iterator
from typing import Any

from twolink.loop.copies import is_a_users, named_globals

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
