"""Running the service with uvicorn, whose protocol has limits of what a connection may take.

uvicorn 0.54 with httptools 0.9 has no limit of the bytes of a URL, of headers or of trailers, keeps any number of
pipelined requests, and waits without end for a request that does not arrive and for a client that does not read.

The service is one process with a pool of computing processes. The process answers small queries; batches, jobs and
uploads run in the pool. `scripts/benchmarks/service.py` measures how many. Whoever needs more puts several services
behind a reverse proxy.
"""

import contextlib
import functools
import socket
from asyncio.events import TimerHandle
from collections.abc import Callable
from typing import Any

import httptools
import uvicorn
from uvicorn.protocols.http.httptools_impl import STATUS_LINE, HttpToolsProtocol

from twolink.errors import TwolinkError
from twolink.parts.service.http.api_live import MESSAGE_BYTES, LiveProtocol
from twolink.parts.service.http.components import Service
from twolink.parts.service.http.messages import SLICE, header
from twolink.parts.service.logs import configure
from twolink.parts.service.problems import Refusal
from twolink.parts.service.settings import Quotas, Settings, open_files
from twolink.parts.service.work.sharing import Shares, busy, client_of

_OTHER_FILES = 200  # that are no connections: the database, worker processes, results
_URL_BYTES = 8192
_HEADERS = 100  # of a request: to read one takes longer than a hundred bytes of its value
_SMALL_DIGITS = 4  # of the length of a body that is waited for: the application has nothing to do before
_PIPELINED = 16  # requests of a connection that wait for the answer to an earlier one
_PIECE = 4096  # bytes that are parsed at once before a body, so that their number is known
_SLOW_START = 5.0  # seconds before the smallest rate holds
_LINGER = 2.0  # seconds that a refused client has to read why
_LINGER_BYTES = 2**20  # that it may still send meanwhile
_CHECK = 1.0  # seconds between looks at a connection


class _Transport:
    """A transport that ignores what is written after its end, where uvloop's raises RuntimeError."""

    def __init__(self, transport: Any) -> None:
        self._transport = transport
        self.is_closing = transport.is_closing

    def write(self, data: bytes) -> None:
        if not self.is_closing():
            self._transport.write(data)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._transport, name)


