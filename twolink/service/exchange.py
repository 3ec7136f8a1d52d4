"""A file in memory that the service and a worker process have open: pipes take three times as long for large bodies."""

import asyncio
import contextlib
import os
import tempfile

from twolink.service.admission import hold

_SLICE = 2**19  # bytes copied at once: the event loop waits for a millisecond, for several where cores are busy
_KEPT = 2**24  # bytes of the file that stay allocated from task to task


class Exchange:
    """Where the content of a request goes to a worker, and an answer comes back.

    name: what the worker opens: a file descriptor, or a path. inherited: descriptors that the worker inherits.
    """

    def __init__(self) -> None:
        self.inherited: tuple[int, ...] = ()
        if hasattr(os, "memfd_create"):
            self._file = os.memfd_create("twolink")
            self.name, self.inherited = str(self._file), (self._file,)
        else:  # not Linux
            self._file, self.name = tempfile.mkstemp()

    async def put(self, content: bytes) -> None:
        """Make this the content of the file."""
        os.ftruncate(self._file, len(content))
        os.lseek(self._file, 0, os.SEEK_SET)
        view = memoryview(content)
        while view:
            view = view[os.write(self._file, view[:_SLICE]) :]
            await asyncio.sleep(0)

    async def take(self) -> bytes:
        """The content of the file. Raises Refusal when there is no room for it."""
        size, parts = os.fstat(self._file).st_size, []
        hold().add(2 * size)  # in pieces and whole
        os.lseek(self._file, 0, os.SEEK_SET)
        while part := os.read(self._file, _SLICE):
            parts.append(part)
            await asyncio.sleep(0)
        if size > _KEPT:
            os.ftruncate(self._file, 0)
        return parts[0] if len(parts) == 1 else await asyncio.to_thread(b"".join, parts)

    def close(self) -> None:
        """Give the memory back."""
        os.close(self._file)
        if not self.inherited:
            with contextlib.suppress(OSError):
                os.unlink(self.name)
