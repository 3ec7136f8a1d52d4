"""JSON objects that name a key twice are refused: of two values, decoders take the last one without a word."""

import json
from typing import Any, TypeVar

import msgspec

from twolink.service.problems import Refusal

T = TypeVar("T")


def decode_unique(body: bytes, kind: type[T]) -> T:
    """Decode JSON. Raises msgspec.MsgspecError, whose message has the place, and Refusal where a key comes twice."""
    decoded = msgspec.json.decode(body, type=kind)
    require_unique_keys(body)
    return decoded


def require_unique_keys(body: bytes, strings: int | None = None) -> None:
    """Raise Refusal (400) if an object in the JSON names a key twice.

    A repeated key is lost in decoding, and the quotes around it with it, so that counting quotes is enough. strings:
    how many strings, keys included, were decoded from the body, if that is known.
    """
    if strings is not None and body.count(b'"') == 2 * strings:
        return
    if b"\\u0022" in body or body.count(b'"') != msgspec.json.encode(msgspec.json.decode(body)).count(b'"'):
        json.loads(body, object_pairs_hook=_unique)


def _unique(pairs: list[tuple[str, Any]]) -> None:
    seen = set()
    for name, _ in pairs:
        if name in seen:
            raise Refusal(400, f"the key {name[:80]!r} is given twice", where="body", remedy="give it once")
        seen.add(name)
