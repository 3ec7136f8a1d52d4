"""The application: Litestar inside an ASGI application that checks access, counts, and answers the queries."""

from __future__ import annotations

import asyncio
import re
import time
from typing import Any

from litestar import Litestar, Response
from litestar.di import Provide
from litestar.handlers import BaseRouteHandler
from litestar.openapi import OpenAPIConfig

from twolink._version import __version__
from twolink.dynamics.queries import Query
from twolink.errors import nearest
from twolink.parts.service.http import api_jobs, api_live, api_models, api_site
from twolink.parts.service.http.components import PREFIX, Service
from twolink.parts.service.http.messages import (
    DENY_ALL,
    LIVE,
    SECURITY,
    AccessControl,
    Asked,
    Header,
    body_limit,
    cors_headers,
    header,
    media_type,
    read_body,
    require_taken,
    send_answer,
    while_connected,
)
from twolink.parts.service.http.outgoing import Outgoing
from twolink.parts.service.logs import REQUEST_ID, AccessLog, Answered, request_id
from twolink.parts.service.problems import JSON, Refusal, answer_of, ending
from twolink.parts.service.settings import Settings, ip_address
from twolink.parts.service.work.query_requests import QUERIES
from twolink.parts.service.work.sharing import OWNER, REQUEST, RequestMemory, Shares, client_of_scope, this_request

_PARTS = (api_models, api_jobs, api_live, api_site)
_NAMED = [one for part in _PARTS for one in vars(part).values() if isinstance(one, BaseRouteHandler)]
_QUERY_HEADERS = b"".join(b"%s: %s\r\n" % pair for pair in ((b"content-type", JSON.encode()), DENY_ALL, *SECURITY))
_BELOW_ROBOT = re.compile(rf"{PREFIX}[^/]+/([^/]{{1,80}})")
_ABOUT = "Rigid-body dynamics from a URDF: queries, experiments and playback."


def build(settings: Settings) -> Shell:
    """The ASGI application. Raises TwolinkError when the data folder cannot be used."""
    service = Service(settings)
    inner = Litestar(
        [*_NAMED, *api_jobs.OF_KINDS],
        dependencies={"service": Provide(lambda: service, sync_to_thread=False)},
        lifespan=[service.running],
        before_request=require_taken,
        exception_handlers={Exception: _refuse},
        openapi_config=OpenAPIConfig(
            "twolink", __version__, description=_ABOUT, use_handler_docstrings=True, path="/none", render_plugins=[]
        ),
        request_max_body_size=None,  # the shell limits it
        logging_config=None,
    )
    return Shell(service, inner)


def _refuse(_: Asked, error: Exception) -> Response[bytes]:
    status, headers, body = answer_of(error)
    texts = {name.decode(): value.decode() for name, value in headers}
    return Response(body, status_code=status, media_type=texts.pop("content-type"), headers=texts)


