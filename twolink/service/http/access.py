"""Access control: host names (against DNS rebinding), origins, bearer tokens; and the security headers."""

import hmac
from typing import Any
from urllib.parse import urlsplit

from twolink.service.http.messages import Header, headers_of
from twolink.service.problems import Refusal
from twolink.service.settings import Settings, ip_address

PAGE_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; connect-src 'self'; "
    "font-src 'self'; frame-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
DENY_ALL: Header = (b"content-security-policy", b"default-src 'none'; frame-ancestors 'none'")
_OPEN_PATHS = (
    "/health",
    "/ready",
    "/",
    "/docs",
    "/docs/",
)  # what a browser or a monitor asks for before it has a token
_OPEN_PREFIX = "/page/"
_MAX_HOSTS = 1000  # checked ones that are remembered


class AccessControl:
    """Checks each request before anything else looks at it."""

    def __init__(self, settings: Settings) -> None:
        self._tokens = [token.encode() for token in settings.tokens]
        self._hosts = {"localhost", settings.host.lower(), *(host.lower() for host in settings.hosts)}
        self._origins = {origin.encode() for origin in settings.origins}
        self._checked_hosts: set[bytes] = set()

    def check(self, scope: Any) -> bytes | None:
        """Raise Refusal unless the request may pass. Returns the foreign origin it came from, if one is allowed."""
        headers = headers_of(scope)
        host, origin = headers.get(b"host", b""), headers.get(b"origin")
        if host not in self._checked_hosts:
            self._check_host(host)
        foreign = None if origin is None or _is_own(origin, host) else origin
        if foreign is not None and foreign not in self._origins:
            remedy = "start the service with --allow-origin"
            raise Refusal(403, "pages of other sites may not call it", where="header: Origin", remedy=remedy)
        path: str = scope["path"]
        is_open = scope["method"] == "OPTIONS" or path in _OPEN_PATHS or path.startswith(_OPEN_PREFIX)
        if self._tokens and not is_open:
            self._check_token(headers.get(b"authorization", b""))
        return foreign

    def _check_host(self, host: bytes) -> None:
        """Let addresses and allowed names pass: a site whose name points at this machine must not reach the service."""
        try:
            name = urlsplit(f"//{host.decode('ascii')}").hostname or ""
        except ValueError:
            name = ""
        if name not in self._hosts and ip_address(name) is None:
            remedy = "call it by its address, or start it with --allow-host"
            raise Refusal(421, f"the service has no name {name!r:.80}", where="header: Host", remedy=remedy)
        if len(self._checked_hosts) < _MAX_HOSTS:
            self._checked_hosts.add(host)

    def _check_token(self, authorization: bytes) -> None:
        kind, _, sent = authorization.partition(b" ")
        matches = [hmac.compare_digest(sent.strip(), token) for token in self._tokens]  # all of them: constant time
        if kind.lower() != b"bearer" or not any(matches):
            what = "the token is not one of the service's" if authorization else "a token is required"
            raise Refusal(401, what, where="header: Authorization", remedy="send Authorization: Bearer TOKEN")


def _is_own(origin: bytes, host: bytes) -> bool:
    """Whether the request comes from a page of this service: browsers send its origin."""
    return urlsplit(origin.decode("latin-1")).netloc.encode("latin-1") == host != b""


def cors_headers(origin: bytes) -> list[Header]:
    """The headers by which browsers let a page of an allowed origin read the answer."""
    return [
        (b"access-control-allow-origin", origin),
        (b"vary", b"Origin"),
        (b"access-control-allow-methods", b"GET, POST, DELETE"),
        (b"access-control-allow-headers", b"authorization, content-type, accept"),
        (b"access-control-max-age", b"600"),
    ]
