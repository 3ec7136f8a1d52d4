"""Common parts of HTTP's handlers: parameters, reading a body within limits, sending an answer; access control."""

import asyncio
import base64
import contextlib
import gzip
import re
import time
from collections.abc import Coroutine, Sequence
from typing import Any, TypeVar
from urllib.parse import urlsplit

from litestar import Request
from litestar.params import QueryParameter

from twolink.errors import nearest
from twolink.parts.service.problems import Refusal
from twolink.parts.service.settings import Quotas, Settings, Tokens, ip_address
from twolink.parts.service.store.archives import GZIP_LEVEL, NPZ
from twolink.parts.service.work.sharing import OWNER, this_request

T = TypeVar("T")
Asked = Request[Any, Any, Any]
Header = tuple[bytes, bytes]
SECURITY: tuple[Header, ...] = (
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-resource-policy", b"same-origin"),
)
XML = ("application/xml", "text/xml", "application/urdf+xml")
ZIP = ("application/zip", "application/x-zip-compressed")
OCTETS = "application/octet-stream"
_LARGE = (*XML, *ZIP, OCTETS, NPZ)
SLICE = 256 * 1024  # bytes of an answer that are handed on at once: the next when the client has read most of them
_COMPRESSED = ("application/json", "text/html", "text/css", "text/javascript", "text/csv", "image/svg+xml")
_WORTH_COMPRESSING = 2**11  # bytes
_COMPRESS_BESIDE = 2**16  # bytes from which on another thread does it: a megabyte takes 20 ms
_JOIN = 2**22  # bytes that are put together in the event loop, in some milliseconds
OWN_QUERY = "own_query"  # of handlers that check the query string themselves
UNSPECIFIED = ("", "application/x-www-form-urlencoded", "text/plain")  # what curl sends by default


def header(scope: Any, name: bytes) -> bytes:
    """A header of a request, b"" when it has none of that name."""
    return headers_of(scope).get(name, b"")


def headers_of(scope: Any) -> dict[bytes, bytes]:
    """The headers of a request by name, the first one where a name comes again."""
    by_name: dict[bytes, bytes] | None = scope.get("twolink.headers")
    if by_name is None:
        by_name = scope["twolink.headers"] = dict(reversed(scope["headers"]))
    return by_name


def media_type(value: bytes) -> str:
    """A content type without its parameters."""
    return value.partition(b";")[0].strip().lower().decode("latin-1")


def body_limit(media: str, quotas: Quotas) -> float:
    """The most bytes that a body of this media type may have. Only the types that are stored or mapped may be large."""
    return (quotas.body_mb if media in _LARGE else min(quotas.json_mb, quotas.body_mb)) * 2**20


async def read_body(scope: Any, receive: Any, limit: float) -> bytes:
    """The whole body. The protocol limits the time it takes.

    Raises Refusal when it has more than `limit` bytes (413), or when there is no memory for it now (503).
    """
    stated = header(scope, b"content-length")
    if stated and int(stated) > limit:  # the protocol has checked that it is a number
        raise too_large(limit)
    reserve, parts, size, more = this_request().add, [], 0, True
    reserved = int(stated or 0)  # from the begin: what has been let in is not refused half way
    reserve(2 * reserved)  # twice: in pieces and whole
    while more:
        message = await receive()
        if message["type"] == "http.disconnect":
            raise Refusal(400, "the client has gone", where="body")
        parts.append(message.get("body", b""))
        size += len(parts[-1])
        if size > limit:
            raise too_large(limit)
        if size > reserved:
            reserve(2 * size)
            reserved += size
        more = message.get("more_body", False)
    if size > _JOIN:
        return await asyncio.to_thread(b"".join, parts)
    return parts[0] if len(parts) == 1 else b"".join(parts)


def too_large(limit: float) -> Refusal:
    """The refusal of a body with more bytes than the limit."""
    remedy = "send it in parts; JSON has a smaller limit than .npz, .zip and XML of their own media types"
    return Refusal(413, f"the body is larger than {limit / 2**20:g} MB", where="body", remedy=remedy)