class Protocol(HttpToolsProtocol):
    """A connection. The parser calls its `on_...` methods; a failure in them ends the connection.

    connections: open at once, of all clients.
    """

    def __init__(self, connections: Shares, quotas: Quotas, **others: Any) -> None:
        super().__init__(**others)
        self._connections, self._seconds = connections, quotas.body_seconds
        self._most_header, self._rate = quotas.header_kb * 1024, quotas.rate_kb * 1024  # bytes, bytes/s
        self._holder: str | None = None  # the client, if the connection is counted
        self._answered: Any = None  # the request that is answered
        self._small: tuple[Any, Any] | None = None  # the request, and the application, that wait for a small body
        self._timer: TimerHandle | None = None
        self._refusal: Refusal | None = None
        self._begun: float | None = None  # when the request that arrives has begun
        self._arrived = 0  # bytes of it
        self._in_body = False
        self._piece = 0  # bytes that the parser reads now
        self._unused = 0  # bytes since its begin or its last piece of body: headers, trailers, extensions of chunks
        self._ended: float | None = None  # when it was refused, or handed on
        self._stuck: float | None = None  # since when bytes wait to be sent

    def connection_made(self, transport: Any) -> None:
        """A client has connected."""
        open_transport: Any = _Transport(transport)
        super().connection_made(open_transport)
        self._begin()
        self._timer = self.loop.call_later(min(_CHECK, self._seconds), self._check)
        client = client_of(self.client[0] if self.client else "")
        if self._connections.take(client):
            self._holder = client
        else:
            self._end_with(busy(f"{self._connections.taken} connections are open already", "connection"))
            transport.close()

    def connection_lost(self, exc: Exception | None) -> None:
        """The connection has ended."""
        if self._timer is not None:
            self._timer.cancel()
        self._give_back()
        if self._answered is not None:  # uvicorn tells it to the request that came last
            self._answered.disconnected = True
            self._answered.message_event.set()
        super().connection_lost(exc)

    def _give_back(self) -> None:
        if self._holder is not None:
            self._connections.give(self._holder)
            self._holder = None

    def _begin(self) -> None:
        self._begun, self._arrived = self.loop.time(), 0

    def data_received(self, data: bytes) -> None:
        """Bytes have come."""
        self._arrived += len(data)
        if self._ended is not None and self._arrived > _LINGER_BYTES:
            self.transport.abort()
        while data and self._ended is None and not self.transport.is_closing():
            piece = data if self._in_body or len(data) <= _PIECE else data[:_PIECE]
            self._piece = len(piece)
            self._unused += self._piece
            super().data_received(piece)
            if self._unused > self._most_header or len(self.headers or ()) > _HEADERS:
                self._end_with(self._too_large())
            data = data[self._piece :]

    def on_message_begin(self) -> None:
        """A request begins."""
        if len(self.pipeline) >= _PIPELINED:
            raise self._refuse(busy("too many requests on one connection wait for their answers", "connection"))
        self._unset_keepalive_if_required()  # which bytes that have come with an answered request would not do
        self._begin()
        self._unused = self._piece  # at most: it may begin anywhere in the piece
        super().on_message_begin()

    def on_headers_complete(self) -> None:
        """All headers are there."""
        if len(self.url) > _URL_BYTES:
            what = f"the URL has {len(self.url)} bytes, the limit is {_URL_BYTES}"
            raise self._refuse(Refusal(414, what, where="URL", remedy="send it in the body"))
        if len(self.headers) > _HEADERS:
            raise self._refuse(self._too_large())
        self._in_body = True
        super().on_headers_complete()
        if not (self.parser.should_upgrade() and self._should_upgrade()):
            self.headers = []  # of trailers, which nobody reads

    def on_body(self, body: bytes) -> None:
        """A piece of the body."""
        self._unused = 0
        super().on_body(body)

    def on_message_complete(self) -> None:
        """The whole request has arrived."""
        self._begun, self._unused, self._in_body = None, 0, False
        super().on_message_complete()
        if self._small is not None:
            small, self._small = self._small, None
            self._answer_small(*small)

    def _start_asgi_task(self, cycle: Any, app: Any) -> None:
        """Have the application answer a request, at once when a small body has arrived, or else in a task."""
        self._answered = cycle
        is_small = 1 <= len(header(cycle.scope, b"content-length")) <= _SMALL_DIGITS
        if is_small and cycle is self.cycle and not cycle.waiting_for_100_continue and hasattr(app, "answer_now"):
            self._small = cycle, app
        else:
            super()._start_asgi_task(cycle, app)

    def _answer_small(self, cycle: Any, app: Any) -> None:
        """Answer without a task, if the application does."""
        answer = None
        if cycle.keep_alive and not self.flow.write_paused:
            answer = app.answer_now(cycle.scope, bytes(cycle.body))
        if answer is None:
            super()._start_asgi_task(cycle, app)
            return
        headers, body = answer
        date = b"".join(b"%s: %s\r\n" % header for header in self.server_state.default_headers)
        length = b"content-length: %d\r\n\r\n" % len(body)
        self.transport.write(b"".join((STATUS_LINE[200], date, headers, length, body)))
        cycle.response_started = cycle.response_complete = True
        self.on_response_complete()

    def handle_websocket_upgrade(self) -> None:
        """Hand the connection on. It is no longer counted here: live simulations are, and few."""
        timer, self._timer = self._timer, None
        if timer is not None:
            timer.cancel()
        self._give_back()
        self._ended = self.loop.time()  # what came behind the request is not read here
        super().handle_websocket_upgrade()

    def resume_writing(self) -> None:
        """The client has read what was sent to it."""
        self._stuck = None
        super().resume_writing()

    def _check(self) -> None:
        """End the connection when the client sends or reads too slowly."""
        now = self.loop.time()
        waiting = self.transport.get_write_buffer_size() > 0
        self._stuck = (self._stuck or now) if waiting else None
        if self.flow.read_paused and self._begun is not None:
            self._begun = now  # the client waits for the service
        reading = 0.0 if self._begun is None else now - self._begun
        ended = self._ended is not None and now - self._ended > _LINGER
        too_slow = reading > self._seconds or self._arrived < self._rate * (reading - _SLOW_START)
        if ended or too_slow or (self._stuck is not None and now - self._stuck > SLICE / self._rate):
            self.transport.abort()
        else:
            self._timer = self.loop.call_later(min(_CHECK, self._seconds), self._check)

    def _too_large(self) -> Refusal:
        what = f"more than {_HEADERS} headers, or more than {self._most_header:.0f} bytes of them"
        return Refusal(431, what, where="headers", remedy="leave out what the service does not need")

    def _refuse(self, refusal: Refusal) -> httptools.HttpParserError:
        """The error that a callback of the parser raises to end the connection with this refusal."""
        self._refusal = refusal
        return httptools.HttpParserError(refusal.what)

    def send_400_response(self, msg: str) -> None:
        """The parser has stopped: at an error of its own, or because a callback refused the request."""
        self._end_with(self._refusal or Refusal(400, msg, where="request", remedy="send HTTP/1.1"))

    def _end_with(self, refusal: Refusal) -> None:
        """Answer with a refusal, and end the connection; at once if an answer to an earlier request is under way."""
        if self._ended is not None or self.transport.is_closing():
            return
        if self.cycle is not None and not self.cycle.response_complete:
            self.transport.abort()
            return
        self._ended = self.loop.time()
        status, headers, body = self.app.refuse(refusal, self.client)
        headers = [*headers, (b"content-length", str(len(body)).encode()), (b"connection", b"close")]
        lines = b"".join(b"%s: %s\r\n" % header for header in headers)
        self.transport.write(b"%s%s\r\n%s" % (STATUS_LINE[status], lines, body))
        self.transport.write_eof()  # closed while the client still sends, it would lose the answer


