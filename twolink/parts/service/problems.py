"""Failures as HTTP answers, and back: problem+json (RFC 9457) with code, argument and data of the TwolinkError.

JSON objects that name a key twice are refused: of two values, decoders take the last one without a word.
"""

import contextlib
import errno
import json
import logging
import operator
import sqlite3
from collections.abc import Iterator, Mapping
from http import HTTPStatus
from typing import Any, TypeVar

import msgspec
import numpy as np

from twolink import errors
from twolink.errors import TwolinkError
from twolink.io.schemas import misfit, split_path
from twolink.parts.service.logs import REQUEST_ID

JSON = "application/json"
MEDIA_TYPE = "application/problem+json"
_log = logging.getLogger("twolink.service")
_TYPES = {
    kind: "twolink-error" if kind is TwolinkError else f"{kind.code}-error"
    for kind in vars(errors).values()
    if isinstance(kind, type) and issubclass(kind, TwolinkError)
}
_CLASSES = {name: kind for kind, name in _TYPES.items()}
_NOT_DATA = ("self", "what", "status", "retry_after", "run")  # arguments of their own
_STORAGE_ERRORS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EIO)
_LONGEST = 2000  # letters
_SEE_DOCS = "see the API's description: /docs"
_TO_LIST = operator.methodcaller("tolist")
T = TypeVar("T")


class Problem(msgspec.Struct, frozen=True, omit_defaults=True):
    """A failure as RFC 9457 defines it, with the fields of a TwolinkError.

    type: "urn:twolink:" and the class of the error. detail: what went wrong. where: the place in the request. remedy:
    what to do. code, argument, data: for programs, see TwolinkError. retry_after: seconds after which to ask again.
    request_id: by which the service's log names the request.
    """

    type: str
    title: str
    status: int
    detail: str
    where: str = ""
    remedy: str = ""
    code: str = ""
    argument: str = ""
    data: dict[str, Any] = {}
    retry_after: float | None = None
    request_id: str = ""


class Refusal(TwolinkError):
    """A request that is refused with an HTTP status of its own. Its code, unless set, names the status: "not-found"."""

    def __init__(
        self, status: int, what: str, *, code: str = "", retry_after: float | None = None, **parts: Any
    ) -> None:
        super().__init__(what, code=code or HTTPStatus(status).phrase.lower().replace(" ", "-"), **parts)
        self.status, self.retry_after = status, retry_after


def ending() -> Refusal:
    """The refusal of all that is asked of a service that ends."""
    remedy = "ask again in some seconds: it takes its jobs up when it starts"
    return Refusal(503, "the service is ending", code="ending", where="request", remedy=remedy, retry_after=5)


@contextlib.contextmanager
def kept(what: str, remedy: str) -> Iterator[None]:
    """A part that reads what the service has written: that it cannot is the service's fault, not the request's.

    Raises Refusal (500, code "damaged-storage"), whose reason is for the log. What the system refuses is passed on.
    """
    try:
        yield
    except (MemoryError, OSError):
        raise
    except Exception as error:
        raise Refusal(500, f"{what} is damaged on the service's disk", code="damaged-storage", remedy=remedy) from error


def problem_of(error: BaseException) -> Problem:
    """Describe any failure. An unexpected one is logged with its traceback, and the answer has no details."""
    failure = error if isinstance(error, TwolinkError) else _refusal_of(error)
    if isinstance(failure, errors.CertificationError):  # of a request that asks for the impossible, or a fault of ours
        _log.error("not certified: %s", failure)
    if failure.code == "not-writable":  # no file that a client names is ever written
        failure = _storage_failure(failure.what)
    if isinstance(failure, Refusal):
        name, status, retry_after = failure.code, failure.status, failure.retry_after
    else:
        kind = next(kind for kind in type(failure).__mro__ if kind in _TYPES)
        name, status, retry_after = _TYPES[kind], 501 if kind is errors.MissingExtraError else 422, None
    data = {key: value.item() if isinstance(value, np.generic) else value for key, value in failure.data.items()}
    return Problem(
        f"urn:twolink:{name}", HTTPStatus(status).phrase, status, _cut(failure.what), _cut(failure.where),
        _cut(failure.remedy), failure.code, _cut(failure.argument), data, retry_after,
    )  # fmt: skip


def _cut(text: str) -> str:
    """A text without what makes it longer than anybody reads: messages quote values, which may be of any length."""
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]} ..."


