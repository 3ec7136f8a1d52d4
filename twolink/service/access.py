"""Who may call: host check against DNS rebinding, origin check, bearer tokens, rate limit; and the security headers."""

from __future__ import annotations

import hmac
import ipaddress
import time
from collections import OrderedDict
from typing import Any
from urllib.parse import urlsplit

from twolink.service.problems import Refusal
from twolink.service.settings import Settings

Header = tuple[bytes, bytes]
PAGE_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; connect-src 'self'; "
    "font-src 'self'; frame-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
SECURITY: tuple[Header, ...] = (
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-resource-policy", b"same-origin"),
)
DENY_ALL: Header = (b"content-security-policy", b"default-src 'none'; frame-ancestors 'none'")
OPEN_PATHS = ("/health", "/", "/docs", "/docs/")  # what a browser or a monitor asks for before it has a token
_OPEN_PREFIXES = ("/page/",)
_MOST_CLIENTS = 10_000
_BURST = 2.0  # seconds of the rate that a client may use at once


class Guard:
    """Checks each request before anything else looks at it. One instance a process."""

    def __init__(self, settings: Settings) -> None:
        self._tokens = [token.encode() for token in settings.tokens]
        self._hosts = {"localhost", settings.host.lower(), *(host.lower() for host in settings.hosts)}
        self._origins = {origin.encode() for origin in settings.origins}
        self._rate = settings.rate
        self._buckets: OrderedDict[str, tuple[float, float]] = OrderedDict()
        self._known: set[bytes] = set()

    def check(self, scope: Any) -> bytes | None:
        """Raise Refusal unless the request may pass. Returns the foreign origin it came from, if one is allowed."""
        host = origin = authorization = None
        for name, value in scope["headers"]:
            if name == b"host":
                host = value
            elif name == b"origin":
                origin = value
            elif name == b"authorization":
                authorization = value
        if host not in self._known:
            self._check_host(host)
        if self._rate is not None:
            self._spend(scope["client"][0] if scope.get("client") else "")
        foreign = None if origin is None else self._check_origin(origin, host)
        if self._tokens and not self._is_open(scope):
            self._check_token(authorization)
        return foreign

    def _check_host(self, host: bytes | None) -> None:
        """A page of a name that someone has pointed at this machine must not reach it: only known names pass."""
        name = _host_name(host)
        if name is None or not (name in self._hosts or _is_address(name)):
            remedy = "call it by its address, or start it with --allow-host"
            raise Refusal(421, f"the service is not known as {name!r:.80}", where="header: Host", remedy=remedy)
        if len(self._known) < 1000:
            self._known.add(host or b"")

    def _check_origin(self, origin: bytes, host: bytes | None) -> bytes | None:
        """Browsers send along where a script comes from: only the service's own pages, unless others are allowed."""
        own = urlsplit(origin.decode("latin-1")).netloc.encode("latin-1")
        if own and own == host:
            return None
        if origin in self._origins:
            return origin
        remedy = "start the service with --allow-origin"
        raise Refusal(403, "pages of other sites may not call it", where="header: Origin", remedy=remedy)

    def _is_open(self, scope: Any) -> bool:
        path = scope["path"]
        return scope["method"] == "OPTIONS" or path in OPEN_PATHS or path.startswith(_OPEN_PREFIXES)

    def _check_token(self, authorization: bytes | None) -> None:
        kind, _, given = (authorization or b"").partition(b" ")
        matches = [hmac.compare_digest(given.strip(), token) for token in self._tokens]  # all of them: constant time
        if kind.lower() != b"bearer" or not any(matches):
            what = "the token is not one of the service's" if authorization else "a token is asked for"
            raise Refusal(401, what, where="header: Authorization", remedy="send Authorization: Bearer TOKEN")

    def _spend(self, client: str) -> None:
        """Take one from the client's bucket, which fills at the rate."""
        rate = self._rate or 1.0
        now = time.monotonic()
        left, then = self._buckets.pop(client, (rate * _BURST, now))
        left = min(rate * _BURST, left + (now - then) * rate)
        if left < 1.0:
            self._buckets[client] = (left, now)
            what = f"more than {rate:g} requests a second"
            wait = (1.0 - left) / rate
            raise Refusal(429, what, where="request", remedy="wait, or send states in batches", retry_after=wait)
        self._buckets[client] = (left - 1.0, now)
        if len(self._buckets) > _MOST_CLIENTS:
            self._buckets.popitem(last=False)


def _host_name(host: bytes | None) -> str | None:
    try:
        return urlsplit(f"//{(host or b'').decode('ascii')}").hostname
    except ValueError:
        return None


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def cors_headers(origin: bytes) -> list[Header]:
    """What lets a page of an allowed origin read the answer."""
    return [
        (b"access-control-allow-origin", origin),
        (b"vary", b"Origin"),
        (b"access-control-allow-methods", b"GET, POST, DELETE"),
        (b"access-control-allow-headers", b"authorization, content-type, accept"),
        (b"access-control-max-age", b"600"),
    ]