_BACKLOG = 2048
_GRACE = 2  # seconds for answers under way when it ends


def run(settings: Settings, on_start: Callable[[str], None]) -> None:
    """Serve until interrupted.

    Parameters
    ----------
    settings : Settings
    on_start : callable
        Called with the address once the service listens.

    Raises
    ------
    TwolinkError
        The address is taken, or the data folder cannot be used.
    """
    from twolink.parts.service.http.app import build

    configure(settings.log)
    with contextlib.suppress(KeyboardInterrupt), _listening(settings) as listening:
        host = f"[{settings.host}]" if ":" in settings.host else settings.host
        url = f"http://{host}:{listening.getsockname()[1]}/"
        app = build(settings)
        server = _Server(uvicorn.Config(app, **uvicorn_options(settings)), app.service, lambda: on_start(url))
        server.run(sockets=[listening])
        if not server.started:
            raise TwolinkError("the service could not start", where="serve", remedy="its log has the reason")


class _Server(uvicorn.Server):
    """uvicorn's server. on_start: called when requests are answered."""

    def __init__(self, config: uvicorn.Config, service: Service, on_start: Callable[[], None]) -> None:
        super().__init__(config)
        self._service, self._on_start = service, on_start

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Start the application, and listen."""
        await super().startup(sockets)
        if self.started:
            self._on_start()

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Tell those who wait for a job, then end as uvicorn does: answers under way have _GRACE seconds."""
        for server in self.servers:
            server.close()
        await self._service.drain()
        await super().shutdown(sockets)


def _listening(settings: Settings) -> socket.socket:
    """The socket to listen on. Raises TwolinkError."""
    family = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
    try:
        return socket.create_server((settings.host, settings.port), family=family, backlog=_BACKLOG)
    except OSError as error:
        what = f"{settings.host}:{settings.port} cannot be listened on: {error.strerror or error}"
        raise TwolinkError(what, where="serve", code="address-in-use", remedy="give another --port or --host") from None


def uvicorn_options(settings: Settings) -> dict[str, Any]:
    """The options of uvicorn.Config."""
    connections = Shares(min(settings.quotas.connections, open_files() - _OTHER_FILES))
    return {
        "http": functools.partial(Protocol, connections, settings.quotas),
        "ws": LiveProtocol,
        "ws_max_size": MESSAGE_BYTES,
        "ws_per_message_deflate": False,
        "log_level": "error",  # a warning for each malformed request would fill the log
        "log_config": None,  # its messages go where ours go
        "access_log": False,
        "server_header": False,
        "lifespan": "on",
        "proxy_headers": False,
        "timeout_keep_alive": 30,
        "timeout_graceful_shutdown": _GRACE,
    }
