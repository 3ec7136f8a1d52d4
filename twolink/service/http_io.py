"""Small things of HTTP that the handlers share: reading a body within limits, sending an answer, media types."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from twolink.service.access import SECURITY, Header
from twolink.service.problems import Refusal

JSON = "application/json"
UNTOLD = ("", "application/x-www-form-urlencoded", "text/plain")  # what curl says when it is told nothing


def header(scope: Any, name: bytes) -> bytes:
    """A request's header, or nothing."""
    for key, value in scope["headers"]:
        if key == name:
            found: bytes = value
            return found
    return b""


def media_type(value: bytes) -> str:
    """A content type without its parameters."""
    return value.partition(b";")[0].strip().lower().decode("latin-1")


async def read_body(scope: Any, receive: Any, most_bytes: float) -> bytes:
    """The whole body. Raises Refusal when it is too large. How long it may take is for the protocol to say."""
    stated = header(scope, b"content-length")
    if stated and (not stated.isdigit() or len(stated) > 18 or int(stated) > most_bytes):
        raise _too_large(most_bytes)
    message = await receive()
    if not message.get("more_body"):
        whole: bytes = message.get("body", b"")
        if len(whole) > most_bytes:
            raise _too_large(most_bytes)
        return whole
    parts, size = [message["body"]], len(message["body"])
    while message.get("more_body"):
        message = await receive()
        if message["type"] == "http.disconnect":
            raise Refusal(400, "the client has gone", where="body")
        parts.append(message.get("body", b""))
        size += len(parts[-1])
        if size > most_bytes:
            raise _too_large(most_bytes)
    return b"".join(parts)


def _too_large(most_bytes: float) -> Refusal:
    what = f"the body is larger than {most_bytes / 2**20:g} MB"
    return Refusal(413, what, where="body", remedy="send it in parts")


async def send_answer(send: Any, status: int, headers: Sequence[Header], body: bytes) -> None:
    """An answer in one piece, with the security headers."""
    length = (b"content-length", str(len(body)).encode())
    await send({"type": "http.response.start", "status": status, "headers": [*headers, length, *SECURITY]})
    await send({"type": "http.response.body", "body": body})


def accepts(scope: Any, offered: Iterable[str], default: str) -> str:
    """Which of the offered media types the client would have; the default when it does not care.

    Raises Refusal (406) when it wants none of them.
    """
    given = header(scope, b"accept")
    if given in (b"", b"*/*"):
        return default
    wanted = [part.partition(b";")[0].strip().decode("latin-1") for part in given.split(b",")]
    if "*/*" in wanted or default in wanted:
        explicit = [w for w in wanted if w in offered]
        return explicit[0] if explicit else default
    for name in wanted:
        if name in offered:
            return name
        if name.endswith("/*"):
            found = next((o for o in offered if o.startswith(name[:-1])), None)
            if found:
                return found
    raise Refusal(406, "none of the media types asked for is offered", where="header: Accept",
                  remedy=f"offered: {', '.join(offered)}")  # fmt: skip
