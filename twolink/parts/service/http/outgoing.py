"""An answer on its way out: compressed, with a tag, and only what the client asks for of it (RFC 9110, 13 and 14)."""

import asyncio
import hashlib
import re
from collections.abc import Sequence
from typing import Any

from twolink.parts.service.http.messages import DENY_ALL, SECURITY, Header, compressed, header, send_body
from twolink.parts.service.problems import Refusal
from twolink.parts.service.work.sharing import this_request

_BESIDE = 2**18  # bytes from which on another thread makes the tag: all threads may be busy, and /health waits for none
_RANGE = re.compile(rb"bytes=(\d{0,18})-(\d{0,18})")


class Outgoing:
    """Takes what an application sends, and sends it on. added: headers of each answer.

    status: of the answer. complete: whether all of it was sent.
    """

    def __init__(self, scope: Any, send: Any, added: Sequence[Header]) -> None:
        self._scope, self._send, self._added = scope, send, added
        self.status, self.complete = 500, False
        self._start: Any = None  # kept until there is room for the body
        self._part: range | None = None  # bytes of the body that are sent
        self._position = 0

    async def __call__(self, message: Any) -> None:
        """As an ASGI `send`. Raises Refusal (413, 416, 503) before anything is sent."""
        if message["type"] == "http.response.start":
            self.status, self._start = message["status"], message
            return
        body, more = message.get("body", b""), message.get("more_body", False)
        if self._start is not None:
            body = await self._begin(body, more)
        if self._part is not None:
            begin, self._position = self._position, self._position + len(body)
            body = body[max(0, self._part.start - begin) : max(0, self._part.stop - begin)]
        self.complete = not more
        await send_body(self._send, body, more)

    async def _begin(self, body: bytes, more: bool) -> bytes:
        headers: list[Header] = list(self._start["headers"])
        is_kept = self.status == 200 and self._scope["method"] == "GET"
        if not more:
            if not (is_kept and header(self._scope, b"range")):
                headers, body = await compressed(self._scope, headers, body)
            if is_kept:
                headers.append((b"etag", await asyncio.to_thread(_tag, body) if len(body) > _BESIDE else _tag(body)))
        if is_kept and {b"etag", b"content-length"} <= dict(headers).keys():
            headers = self._select(headers)
        this_request().add(len(body))
        has_policy = any(name == DENY_ALL[0] for name, _ in headers)
        added = [*SECURITY, *self._added, *([] if has_policy else [DENY_ALL])]
        await self._send({**self._start, "status": self.status, "headers": [*headers, *added]})
        self._start = None
        return body

    def _select(self, headers: list[Header]) -> list[Header]:
        """The headers, once it is chosen what is sent: nothing of what the client has, a part, or all."""
        named = dict(headers)
        tag, length = named[b"etag"], int(named[b"content-length"])
        known = [each.strip().removeprefix(b"W/") for each in header(self._scope, b"if-none-match").split(b",")]
        if tag in known or known == [b"*"]:
            self.status, self._part = 304, range(0)
            return [pair for pair in headers if pair[0] not in (b"content-length", b"content-type")]
        if header(self._scope, b"if-range") in (b"", tag):
            self._part = _asked(header(self._scope, b"range"), length)
        headers = [*headers, (b"accept-ranges", b"bytes")]
        if self._part is None:
            return headers
        self.status, part = 206, self._part
        headers = [pair for pair in headers if pair[0] != b"content-length"]
        where = b"bytes %d-%d/%d" % (part.start, part.stop - 1, length)
        return [*headers, (b"content-range", where), (b"content-length", b"%d" % len(part))]


def _tag(body: bytes) -> bytes:
    return b'"%s"' % hashlib.blake2b(body, digest_size=12).hexdigest().encode()


def _asked(text: bytes, length: int) -> range | None:
    """The bytes of a Range header; None for all, also where several parts are asked for. Raises Refusal (416)."""
    match = _RANGE.fullmatch(text.replace(b" ", b""))
    if match is None or match[0] == b"bytes=-":
        return None
    first, last = match[1], match[2]
    if first:
        part = range(int(first), min(int(last) + 1, length) if last else length)
    else:
        part = range(max(0, length - int(last)), length)
    if not len(part):
        raise Refusal(416, f"it has {length} bytes", where="header: Range", remedy="ask for a part of these")
    return part