class Shell:
    """The outer application: admission and access control, counters; queries go past Litestar, for speed."""

    def __init__(self, service: Service, inner: Litestar) -> None:
        self.service, self._log = service, AccessLog(service.settings.log)
        self._quotas = service.quotas
        self._inner, self._robots, self._metrics = inner, service.robots, service.metrics
        self._access = AccessControl(service.settings)
        self._memory = Shares(self._quotas.memory_in_flight_mb * 2**20)
        self._under_way, self._routes = 0, _routes(inner)
        service.metrics.gauge("twolink_requests_under_way", "Requests that are answered", lambda: self._under_way)
        service.metrics.gauge("twolink_bytes_in_flight", "Bytes of bodies and answers", lambda: self._memory.taken)

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        root = self.service.settings.root_path if "path" in scope else ""
        own = scope["path"].removeprefix(root) if root else ""
        if is_below := own.startswith("/") and own != scope["path"]:
            scope = {**scope, "path": own}
        elif root and not own:
            await send_answer(send, 308, [(b"location", f"{root}/".encode())], b"")  # links of the page are relative
            return
        self._see_client(scope)
        if scope["type"] == "websocket":
            await self._socket(scope, receive, send)
            return
        if scope["type"] != "http":
            await self._inner(scope, receive, send)
            if scope["type"] == "lifespan":
                self._log.close()
            return
        sent_id = request_id(header(scope, b"x-request-id"))
        REQUEST_ID.set(sent_id)
        client, start = scope["client"], time.perf_counter()
        entry = Answered(time.time(), sent_id, client[0] if client else "", scope["method"], scope["raw_path"])

        async def send_noted(message: Any) -> None:
            if message["type"] == "http.response.start":
                entry.status = message["status"]
                headers = [*message["headers"], (b"x-request-id", sent_id.encode())]
                message["headers"] = [
                    (name, root.encode() + value if is_below and name.lower() == b"location" else value)
                    for name, value in headers
                ]
            else:
                entry.bytes += len(message.get("body", b""))
            await send(message)

        self._under_way += 1
        mine = RequestMemory(self._memory, client_of_scope(scope))
        REQUEST.set(mine)  # uvicorn answers each request in a task of its own
        try:
            asked = scope if scope["method"] != "HEAD" else {**scope, "method": "GET"}
            await self._answer(asked, receive, send_noted)
        except asyncio.CancelledError:  # the service ends, and does not wait for the answer any more
            if entry.status or not self.service.ending:
                raise
            status, headers, body = answer_of(ending())
            await send_answer(send_noted, status, [*headers, DENY_ALL], body)
        finally:
            mine.keep(0)
            self._under_way -= 1
            entry.seconds, entry.owner = time.perf_counter() - start, mine.owner
            self._log.note(entry)

    def _see_client(self, scope: Any) -> None:
        """Let a request that comes through a trusted proxy have the client that this names last."""
        proxies = self.service.settings.proxies
        if not (proxies and scope.get("client") and scope["client"][0] in proxies):
            return
        named = [text.strip() for text in header(scope, b"x-forwarded-for").decode("latin-1").split(",")]
        while named and named[-1] in proxies:
            named.pop()
        if named and ip_address(named[-1]) is not None:
            scope["client"] = (named[-1], 0)

    async def _socket(self, scope: Any, receive: Any, send: Any) -> None:
        """Hand a WebSocket on, or refuse it with the answer that a request would have."""
        sent_id = request_id(header(scope, b"x-request-id"))
        REQUEST_ID.set(sent_id)
        start, status, body = time.perf_counter(), 101, b""
        try:
            asked = {**scope, "method": "GET"}
            self._access.check(asked)
            scope[OWNER] = asked.get(OWNER, "")
            if scope["path"] != LIVE:
                raise Refusal(404, "there is no WebSocket at this path", where="path", remedy=f"GET {LIVE}")
        except Refusal as error:
            status, headers, body = answer_of(error)
            headers.append((b"content-length", b"%d" % len(body)))
            await send({"type": "websocket.http.response.start", "status": status, "headers": headers})
            await send({"type": "websocket.http.response.body", "body": body})
        else:
            await self._inner(scope, receive, send)
        client, seconds = scope["client"], time.perf_counter() - start
        self._log.note(Answered(time.time() - seconds, sent_id, client[0] if client else "", "GET",
                                scope["path"].encode(), status, len(body), seconds, scope.get(OWNER, "")))  # fmt: skip

    def answer_now(self, scope: Any, body: bytes) -> tuple[bytes, bytes] | None:
        """Headers and body of the answer to a query of a few states, in half of the time that a task takes.

        None: the request is to take its way through `__call__`, which also says what is wrong with it.
        """
        query, start = _query_of(scope), time.perf_counter()
        if query is None:
            return None
        self._see_client(scope)
        try:
            answer = None if self._access.check(scope) else self._robots.answer_now(scope, body, *query)
        except Exception:
            return None
        if answer is None:
            return None
        sent_id, seconds = request_id(header(scope, b"x-request-id")), time.perf_counter() - start
        self._metrics.answered(query[1].name, 200, seconds)
        self._log.note(Answered(time.time() - seconds, sent_id, scope["client"][0], "POST", scope["raw_path"], 200,
                                len(answer), seconds, scope.get(OWNER, "")))  # fmt: skip
        return b"%sx-request-id: %s\r\n" % (_QUERY_HEADERS, sent_id.encode()), answer

    def refuse(self, refusal: Refusal, client: tuple[str, int] | None) -> tuple[int, list[Header], bytes]:
        """The answer to what the protocol refuses before there is a request, noted like others."""
        sent_id = request_id(b"")
        outer = REQUEST_ID.set(sent_id)
        status, headers, body = answer_of(refusal)
        REQUEST_ID.reset(outer)  # the context is that of all connections
        self._log.note(Answered(time.time(), sent_id, client[0] if client else "", "-", b"-", status, len(body)))
        self._metrics.answered("refused", status, 0.0)
        return status, [*headers, (b"x-request-id", sent_id.encode())], body

    async def _answer(self, scope: Any, receive: Any, send: Any) -> None:
        start = time.perf_counter()
        route, cors = "refused", []
        try:
            origin = self._access.check(scope)
            self._identify(scope)
            cors = [] if origin is None else cors_headers(origin)
            query = _query_of(scope)
            if query is None:
                await self._to_litestar(scope, receive, send, cors, start)
                return
            route = query[1].name
            status, headers, body = await self._robots.answer(scope, receive, *query)
        except Exception as error:
            cause = error.__cause__  # Litestar wraps what is refused while an answer is sent
            status, headers, body = answer_of(cause if isinstance(cause, Refusal) else error)
        this_request().keep(len(body))
        await send_answer(send, status, [*headers, *cors, DENY_ALL], body)
        self._metrics.answered(route, status, time.perf_counter() - start)

    def _identify(self, scope: Any) -> None:
        """Let the request under way have what its owner may have."""
        mine, owner = this_request(), scope.get(OWNER, "")
        mine.client, mine.owner = client_of_scope(scope), owner
        mine.sees = None if owner in self.service.settings.admins else owner

    async def _to_litestar(self, scope: Any, receive: Any, send: Any, cors: list[Header], start: float) -> None:
        """Hand a request on with a body within limits, and add the security headers to the answer."""
        allowed = self._allowed(scope["path"])
        if not allowed and (misspelt := _BELOW_ROBOT.fullmatch(scope["path"])):
            remedy = f"{nearest(misspelt[1], QUERIES)} (GET /v1/queries lists them)"
            raise Refusal(404, f"there is no query {misspelt[1]!r}", where="path", remedy=remedy)
        if allowed and scope["method"] not in allowed:
            what = f"{scope['method'][:20]} is not for this path"
            raise Refusal(405, what, remedy=f"it takes {allowed}", where="method", allow=allowed)
        if allowed and scope["method"] == "OPTIONS":
            await send_answer(send, 204, [(b"allow", allowed.encode()), *cors, DENY_ALL], b"")
            return
        body = b""
        if scope["method"] in ("POST", "PUT", "PATCH"):
            limit = body_limit(media_type(header(scope, b"content-type")), self._quotas)
            body = await read_body(scope, receive, limit)
        outgoing = Outgoing(scope, send, cors)

        async def receive_end() -> Any:
            message = await receive()
            if outgoing.complete:  # uvicorn says then, too, that the client has gone
                await asyncio.Future()
            return message

        try:
            await while_connected(receive_end, self._inner(scope, _replay(body, receive), outgoing))
        finally:
            route = scope.get("path_template") or "unknown"
            self._metrics.answered(route, outgoing.status, time.perf_counter() - start)

    def _allowed(self, path: str) -> str:
        """The methods of a path, as the header Allow names them; empty where there is no such path."""
        found = {method for pattern, methods in self._routes if pattern.fullmatch(path) for method in methods}
        return ", ".join(sorted(found | ({"HEAD"} if "GET" in found else set())))


