"""HTTP on uvicorn, with a limit of the time that a request may take to arrive."""

from asyncio.events import TimerHandle
from typing import Any

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol


class Protocol(HttpToolsProtocol):
    """uvicorn's protocol waits without limit for headers and bodies; it limits only the time between requests.

    seconds: that a request may take to arrive, from the connection or its first byte on.
    """

    seconds = 120.0
    _timer: TimerHandle | None = None

    def connection_made(self, transport: Any) -> None:
        """A client has connected."""
        super().connection_made(transport)
        self._start_timer()

    def on_message_begin(self) -> None:
        """A request begins."""
        self._start_timer()
        super().on_message_begin()

    def on_message_complete(self) -> None:
        """The whole request has arrived."""
        self._stop_timer()
        super().on_message_complete()

    def connection_lost(self, exc: Exception | None) -> None:
        """The client has gone."""
        self._stop_timer()
        super().connection_lost(exc)

    def _start_timer(self) -> None:
        self._stop_timer()
        self._timer = self.loop.call_later(self.seconds, self.transport.close)

    def _stop_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
