"""Output of the service to stderr: a line for each request, and what its operator must know; as text or as JSON."""

import contextlib
import itertools
import logging
import os
import re
import secrets
import threading
from collections import deque
from contextvars import ContextVar
from datetime import UTC, datetime
from typing import Literal

import msgspec

REQUEST_ID: ContextVar[str] = ContextVar("REQUEST_ID", default="")
_SANE = re.compile(rb"[A-Za-z0-9._-]{1,64}")
_START, _COUNT = secrets.token_hex(4), itertools.count(1)
LogForm = Literal["text", "json", "off"]
_LONGEST_PATH = 300
_DELAY = 0.2  # seconds in which lines are gathered, so that writing costs little
_MOST_LINES = 50_000
_LAST_WORDS = 2.0  # seconds to write what waits at the end


def request_id(sent: bytes) -> str:
    """The id that a proxy has sent, if it is a plain one, or else a new one."""
    return sent.decode() if _SANE.fullmatch(sent) else f"{_START}-{next(_COUNT):x}"


class Answered(msgspec.Struct):
    """A request that was answered. time: seconds since 1970 at its begin. bytes: of the answer's body.

    owner: of its token, "" where it has no name.
    """

    time: float
    request_id: str
    client: str
    method: str
    path: bytes
    status: int = 0
    bytes: int = 0
    seconds: float = 0.0
    owner: str = ""


def _stamp(seconds: float) -> str:
    """A time in UTC, as RFC 3339 writes it."""
    return datetime.fromtimestamp(seconds, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


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
    logging.getLogger("uvicorn.error").addFilter(lambda record: record.args != (0,))  # "Cancel 0 running task(s)"
    handler = logging.StreamHandler()
    handler.setFormatter(_Json() if form == "json" else _Text())
    logging.basicConfig(level=logging.WARNING, handlers=[handler], force=True)


class AccessLog:
    """A line for each request, written by a thread: a reader of stderr that stops must not stop the service.

    file: the descriptor it writes to. most: lines that wait to be written; more are dropped, and counted.
    """

    def __init__(self, form: LogForm, file: int = 2, most: int = _MOST_LINES) -> None:
        self._on = form != "off"
        self._line = _json_line if form == "json" else _text_line
        self._file, self._most, self._dropped = file, most, 0
        self._waiting: deque[Answered] = deque()
        self._has_lines, self._ending = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._write, name="twolink-log", daemon=True)
        self._thread.start()

    def note(self, entry: Answered) -> None:
        """Write a line soon."""
        if not self._on:
            return
        if len(self._waiting) >= self._most:
            self._dropped += 1
            return
        entry.path = entry.path[:_LONGEST_PATH]
        self._waiting.append(entry)
        if not self._has_lines.is_set():
            self._has_lines.set()

    def _write(self) -> None:
        is_last = False
        while not is_last:
            self._has_lines.wait()
            is_last = self._ending.wait(_DELAY)
            self._has_lines.clear()
            dropped, self._dropped = self._dropped, 0
            lines = "".join([self._line(self._waiting.popleft()) for _ in range(len(self._waiting))]).encode()
            with contextlib.suppress(OSError):  # stderr is closed: there is nobody to tell
                while lines:  # not by sys.stderr: no lock of it may be held where this thread is left behind
                    lines = lines[os.write(self._file, lines) :]
            if dropped:
                logging.getLogger("twolink.service").warning("%d lines of the access log were dropped", dropped)

    def close(self) -> None:
        """Write what waits, unless nobody reads it."""
        self._ending.set()
        self._has_lines.set()
        self._thread.join(_LAST_WORDS)


def _json_line(entry: Answered) -> str:
    content = {**msgspec.structs.asdict(entry), "time": _stamp(entry.time), "path": _path(entry.path)}
    return msgspec.json.encode(content).decode() + "\n"


def _text_line(entry: Answered) -> str:
    return (
        f"{_stamp(entry.time)} {entry.client} {entry.owner or '-'} {entry.method} {_path(entry.path)} {entry.status} "
        f"{entry.bytes} bytes {entry.seconds * 1e3:.1f} ms {entry.request_id}\n"
    )


def _path(raw: bytes) -> str:
    """The path of a request as it was sent, without anything that ends a line."""
    text = raw.decode("ascii", "backslashreplace")
    return text if text.isprintable() else ascii(text)