def _routes(inner: Litestar) -> list[tuple[re.Pattern[str], set[str]]]:
    """The paths of an application and of the queries, with their methods."""
    found = [(re.compile(f"{PREFIX}[^/]+/({'|'.join(map(re.escape, QUERIES))})"), {"POST", "OPTIONS"})]
    for route in inner.routes:
        parts = re.split(r"\{\w+:(\w+)\}", route.path)
        parts[1::2] = ["/?.+" if kind == "path" else "[^/]+" for kind in parts[1::2]]
        methods = {str(method) for method in getattr(route, "methods", ())}
        found.append((re.compile("".join(parts)), methods | {"OPTIONS"} if methods else set()))
    return found


def _query_of(scope: Any) -> tuple[str, Query] | None:
    """The robot's id and the query, if the request is one."""
    path: str = scope["path"]
    if not path.startswith(PREFIX) or scope["method"] != "POST":
        return None
    key, slash, name = path[len(PREFIX) :].partition("/")
    query = QUERIES.get(name) if slash else None
    return None if query is None else (key, query)


def _replay(body: bytes, receive: Any) -> Any:
    """A `receive` that has the body already, and then says when the client has gone."""
    messages = [{"type": "http.request", "body": body, "more_body": False}]

    async def next_message() -> Any:
        return messages.pop() if messages else await receive()

    return next_message