async def while_connected(receive: Any, work: Coroutine[Any, Any, T]) -> T:
    """The result of `work`, which is cancelled when the client goes."""
    tasks = asyncio.create_task(work), asyncio.create_task(_disconnected(receive))
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        if not tasks[0].done():
            raise Refusal(400, "the client has gone", where="request")
        return tasks[0].result()
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def _disconnected(receive: Any) -> None:
    while (await receive())["type"] != "http.disconnect":
        pass


async def compressed(scope: Any, headers: Sequence[Header], body: bytes) -> tuple[list[Header], bytes]:
    """Headers and body of an answer, the body by gzip where the client takes that and it saves much."""
    by_name = dict(headers)
    media = media_type(by_name.get(b"content-type", b""))
    if len(body) < _WORTH_COMPRESSING or media not in _COMPRESSED or b"content-encoding" in by_name:
        return list(headers), body
    kept = [pair for pair in headers if pair[0] != b"content-length"]
    kept.append((b"vary", b"accept-encoding"))
    if accepts_gzip(scope):
        beside = len(body) >= _COMPRESS_BESIDE
        body = await asyncio.to_thread(_gzip, body) if beside else _gzip(body)
        kept.append((b"content-encoding", b"gzip"))
    return [*kept, (b"content-length", b"%d" % len(body))], body


def _gzip(body: bytes) -> bytes:
    return gzip.compress(body, GZIP_LEVEL, mtime=0)  # the same each time


def accepts_gzip(scope: Any) -> bool:
    """True if a client takes answers by gzip (RFC 9110, 12.5.3)."""
    for choice in header(scope, b"accept-encoding").lower().split(b","):
        name, _, weight = choice.partition(b";")
        if name.strip() == b"gzip":
            return weight.replace(b" ", b"") not in (b"q=0", b"q=0.0", b"q=0.00", b"q=0.000")
    return False


async def send_answer(send: Any, status: int, headers: Sequence[Header], body: bytes) -> None:
    """Send an answer of one piece, with the security headers."""
    length = (b"content-length", b"%d" % len(body))
    await send({"type": "http.response.start", "status": status, "headers": [*headers, length, *SECURITY]})
    await send_body(send, body)


async def send_body(send: Any, body: bytes, more: bool = False) -> None:
    """Send a body, or a piece of one, in slices, so that this ends only when the client has read nearly all of it."""
    if len(body) <= SLICE:
        await send({"type": "http.response.body", "body": body, "more_body": more})
        return
    view = memoryview(body)
    for start in range(0, len(body) - SLICE, SLICE):
        await send({"type": "http.response.body", "body": view[start : start + SLICE], "more_body": True})
    last = (len(body) - 1) // SLICE * SLICE
    await send({"type": "http.response.body", "body": view[last:], "more_body": more})


def require_taken(request: Asked) -> None:
    """Refuse parameters that an operation does not take: a misspelt one would be left out without a word.

    PostgreSQL takes no NUL in a text.
    """
    handler = request.route_handler
    if any("\0" in str(name) for name in request.path_params.values()):
        raise Refusal(404, "a name with NUL names nothing", where="path", remedy="give an id as it was answered")
    if not request.query_params or not request.url.path.startswith("/v1/") or handler.opt.get(OWN_QUERY):
        return
    given = ((name, field.kwarg_definition) for name, field in handler.parsed_fn_signature.parameters.items())
    taken = [kind.name or name for name, kind in given if isinstance(kind, QueryParameter)]
    for name in request.query_params:
        if name not in taken:
            raise Refusal(400, f"{name[:80]!r} is no parameter here", where="query", code="unknown-query-parameter",
                          remedy=nearest(name, taken) if taken else "leave it out")  # fmt: skip


PAGE_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; connect-src 'self'; "
    "font-src 'self'; frame-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
DENY_ALL: Header = (b"content-security-policy", b"default-src 'none'; frame-ancestors 'none'")
_OPEN_PATHS = "/health", "/ready", "/", "/docs", "/docs/"  # what browsers and monitors ask for before they have a token
_OPEN_PREFIX = "/page/"
LIVE = "/v1/live"
BEARER = "bearer"  # the subprotocol before a token as base64url: browsers send no other header with a WebSocket
_HOST = re.compile(r"(\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9._-]+)(?::[0-9]{1,5})?")


