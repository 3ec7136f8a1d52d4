"""The one place where failures become answers: problem+json (RFC 9457) with what, where and remedy."""

from __future__ import annotations

import logging
import re
from collections.abc import Mapping
from http import HTTPStatus
from typing import Any

import msgspec

from twolink import errors

MEDIA_TYPE = "application/problem+json"
_log = logging.getLogger("twolink.service")
_REFUSED = 422

_STATUS: dict[type[errors.TwolinkError], int] = {
    errors.CertificationError: 500,
    errors.MissingExtraError: 501,
}
_PATH = re.compile(r" - at `(?:key in )?\$?\.?(.*)`$", re.DOTALL)


class Problem(msgspec.Struct, omit_defaults=True):
    """A failure, as RFC 9457 has it. detail: what went wrong; where: the place in the request; remedy: what to do.

    type: "urn:twolink:" and the kind of the error. retry_after: seconds after which the same request may be answered.
    """

    type: str
    title: str
    status: int
    detail: str
    where: str = ""
    remedy: str = ""
    retry_after: float | None = None


class Refusal(errors.TwolinkError):
    """A request that is refused as a request, with an HTTP status of its own."""

    def __init__(
        self, status: int, what: str, *, where: str = "", remedy: str = "", retry_after: float | None = None
    ) -> None:
        super().__init__(what, where=where, remedy=remedy)
        self.status, self.retry_after = status, retry_after


def problem_of(error: BaseException) -> Problem:
    """Any failure as a Problem. What nobody foresaw is logged with its traceback, and the answer says no more."""
    if isinstance(error, Refusal):
        kind = _slug(HTTPStatus(error.status).phrase)
        return _problem(kind, error.status, error.what, error.where, error.remedy, error.retry_after)
    if isinstance(error, errors.TwolinkError):
        status = next((s for kind, s in _STATUS.items() if isinstance(error, kind)), _REFUSED)
        return _problem(_slug_of(type(error)), status, error.what, error.where, error.remedy)
    if isinstance(error, msgspec.MsgspecError):
        return _of_msgspec(error)
    if isinstance(error, UnicodeDecodeError):
        return _problem("bad-request", 400, "it is not UTF-8 text", "body", "send JSON in UTF-8")
    if isinstance(error, RecursionError):
        return _problem("bad-request", 400, "the body is nested too deep", "body", "send plain lists and objects")
    status = getattr(error, "status_code", 500)
    if isinstance(status, int) and 400 <= status < 500:
        return _of_framework(error, status)
    _log.error("unforeseen failure", exc_info=error)
    what = "the service has failed; the failure is in its log"
    return _problem("internal-error", 500, what, "", "report it, with the request that caused it")


def _of_msgspec(error: Exception) -> Problem:
    what, where = split_path(str(error))
    schema = isinstance(error, msgspec.ValidationError)
    remedy = "see the API's description: /docs" if schema else "send JSON in UTF-8"
    return _problem("bad-request", 400, what, where or "body", remedy)


def split_path(message: str) -> tuple[str, str]:
    """msgspec's message as what is wrong, and the path in the body."""
    found = _PATH.search(message)
    return (message[: found.start()], found.group(1)) if found else (message, "")


def _of_framework(error: BaseException, status: int) -> Problem:
    """Litestar's own refusals: no such path, a method it has not, a parameter that does not fit."""
    extra = getattr(error, "extra", None)
    first = extra[0] if isinstance(extra, list) and extra and isinstance(extra[0], Mapping) else {}
    what = str(first.get("message") or getattr(error, "detail", "") or HTTPStatus(status).phrase)
    what, path = split_path(what)
    source = str(first.get("source") or "")
    key = str(first.get("key") or "")
    where = path or (f"{source}: {key}" if source and source != "body" and key else key) or "request"
    return _problem(_slug(HTTPStatus(status).phrase), status, what, where, "see the API's description: /docs")


def _problem(kind: str, status: int, what: str, where: str, remedy: str, retry_after: float | None = None) -> Problem:
    return Problem(f"urn:twolink:{kind}", HTTPStatus(status).phrase, status, what, where, remedy, retry_after)


def _slug_of(kind: type[errors.TwolinkError]) -> str:
    """RobotError is robot-error."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "-", kind.__name__).lower()


def _slug(phrase: str) -> str:
    return re.sub(r"[^a-z]+", "-", phrase.lower()).strip("-")


def answer_of(problem: Problem) -> tuple[int, list[tuple[bytes, bytes]], bytes]:
    """A Problem as an HTTP answer: status, headers, body."""
    headers = [(b"content-type", MEDIA_TYPE.encode())]
    if problem.retry_after is not None:
        headers.append((b"retry-after", str(max(1, round(problem.retry_after))).encode()))
    if problem.status == 401:
        headers.append((b"www-authenticate", b"Bearer"))
    return problem.status, headers, msgspec.json.encode(problem)


def error_from(content: Mapping[str, Any]) -> errors.TwolinkError:
    """The TwolinkError that a problem+json body tells of: the other direction, for clients."""
    name = str(content.get("type", "")).rpartition(":")[2]
    found = (kind for kind in vars(errors).values() if isinstance(kind, type))
    kinds = {_slug_of(kind): kind for kind in found if issubclass(kind, errors.TwolinkError)}
    kind = kinds.get(name, errors.TwolinkError)
    what = str(content.get("detail") or content.get("title") or "the service refused it")
    return kind(what, where=str(content.get("where", "")), remedy=str(content.get("remedy", "")))
