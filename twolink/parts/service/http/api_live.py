"""/v1/live: a simulation that a client watches and pulls, over a WebSocket.

The client sends a LiveRequest, and then `LiveWords` when it likes, as JSON; the service sends frames in real time. What
cannot be is told as {"problem": ...}: of a message, and the simulation goes on; of the simulation, and it has ended.
"""

import asyncio
import contextlib
from typing import Any

import msgspec
from litestar import WebSocket, websocket
from litestar.exceptions import WebSocketDisconnect
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

from twolink.parts.service.http.components import Shared
from twolink.parts.service.http.messages import BEARER, LIVE
from twolink.parts.service.problems import Refusal, decode_unique, encode, problem_of
from twolink.parts.service.work.requests import LiveRequest, LiveWords
from twolink.parts.service.work.sharing import busy, client_of_scope

FIRST = 10.0  # seconds for the request
LEAVES = 2.0  # s: how long a newcomer waits for a place, and who is told goodbye may stay
MESSAGES = 500  # of a client in a second, on the mean
WORDS_BYTES, MESSAGE_BYTES = 16_384, 2**20  # of words, and of the request before them
READ = 10.0  # seconds in which a client must take a frame
_END = {"end": True}


class LiveProtocol(WebSocketsSansIOProtocol):
    """A WebSocket as uvicorn has it, which waits 10 s for the answer to a close that a client may never give."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.close_timeout = LEAVES


class Session:
    """A client's connection while its simulation runs."""

    def __init__(self, socket: WebSocket[Any, Any, Any], rate: float) -> None:
        self._socket, self._period, self._words = socket, 1.0 / rate, LiveWords()
        self._next, self._gone = 0.0, False
        self._problem: dict[str, Any] = {}

    async def read(self) -> None:
        """Take messages until the client goes; the last one counts."""
        loop, count, start = asyncio.get_running_loop(), 0, asyncio.get_running_loop().time()
        try:
            while True:
                text = await self._socket.receive_text()
                count += 1
                if count > MESSAGES * (1.0 + loop.time() - start):
                    self._problem = {"problem": problem_of(busy(f"more than {MESSAGES} messages a second", "message"))}
                    return
                self._hear(text)
        except WebSocketDisconnect:
            pass
        finally:
            self._gone = True

    def _hear(self, text: str) -> None:
        try:
            if len(text) > WORDS_BYTES:
                raise Refusal(413, f"a message has more than {WORDS_BYTES} characters", where="message",
                              remedy="send tau and drag alone")  # fmt: skip
            self._words = decode_unique(text.encode(), LiveWords)
        except Exception as error:
            self._problem = {"problem": problem_of(error)}

    async def reply(self, frame: dict[str, Any]) -> dict[str, Any]:
        """Show a frame, wait until its time is over, and tell what acts then."""
        shown, self._problem = {**frame, **self._problem}, {}
        try:
            async with asyncio.timeout(READ):
                await send(self._socket, shown)
        except (TimeoutError, WebSocketDisconnect, RuntimeError):
            return _END
        now = asyncio.get_running_loop().time()
        self._next = max(self._next, now - self._period) + self._period  # it is slow, and does not catch up
        await asyncio.sleep(self._next - now)
        return _END if self._gone else msgspec.to_builtins(self._words)


async def send(socket: WebSocket[Any, Any, Any], message: dict[str, Any]) -> None:
    """Send JSON."""
    await socket.send_text(encode(message).decode())


@websocket(LIVE)
async def live(socket: WebSocket[Any, Any, Any], service: Shared) -> None:
    """A live simulation: one a connection."""
    await socket.accept(subprotocols=BEARER if BEARER in socket.scope["subprotocols"] else None)
    client = client_of_scope(socket.scope)
    with contextlib.suppress(WebSocketDisconnect, RuntimeError):  # it has gone
        try:
            await _run(socket, service, client)
        except WebSocketDisconnect:
            raise
        except Exception as error:
            await send(socket, {"problem": problem_of(error)})
        await socket.close()


async def _take_place(service: Shared, client: str) -> None:
    """Take a place, of those that a page that is loaded again, say, is about to leave. Raises busy."""
    full = busy(f"{service.lives.taken} simulations are live already", "connection")
    if not service.newcomers.take(client):
        raise full
    try:
        async with asyncio.timeout(LEAVES):
            while not service.lives.take(client):
                await asyncio.sleep(0.05)
    except TimeoutError:
        raise full from None
    finally:
        service.newcomers.give(client)


async def _run(socket: WebSocket[Any, Any, Any], service: Shared, client: str) -> None:
    """Run a client's simulation. Raises its failure."""
    await _take_place(service, client)
    try:
        try:
            async with asyncio.timeout(FIRST):
                body = (await socket.receive_text()).encode()
        except TimeoutError:
            raise Refusal(408, "no request has come", where="message", remedy="send a scene") from None
        await service.store.bring_robots(body)
        session = Session(socket, decode_unique(body, LiveRequest).frames_per_second)
        reading = asyncio.create_task(session.read())
        try:
            await service.live.run("live", service.quotas.job_seconds, on_question=session.reply, body=body,
                                   robots=service.robots.folder)  # fmt: skip
        finally:
            reading.cancel()
            await asyncio.gather(reading, return_exceptions=True)
    finally:
        service.lives.give(client)