class AccessControl:
    """Checks each request before anything else looks at it."""

    def __init__(self, settings: Settings) -> None:
        self._tokens = Tokens(settings)
        self._rates = Rates(settings.quotas.owner_rate)
        self._hosts = {"localhost", settings.host.lower(), *(host.lower() for host in settings.hosts)}
        self._origins = {origin.encode() for origin in settings.origins}

    def check(self, scope: Any) -> bytes | None:
        """Raise Refusal unless the request may pass. Returns the foreign origin it came from, if one is allowed.

        Notes in the scope who is the owner of the token.
        """
        headers = headers_of(scope)
        if len(headers) < len(scope["headers"]) and [name for name, _ in scope["headers"]].count(b"host") > 1:
            raise Refusal(400, "there are several of it", where="header: Host", remedy="send one")
        host, origin = headers.get(b"host", b""), headers.get(b"origin")
        self._check_host(host)
        foreign = None if origin is None or _is_own(origin, host) else origin
        if foreign is not None and foreign not in self._origins:
            remedy = "start the service with --allow-origin"
            raise Refusal(403, "pages of other sites may not call it", where="header: Origin", remedy=remedy)
        path: str = scope["path"]
        is_open = scope["method"] == "OPTIONS" or path in _OPEN_PATHS or path.startswith(_OPEN_PREFIX)
        if self._tokens.asked and not is_open and OWNER not in scope:
            sent = headers.get(b"authorization") or _offered_token(scope.get("subprotocols", ()))
            owner = self._tokens.owner(sent)
            self._rates.take(owner)
            scope[OWNER] = owner  # a request that goes on by another way is checked again, and counts once
        return foreign

    def _check_host(self, host: bytes) -> None:
        """Let addresses and allowed names pass: a site whose name points at this machine must not reach the service."""
        match = _HOST.fullmatch(host.decode("latin-1"))
        name = match[1].lower() if match else ""
        if name not in self._hosts and ip_address(name) is None:
            remedy = "call it by its address, or start it with --allow-host"
            raise Refusal(421, f"the service has no name {name!r:.80}", where="header: Host", remedy=remedy)


class Rates:
    """So many requests a second of each named owner, a second's at once."""

    def __init__(self, rate: float) -> None:
        self._rate, self._most = rate, max(1.0, rate)
        self._left: dict[str, tuple[float, float]] = {}  # requests, and when there were so many

    def take(self, owner: str) -> None:
        """Count a request. Raises Refusal (429) where there were too many."""
        if not owner:
            return
        now = time.monotonic()
        left, since = self._left.get(owner, (self._most, now))
        left = min(self._most, left + (now - since) * self._rate)
        if left < 1.0:
            what, remedy = f"{owner} has asked for more than {self._rate:g} requests a second", "ask more slowly"
            raise Refusal(429, what, where="request", remedy=remedy, retry_after=(1.0 - left) / self._rate)
        self._left[owner] = left - 1.0, now


def _offered_token(subprotocols: Sequence[str]) -> bytes:
    """An Authorization from the subprotocols of a WebSocket, bearer and a token; empty where there is none."""
    if len(subprotocols) != 2 or subprotocols[0] != BEARER:
        return b""
    with contextlib.suppress(ValueError):
        return b"Bearer " + base64.urlsafe_b64decode(subprotocols[1] + "==")
    return b""


def _is_own(origin: bytes, host: bytes) -> bool:
    """True if the request comes from a page of this service: browsers send its origin."""
    try:
        return urlsplit(origin.decode("latin-1")).netloc.encode("latin-1") == host != b""
    except ValueError:  # such as http://[
        return False


def cors_headers(origin: bytes) -> list[Header]:
    """The headers by which browsers let a page of an allowed origin read the answer."""
    return [
        (b"access-control-allow-origin", origin),
        (b"vary", b"Origin"),
        (b"access-control-allow-methods", b"GET, HEAD, POST, DELETE"),
        (b"access-control-allow-headers", b"authorization, content-type, accept, if-none-match, if-range, range"),
        (b"access-control-max-age", b"600"),
    ]
