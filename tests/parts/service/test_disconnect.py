"""A client that goes: what it asked for ends, and nothing is reported as a failure of the service."""

import asyncio
import contextlib
from collections.abc import Awaitable, Callable, Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest
import uvicorn
from uvicorn.server import ServerState

from twolink.parts.service.http.app import build
from twolink.parts.service.http.server import uvicorn_options
from twolink.parts.service.settings import Settings

Send = Callable[[Any], Awaitable[None]]
QUERY = "/v1/robots/two_link/bias"


@pytest.fixture
def shell(tmp_path: Path) -> Iterator[Any]:
    shell = build(Settings(str(tmp_path)))
    with contextlib.closing(shell.service.store):
        yield shell


async def ask(shell: Any, method: str, path: str, body: bytes, send: Send, gone: asyncio.Event) -> None:
    """A request as uvicorn hands it on; the client goes when `gone` is set."""
    messages = [{"type": "http.request", "body": body, "more_body": False}]

    async def receive() -> dict[str, Any]:
        if not messages:
            await gone.wait()
        return messages.pop() if messages else {"type": "http.disconnect"}

    headers = [(b"host", b"localhost"), (b"content-type", b"application/json")]
    scope = {
        "type": "http", "method": method, "path": path, "raw_path": path.encode(), "query_string": b"",
        "scheme": "http", "headers": headers,
        "client": ("127.0.0.1", 5), "server": ("127.0.0.1", 80), "root_path": "", "state": {},
        "asgi": {"version": "3.0"}, "http_version": "1.1",
    }  # fmt: skip
    await shell(scope, receive, send)


@pytest.mark.parametrize("path", ["/v1/scenes/explain", QUERY])
def test_what_a_client_asked_for_ends_when_it_goes(shell: Any, path: str, monkeypatch: pytest.MonkeyPatch) -> None:
    begun, ends = asyncio.Event(), []

    async def wait(*_: Any, **__: Any) -> Any:
        begun.set()
        try:
            await asyncio.Event().wait()
        except asyncio.CancelledError:
            ends.append("cancelled")
            raise

    async def work() -> None:
        gone = asyncio.Event()
        body = msgspec.json.encode({"scene": "arm-swing"} if "scenes" in path else {"q": [[0, 0]] * 3000})
        task = asyncio.create_task(ask(shell, "POST", path, body, nothing, gone))
        await begun.wait()
        gone.set()
        await task

    async def nothing(_: Any) -> None:
        pass

    monkeypatch.setattr("twolink.parts.service.work.worker_pool.Workers.exchange", wait)
    asyncio.run(asyncio.wait_for(work(), 30))
    assert ends == ["cancelled"]


@pytest.mark.anyio
async def test_what_is_sent_to_a_connection_that_has_just_ended_is_dropped(tmp_path: Path) -> None:
    class Closed(asyncio.Transport):
        """uvloop's, after its end."""

        def is_closing(self) -> bool:
            return True

        def close(self) -> None:
            pass

        def write(self, _: Any) -> None:
            raise RuntimeError("unable to perform operation on <TCPTransport closed=True>; the handler is closed")

    config = uvicorn.Config(build, **uvicorn_options(Settings(str(tmp_path))))
    config.load()
    make = config.http_protocol_class
    protocol = make(config=config, server_state=ServerState(), app_state={}, _loop=asyncio.get_running_loop())  # type: ignore[call-arg]
    protocol.connection_made(Closed())
    protocol.transport.write(b"too late")
    protocol.connection_lost(None)
