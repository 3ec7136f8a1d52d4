"""What the handlers share of HTTP: reading a body within limits, sending an answer, media types."""

from collections.abc import Sequence
from typing import Any

from twolink.service.access import SECURITY, Header
from twolink.service.problems import Refusal

JSON = "application/json"
UNSPECIFIED = ("", "application/x-www-form-urlencoded", "text/plain")  # what curl sends by default


def header(scope: Any, name: bytes) -> bytes:
    """A header of a request, b"" when it has none of that name."""
    headers: list[Header] = scope["headers"]
    for key, value in headers:
        if key == name:
            return value
    return b""


def media_type(value: bytes) -> str:
    """A content type without its parameters."""
    return value.partition(b";")[0].strip().lower().decode("latin-1")


async def read_body(scope: Any, receive: Any, limit: float) -> bytes:
    """The whole body. Raises Refusal when it has more than `limit` bytes. The protocol limits the time it takes."""
    stated = header(scope, b"content-length")
    if stated and (not stated.isdigit() or len(stated) > 18 or int(stated) > limit):
        raise _too_large(limit)
    parts, size, more = [], 0, True
    while more:
        message = await receive()
        if message["type"] == "http.disconnect":
            raise Refusal(400, "the client has gone", where="body")
        parts.append(message.get("body", b""))
        size += len(parts[-1])
        if size > limit:
            raise _too_large(limit)
        more = message.get("more_body", False)
    return parts[0] if len(parts) == 1 else b"".join(parts)


def _too_large(limit: float) -> Refusal:
    return Refusal(413, f"the body is larger than {limit / 2**20:g} MB", where="body", remedy="send it in parts")


async def send_answer(send: Any, status: int, headers: Sequence[Header], body: bytes) -> None:
    """Send an answer in one piece, with the security headers."""
    length = (b"content-length", str(len(body)).encode())
    await send({"type": "http.response.start", "status": status, "headers": [*headers, length, *SECURITY]})
    await send({"type": "http.response.body", "body": body})
