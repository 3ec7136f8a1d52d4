"""Event loops in worker processes, which may have no sockets: Zarr needs a loop, and asyncio wakes it by a socket."""

import asyncio
import os
import sys


class _End:
    """An end of a pipe, with what asyncio asks of the sockets by which it wakes its loop."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        os.set_blocking(descriptor, False)

    def fileno(self) -> int:
        return self._descriptor

    def recv(self, size: int) -> bytes:
        return os.read(self._descriptor, size)

    def send(self, content: bytes) -> int:
        return os.write(self._descriptor, content)

    def close(self) -> None:
        os.close(self._descriptor)


class _PipeLoop(asyncio.SelectorEventLoop):
    def _make_self_pipe(self) -> None:
        self._ssock, self._csock = map(_End, os.pipe())
        self._internal_fds += 1  # type: ignore[attr-defined]
        self._add_reader(self._ssock.fileno(), self._read_from_self)  # type: ignore[attr-defined]


class _Policy(asyncio.DefaultEventLoopPolicy):
    def new_event_loop(self) -> asyncio.AbstractEventLoop:
        return _PipeLoop()


def use_pipes() -> None:
    """Have new event loops of this process use pipes in place of sockets, where there are pipes."""
    if sys.platform != "win32":
        asyncio.set_event_loop_policy(_Policy())
