"""HTTP on uvicorn, with patience that ends: a client that does not finish its request in time is let go."""

from __future__ import annotations

from asyncio.events import TimerHandle
from typing import Any

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol


class Protocol(HttpToolsProtocol):
    """uvicorn's protocol waits for ever for headers and bodies; it limits only the time between requests.

    seconds: that a request may take to come, from the connection or its first byte on.
    """

    seconds = 120.0
    _timer: TimerHandle | None = None
    _incomplete = True

    def connection_made(self, transport: Any) -> None:
        """A client has connected."""
        super().connection_made(transport)
        self._timer = self.loop.call_later(self.seconds, self._let_go)

    def data_received(self, data: bytes) -> None:
        """Some bytes have come: most often whole requests, for which no clock is started."""
        super().data_received(data)
        if not self._incomplete:
            self._stop()
        elif self._timer is None:
            self._timer = self.loop.call_later(self.seconds, self._let_go)

    def on_message_begin(self) -> None:
        """A request begins."""
        self._incomplete = True
        super().on_message_begin()

    def on_message_complete(self) -> None:
        """All of it is here."""
        self._incomplete = False
        super().on_message_complete()

    def connection_lost(self, exc: Exception | None) -> None:
        """The client has gone."""
        self._stop()
        super().connection_lost(exc)

    def _stop(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _let_go(self) -> None:
        self._timer = None
        if not self.transport.is_closing():
            self.transport.close()
