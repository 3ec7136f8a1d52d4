"""The id of the request under way, by which its answer, its problem and the log name it."""

import itertools
import re
import secrets
from contextvars import ContextVar

REQUEST_ID: ContextVar[str] = ContextVar("REQUEST_ID", default="")
_SANE = re.compile(rb"[A-Za-z0-9._-]{1,64}")
_START, _COUNT = secrets.token_hex(4), itertools.count(1)


def request_id(sent: bytes) -> str:
    """The id that a proxy has sent, if it is a plain one, or else a new one."""
    return sent.decode() if _SANE.fullmatch(sent) else f"{_START}-{next(_COUNT):x}"
