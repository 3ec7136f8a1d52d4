"""HTTP as the client speaks it: kept connections, one time limit a request, and retries where they are safe."""

import email.utils
import functools
import http.client
import math
import socket
import ssl
import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any
from urllib.parse import SplitResult, quote, urlsplit

import msgspec

from twolink.dynamics.arguments import positive
from twolink.errors import TwolinkError
from twolink.parts.service import problems
from twolink.parts.service.problems import Problem, error_from

_BUSY = (429, 503)  # answers before anything was done: the request may be sent again
_SHORTEST_WAIT = 0.1  # seconds
_SMALL = 2**14  # bytes of a body that goes with the head
_REPEATABLE = ("GET", "HEAD", "OPTIONS", "PUT", "DELETE")  # RFC 9110, 9.2.2: twice is as good as once
_CHECK_ADDRESS = "check that the address is that of a twolink service"


class Transport:
    """Sends requests to one service, for any number of threads. url, token, timeout: see `twolink.connect`."""

    def __init__(self, url: str, token: str | None, timeout: float) -> None:
        self._idle: deque[_Connection] = deque()
        self._parts, self._port = _address(url)
        self._path = quote(self._parts.path.rstrip("/"), safe="/%")
        self.url = f"{self._parts.scheme}://{self._parts.netloc}{self._path}"
        self.timeout = positive(timeout, "timeout", TwolinkError, "give seconds")
        if token is not None and not (isinstance(token, str) and _is_plain(token or "x")):
            what, remedy = "a token has letters, digits and signs of ASCII only", "copy it again, without blanks"
            raise TwolinkError(what, argument="token", remedy=remedy)
        self._headers = {"Authorization": f"Bearer {token}"} if token else {}

    def close(self) -> None:
        """Close the connections that are not in use. The next request opens another."""
        while self._idle:
            self._idle.pop().close()

    def __del__(self) -> None:
        self.close()

    def request(
        self, method: str, path: str, body: bytes | None, media: str, accept: str, *, repeatable: bool = False
    ) -> tuple[str, bytes]:
        """The media type and the content of an answer, in at most `timeout` seconds, waits and retries included.

        A request that the service is too busy for (429 or 503 with Retry-After) is sent again when the service says
        so. One that was lost with a kept connection is sent again, if it is repeatable: its method is, or the caller
        says that twice is as good as once.

        Raises TwolinkError for whatever goes wrong.
        """
        for name, text in (("method", method), ("path", path), ("media", media), ("accept", accept)):
            if not _is_plain(text.replace(" ", "")):
                raise TwolinkError(f"{text!r} cannot be sent", argument=name, remedy="use printable ASCII")
        deadline = time.monotonic() + self.timeout
        headers = {"Accept": accept, "Content-Type": media, **self._headers}
        repeatable = repeatable or method in _REPEATABLE
        ask = functools.partial(self._ask, method, self._path + path, body, headers, deadline)
        while True:
            try:
                answer = self._exchange(ask, repeatable)
            except (OSError, http.client.HTTPException, ValueError) as error:
                raise self._lost(error) from None
            if answer.wait is None or time.monotonic() + answer.wait >= deadline:
                break
            time.sleep(answer.wait)
        if 200 <= answer.status < 300:
            return answer.media, answer.content
        raise error_from(self._problem(answer))

    def _exchange(self, ask: "Callable[[_Connection], _Answer]", repeatable: bool) -> "_Answer":
        """One request, on a connection that is open if there is one."""
        connection = self._open_connection()
        if connection is not None:
            try:
                return ask(connection)
            except ConnectionError:
                if not repeatable:
                    raise
        kind = _TLSConnection if self._parts.scheme == "https" else _Connection
        return ask(kind(self._parts.hostname or "", self._port))

    def _open_connection(self) -> "_Connection | None":
        """A kept connection that the service has not closed meanwhile."""
        while True:
            try:
                connection = self._idle.pop()
            except IndexError:
                return None
            if connection.is_open():
                return connection
            connection.close()

    def _ask(
        self, method: str, path: str, body: bytes | None, headers: Mapping[str, str], deadline: float,
        connection: "_Connection",
    ) -> "_Answer":  # fmt: skip
        connection.deadline = deadline
        try:
            lost: ConnectionError | None = None
            try:
                connection.request(method, path, body, dict(headers))
            except ConnectionError as error:  # it may have refused a body that it did not want to read
                if connection.sock is None:
                    raise
                lost = error
            try:
                response = connection.getresponse()
            except (OSError, http.client.HTTPException) as error:
                raise lost or error from None
            content = response.read()
        except BaseException:
            connection.close()
            raise
        if connection.sock is not None:
            self._idle.append(connection)
        wait = _seconds(response.headers.get("Retry-After", "")) if response.status in _BUSY else None
        return _Answer(response.status, response.headers.get_content_type(), content, wait)

    def _lost(self, error: Exception) -> TwolinkError:
        if isinstance(error, TimeoutError):
            what, remedy = f"no answer within {self.timeout:g} s", "give a longer timeout, or send less at once"
        else:
            what = f"no answer: {getattr(error, 'strerror', None) or str(error) or type(error).__name__}"
            remedy = "is it running? `twolink serve` starts one"
        return TwolinkError(what, where=self.url, code="no-answer", remedy=remedy)

    def _problem(self, answer: "_Answer") -> Problem:
        """The problem that the service sent; one of our own where another server has answered, such as a proxy."""
        try:
            problem = msgspec.json.decode(answer.content, type=Problem)
            if answer.media == problems.MEDIA_TYPE and problem.code:
                return problem
        except msgspec.MsgspecError:
            pass
        what, code = f"HTTP status {answer.status}", "not-twolink"
        return Problem("", "", answer.status, what, self.url, _CHECK_ADDRESS, code, retry_after=answer.wait)

    def not_twolink(self, path: str, what: str) -> TwolinkError:
        """The failure when an answer is not one of a twolink service."""
        what = f"the answer to {path} is not one of twolink: {what}"
        return TwolinkError(what, where=self.url, code="not-twolink", remedy=_CHECK_ADDRESS)