def _refusal_of(error: BaseException) -> Refusal:
    """The refusal for an exception of a library."""
    if isinstance(error, msgspec.MsgspecError):
        what, where = split_path(str(error))
        remedy = _SEE_DOCS if isinstance(error, msgspec.ValidationError) else "send JSON in UTF-8"
        return Refusal(400, what, where=where or "body", remedy=remedy)
    if isinstance(error, UnicodeDecodeError):
        return Refusal(400, "the body is not UTF-8 text", where="body", remedy="send JSON in UTF-8")
    if isinstance(error, RecursionError):
        return Refusal(400, "the body is nested too deep", where="body", remedy="send plain lists and objects")
    if isinstance(error, OSError) and error.errno == errno.EIO:  # its text has addresses, which are the operator's
        return _storage_failure(str(error), "what keeps its data does not answer")
    if isinstance(error, sqlite3.Error) or (isinstance(error, OSError) and error.errno in _STORAGE_ERRORS):
        return _storage_failure(getattr(error, "strerror", "") or str(error))
    status = getattr(error, "status_code", 500)
    if isinstance(status, int) and 400 <= status < 500:
        return _refusal_of_litestar(error, status)
    _log.error("unexpected failure", exc_info=error)
    what = "the service has failed; its log has the details"
    return Refusal(500, what, code="internal-error", remedy="report it, with the request that caused it")


def _storage_failure(reason: str, shown: str = "") -> Refusal:
    """The refusal when what is kept cannot be read or written. shown: to clients, in place of the reason."""
    _log.error("what is kept cannot be read or written: %s", reason)
    what, remedy = f"the service's storage has failed: {shown or reason}", "try again when its operator has made room"
    return Refusal(503, what, code="storage-failed", remedy=remedy, retry_after=30)


def _refusal_of_litestar(error: BaseException, status: int) -> Refusal:
    """Litestar refuses unknown paths, wrong methods, and parameters of the wrong type."""
    extra = getattr(error, "extra", None)
    first = extra[0] if isinstance(extra, list) and extra and isinstance(extra[0], Mapping) else {}
    what, path = split_path(str(first.get("message") or getattr(error, "detail", "") or HTTPStatus(status).phrase))
    source, key = (getattr(first.get(name), "value", first.get(name)) or "" for name in ("source", "key"))
    where = path or (f"{source}: {key}" if source and source != "body" and key else key) or "request"
    return Refusal(status, what, where=where, remedy=_SEE_DOCS)


def answer_of(error: BaseException) -> tuple[int, list[tuple[bytes, bytes]], bytes]:
    """Status, headers and body of the HTTP answer to a failure."""
    problem = msgspec.structs.replace(problem_of(error), request_id=REQUEST_ID.get())
    headers = [(b"content-type", MEDIA_TYPE.encode())]
    if problem.retry_after is not None:
        headers.append((b"retry-after", str(max(1, round(problem.retry_after))).encode()))
    if problem.status == 405 and "allow" in problem.data:
        headers.append((b"allow", str(problem.data["allow"]).encode()))
    if problem.status == 401:
        headers.append((b"www-authenticate", b"Bearer"))
    return problem.status, headers, msgspec.json.encode(problem)


def error_from(problem: Problem) -> TwolinkError:
    """The failure that a problem describes, such that `problem_of` gives the same problem again."""
    kind = _CLASSES.get(problem.type.rpartition(":")[2])
    parts: dict[str, Any] = {
        **{key: value for key, value in problem.data.items() if key not in _NOT_DATA},
        "where": problem.where, "remedy": problem.remedy, "code": problem.code, "argument": problem.argument,
    }  # fmt: skip
    if kind is not None:
        return kind(problem.detail, **parts)
    return Refusal(problem.status, problem.detail, retry_after=problem.retry_after, **parts)


def encode(content: Any) -> bytes:
    """JSON. NumPy's arrays become lists, and its scalars numbers."""
    return msgspec.json.encode(content, enc_hook=_TO_LIST)


def decode_unique(body: bytes, kind: type[T]) -> T:
    """Decode JSON. Raises as `decode_body`, and Refusal where a key comes twice."""
    decoded = decode_body(body, kind)
    require_unique_keys(body)
    return decoded


def decode_body(body: bytes, kind: type[T]) -> T:
    """Decode JSON. Raises msgspec.DecodeError, and Refusal where it does not fit."""
    try:
        return msgspec.json.decode(body, type=kind)
    except msgspec.ValidationError as error:
        raise misfit_refusal(error, kind) from None


def misfit_refusal(error: msgspec.ValidationError, kind: Any) -> Refusal:
    """The refusal of a body that does not fit its type."""
    what, where, remedy = misfit(error, kind)
    return Refusal(400, what, where=where or "body", remedy=remedy or _SEE_DOCS)


def require_unique_keys(body: bytes, strings: int | None = None) -> None:
    """Raise Refusal (400) if an object in the JSON names a key twice.

    A repeated key is lost in decoding, and the quotes around it with it, so that counting quotes is enough. strings:
    how many strings, keys included, were decoded from the body, if that is known.
    """
    if strings is not None and body.count(b'"') == 2 * strings:
        return
    if b"\\u0022" in body or body.count(b'"') != msgspec.json.encode(msgspec.json.decode(body)).count(b'"'):
        json.loads(body, object_pairs_hook=_unique)


def _unique(pairs: list[tuple[str, Any]]) -> None:
    seen = set()
    for name, _ in pairs:
        if name in seen:
            raise Refusal(400, f"the key {name[:80]!r} is given twice", where="body", remedy="give it once")
        seen.add(name)
