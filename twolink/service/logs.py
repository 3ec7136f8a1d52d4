"""What the service writes to stderr: a line for each request, and what its operator must know; as text or as JSON."""

import asyncio
import functools
import logging
import sys
import time
from collections import deque
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Literal, TextIO

import msgspec

from twolink.service.request_id import REQUEST_ID

LogForm = Literal["text", "json", "off"]
_LONGEST_PATH = 300
_DELAY = 0.2  # seconds in which lines are gathered, so that writing costs little
_MOST_LINES = 50_000


class Answered(msgspec.Struct):
    """A request that was answered. time: seconds since 1970 at its begin. bytes: of the answer's body."""

    time: float
    request_id: str
    client: str
    method: str
    path: str
    status: int = 0
    bytes: int = 0
    seconds: float = 0.0


def _stamp(seconds: float) -> str:
    """A time in UTC, as RFC 3339 writes it."""
    return f"{_whole_seconds(int(seconds))}.{int(seconds % 1 * 1000):03d}Z"


@functools.lru_cache(4)
def _whole_seconds(seconds: int) -> str:
    return time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(seconds))


class _Text(logging.Formatter):
    """twolink: what has happened (the id of its request)."""

    def format(self, record: logging.LogRecord) -> str:
        text, of = super().format(record), REQUEST_ID.get()
        return f"twolink: {text}" + (f" (request {of})" if of else "")


class _Json(logging.Formatter):
    """A JSON object a line."""

    def format(self, record: logging.LogRecord) -> str:
        entry = {"time": _stamp(record.created), "level": record.levelname.lower(), "message": super().format(record)}
        return msgspec.json.encode({**entry, "request_id": REQUEST_ID.get()}).decode()


def configure(form: LogForm) -> None:
    """Let all messages of this process go to stderr in this form. Those of "off" are as text."""
    handler = logging.StreamHandler()
    handler.setFormatter(_Json() if form == "json" else _Text())
    logging.basicConfig(level=logging.WARNING, handlers=[handler], force=True)


class AccessLog:
    """A line for each request, written by a thread: a reader of stderr that stops must not stop the service.

    most: lines that wait to be written; more are dropped, and counted.
    """

    def __init__(self, form: LogForm, stream: TextIO | None = None, most: int = _MOST_LINES) -> None:
        self._on = form != "off"
        self._line = _json_line if form == "json" else _text_line
        self._stream = stream or sys.stderr
        self._thread = ThreadPoolExecutor(1, "twolink-log")
        self._waiting: deque[Answered] = deque()
        self._most, self._dropped = most, 0
        self._writing = False

    def note(self, entry: Answered) -> None:
        """Write a line soon. To be called in the event loop."""
        if not self._on:
            return
        if len(self._waiting) >= self._most:
            self._dropped += 1
            return
        self._waiting.append(entry)
        if not self._writing:
            self._write_soon()

    def _write_soon(self) -> None:
        self._writing = True
        asyncio.get_running_loop().call_later(_DELAY, self._flush)

    def _flush(self) -> None:
        work = asyncio.get_running_loop().run_in_executor(self._thread, self._write)
        work.add_done_callback(self._flushed)

    def _flushed(self, work: asyncio.Future[None]) -> None:
        work.exception()  # stderr is closed: there is nobody to tell
        self._writing = False
        if self._waiting:
            self._write_soon()

    def _write(self) -> None:
        dropped, self._dropped = self._dropped, 0
        lines = [self._line(self._waiting.popleft()) for _ in range(len(self._waiting))]
        self._stream.write("".join(lines))
        self._stream.flush()
        if dropped:
            logging.getLogger("twolink.service").warning("%d lines of the access log were dropped", dropped)

    def close(self) -> None:
        """Write what waits."""
        self._thread.submit(self._write)
        self._thread.shutdown()


def _json_line(entry: Answered) -> str:
    return msgspec.json.encode({**msgspec.structs.asdict(entry), "time": _stamp(entry.time)}).decode() + "\n"


def _text_line(entry: Answered) -> str:
    return (
        f"{_stamp(entry.time)} {entry.client} {entry.method} {entry.path} {entry.status} "
        f"{entry.bytes} bytes {entry.seconds * 1e3:.1f} ms {entry.request_id}\n"
    )


def logged_path(scope: Any) -> str:
    """The path of a request as it was sent, cut where it is long, without anything that ends a line."""
    text = scope.get("raw_path", b"")[:_LONGEST_PATH].decode("ascii", "backslashreplace")
    return text if text.isprintable() else ascii(text)