class _Answer(msgspec.Struct):
    """wait: seconds after which a service that is too busy wants to be asked again; None: it does not."""

    status: int
    media: str
    content: bytes
    wait: float | None


class _Connection(http.client.HTTPConnection):
    """A connection on which everything together ends at `deadline` (of time.monotonic).

    A timeout of http.client is one of each system call: a server that sends a byte now and then is waited for without
    end.
    """

    deadline = 0.0
    _head: bytes | None = None  # what waits for the body; None: nothing is to wait

    def connect(self) -> None:
        self.sock = self._dial()

    def request(self, method: str, url: str, body: Any = None, *arguments: Any, **options: Any) -> None:
        """As of http.client, with a small body in one packet with the head: two wake the service twice."""
        self._head = b"" if body and len(body) <= _SMALL else None
        super().request(method, url, body, *arguments, **options)

    def send(self, data: Any) -> None:
        if self._head == b"":
            self._head = data
            return
        if self._head is not None:
            data, self._head = self._head + data, None
        if self.sock is not None:
            self.sock.settimeout(self._left())
        super().send(data)

    def is_open(self) -> bool:
        """True if the other side has not closed it. Nothing may have arrived between two requests."""
        if isinstance(self.sock, ssl.SSLSocket):  # cannot be looked into
            return True
        try:
            self.sock.settimeout(0)
            self.sock.recv(1, socket.MSG_PEEK)
        except BlockingIOError:
            return True
        except OSError:
            pass
        return False

    def _dial(self) -> "_Socket":
        failure = OSError("the name has no address")
        for family, kind, protocol, _, address in socket.getaddrinfo(self.host, self.port, type=socket.SOCK_STREAM):
            sock = _Socket(family, kind, protocol)
            sock.left = self._left
            try:
                sock.settimeout(self._left())
                sock.connect(address)
                sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                return sock
            except OSError as error:
                sock.close()
                failure = error
        raise failure

    def _left(self) -> float:
        """Seconds until the deadline. Raises TimeoutError."""
        seconds = self.deadline - time.monotonic()
        if seconds <= 0.0:
            raise TimeoutError
        return seconds


class _TLSConnection(_Connection):
    """A connection over TLS, certificates checked."""

    def connect(self) -> None:
        context = ssl.create_default_context()
        context.sslsocket_class = _TLSSocket
        sock: Any = context.wrap_socket(self._dial(), server_hostname=self.host)
        sock.left = self._left
        self.sock = sock


class _Timed:
    """A socket that is read within the seconds that `left` says before each read."""

    left: Callable[[], float]

    def recv_into(self: Any, *arguments: Any) -> int:
        self.settimeout(self.left())
        return super().recv_into(*arguments)  # type: ignore[misc,no-any-return]


class _Socket(_Timed, socket.socket):
    pass


class _TLSSocket(_Timed, ssl.SSLSocket):
    pass


def _address(url: str) -> tuple[SplitResult, int]:
    """The parts of an address, and its port. Raises TwolinkError."""
    try:
        parts = urlsplit(url if "://" in url else f"http://{url}")
        port = parts.port or {"http": 80, "https": 443}[parts.scheme]
        host = parts.hostname or ""
        is_host = bool(host.encode("idna")) and parts.netloc.lower().removesuffix(f":{parts.port}") in (
            host,
            f"[{host}]",
        )
        if is_host and len(url.split()) == 1 and not parts.query and not parts.fragment:
            return parts, port
    except (TypeError, AttributeError, ValueError, KeyError):  # no text; a port or an IPv6 address that cannot be
        pass
    raise TwolinkError(f"{url!r:.200} is not an address", argument="url", remedy="such as http://127.0.0.1:8000")


def _is_plain(text: str) -> bool:
    return text.isascii() and text.isprintable() and text != "" and " " not in text


def _seconds(retry_after: str) -> float | None:
    """The seconds of a Retry-After header, which has a number of them or a date; None when it has neither."""
    try:
        seconds = float(retry_after)
    except ValueError:
        try:
            seconds = email.utils.parsedate_to_datetime(retry_after).timestamp() - time.time()
        except (ValueError, OverflowError):
            return None
    return max(seconds, _SHORTEST_WAIT) if math.isfinite(seconds) else None
