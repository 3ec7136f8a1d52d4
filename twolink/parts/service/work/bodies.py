"""JSON bodies of the calls of functions: fields, types, defaults and texts are those of the signature and docstring."""

import inspect
from collections.abc import Callable, Mapping, Sequence
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import msgspec
from numpy.typing import ArrayLike

from twolink.dynamics import Robot
from twolink.dynamics.queries import Numbers
from twolink.io.docstrings import texts_of
from twolink.scenes import Scene
from twolink.scenes.file_format import SceneFile

NOT_SENT = ("progress", "patience")  # the service has limits of its own
_SENT = {Scene: str | SceneFile, Robot: str}  # a scene by name or in full; a robot by id
_TIMES = Annotated[tuple[float, ...], msgspec.Meta(min_length=1)] | None
_ARRAY = frozenset(get_args(ArrayLike))


def body_of_call(
    function: Callable[..., Any], name: str, without: Sequence[str] = (), tag: str | None = None, **more: Any
) -> type[msgspec.Struct]:
    """The JSON body of a call: a frozen struct, which takes no other fields.

    without: parameters that are not sent. tag: the value of the field `operation`, by which bodies are told apart.
    more: types of fields in place of those of the signature, or (type, default) of others, by name.
    """
    hints, texts = get_type_hints(function, include_extras=True), texts_of(function)
    fields: list[tuple[Any, ...]] = []
    for parameter in inspect.signature(function).parameters.values():
        if parameter.name in (*NOT_SENT, *without):
            continue
        own = _TIMES if parameter.name == "t_eval" else more.pop(parameter.name, None)
        kind = own or json_type(hints[parameter.name])
        text = texts.get(parameter.name)
        kind = Annotated[kind, msgspec.Meta(description=text)] if text else kind
        default = () if parameter.default is parameter.empty else (parameter.default,)
        fields.append((parameter.name, kind, *default))
    fields += [(field, *given) for field, given in more.items()]
    told = {} if tag is None else {"tag_field": "operation", "tag": tag}
    return msgspec.defstruct(name, fields, frozen=True, kw_only=True, forbid_unknown_fields=True, module=__name__,
                             namespace={"__doc__": f"As `tl.{function.__name__}`."}, **told)  # type: ignore[arg-type]  # fmt: skip


def arguments_of(request: Any, *without: str) -> dict[str, Any]:
    """The arguments of the call by name, without what is the service's own."""
    return {name: getattr(request, name) for name in request.__struct_fields__ if name not in ("wait", *without)}


def sent_as(function: Callable[..., Any], kind: type) -> list[str]:
    """The parameters that may be scenes, or robots, and come as names, ids or contents."""
    hints = get_type_hints(function)
    return [name for name, hint in hints.items() if name != "return" and kind in _parts(hint)]


def words(known: Sequence[str]) -> Any:
    """The type of a text that is one of these."""
    return Literal.__getitem__(tuple(known))


def json_type(hint: Any) -> Any:
    """The type in JSON of what a function takes, without functions and paths.

    Raises TypeError where nothing is left to send.
    """
    parts = _parts(hint)
    if ours := next((kind for kind in _SENT if kind in parts), None):
        return _SENT[ours]
    found: list[Any] = []
    if set(parts) >= _ARRAY:
        found, parts = [float, Numbers], tuple(part for part in parts if part not in _ARRAY)
    for part in parts:
        origin, inner = get_origin(part), get_args(part)
        if origin is Mapping:
            found.append(dict[str, json_type(inner[1])])  # type: ignore[misc]
        elif origin is Sequence:
            found.append(tuple[json_type(inner[0]), ...])  # type: ignore[misc]
        elif origin in (Annotated, Literal, tuple) or part in (float, int, str, bool, NoneType):
            found.append(part)
    return Union[tuple(found)]  # noqa: UP007  # of as many as there are


def _parts(hint: Any) -> tuple[Any, ...]:
    return get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)
