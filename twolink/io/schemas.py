"""Misfits of data and its schema: the message of msgspec, the place in the data, and what would fit there."""

import re
from collections.abc import Iterator
from typing import Any

import msgspec
from msgspec.inspect import (
    DictType,
    ListType,
    LiteralType,
    Metadata,
    StructType,
    TupleType,
    Type,
    UnionType,
    VarTupleType,
)

from twolink.errors import nearest

_UNKNOWN_FIELD = re.compile(r"unknown field `(.*)`", re.DOTALL)
_UNKNOWN_WORD = re.compile(r"Invalid (?:enum )?value '(.*)'", re.DOTALL)


def split_path(message: str) -> tuple[str, str]:
    """Split a message of msgspec into what is wrong and the path in the data, such as effects[0].field, or ""."""
    match = re.search(r" - at `(?:key in )?\$?\.?(.*)`$", message, re.DOTALL)
    return (message[: match.start()], match.group(1)) if match else (message, "")


def misfit(error: msgspec.ValidationError, kind: Any) -> tuple[str, str, str]:
    """The fault in data of the type `kind`, the path in the data or "", and a remedy or "".

    The remedy is the nearest of the names that stand there: of fields, or of the words that a field takes.
    """
    what, path = split_path(str(error))
    for pattern, names_of in ((_UNKNOWN_FIELD, _fields), (_UNKNOWN_WORD, _words)):
        if found := pattern.search(what):
            names = list(dict.fromkeys(name for one in _at(path, kind) for name in names_of(one)))
            return what, path, nearest(found[1], names) if names else ""
    return what, path, ""


def _at(path: str, kind: Any) -> list[Type]:
    """The types that may stand at a path."""
    kinds = list(_alternatives(msgspec.inspect.type_info(kind)))
    for step in re.findall(r"\[[^\]]*\]|[^.\[]+", path):
        kinds = [part for one in kinds for inner in _inside(one, step) for part in _alternatives(inner)]
    return kinds


def _alternatives(kind: Type) -> Iterator[Type]:
    """The types that a type stands for, without unions and notes."""
    if isinstance(kind, (UnionType, Metadata)):
        for one in kind.types if isinstance(kind, UnionType) else (kind.type,):
            yield from _alternatives(one)
    else:
        yield kind


def _inside(kind: Type, step: str) -> list[Type]:
    """The types of a field, or of the items of a list or an object: [0], [...]."""
    if isinstance(kind, StructType):
        if step == kind.tag_field:
            return [LiteralType((kind.tag,))]
        return [field.type for field in kind.fields if field.encode_name == step]
    if isinstance(kind, TupleType):
        return list(kind.item_types)
    if isinstance(kind, (ListType, VarTupleType)):
        return [kind.item_type]
    return [kind.value_type, kind.key_type] if isinstance(kind, DictType) else []


def _fields(kind: Type) -> list[str]:
    return [field.encode_name for field in kind.fields] if isinstance(kind, StructType) else []


def _words(kind: Type) -> list[str]:
    return [one for one in kind.values if isinstance(one, str)] if isinstance(kind, LiteralType) else []
