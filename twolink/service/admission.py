"""Admission control: how much of the service each client may hold, so that none keeps the others out."""

import functools
import ipaddress
import math
import threading
from contextvars import ContextVar
from typing import Any

from twolink.service.problems import Refusal

SMALL = 16 * 1024  # bytes of a body or an answer that are not counted: the number of connections limits them
_RETRY = 2.0  # seconds
_NOBODY = ""  # the client of what the service does by itself


class Shares:
    """`limit` units of something that clients take and give back.

    A client may hold at most as many as stay free. One alone gets half of them, two get a third each, and a newcomer
    always finds some: the dynamic threshold of Choudhury and Hahne, IEEE/ACM Transactions on Networking 6 (1998) 130.
    """

    def __init__(self, limit: float) -> None:
        self.limit, self.held = limit, 0
        self._by_client: dict[str, int] = {}
        self._lock = threading.Lock()

    def take(self, client: str, amount: int = 1) -> bool:
        """Take some for a client. False, and nothing is taken, when that is more than its share."""
        with self._lock:
            held = self._by_client.get(client, 0) + amount
            if held > self.limit - self.held - amount:
                return False
            self._by_client[client] = held
            self.held += amount
            return True

    def give(self, client: str, amount: int = 1) -> None:
        """Give back what was taken."""
        with self._lock:
            self.held -= amount
            self._by_client[client] -= amount
            if not self._by_client[client]:
                del self._by_client[client]


class Hold:
    """The memory of one request, in bytes: its body, what is made of it, and its answer until it is sent."""

    def __init__(self, shares: Shares, client: str) -> None:
        self.client, self._shares, self._bytes = client, shares, 0

    def add(self, count: float) -> None:
        """Take more memory. Raises Refusal: 413 when no client could ever have that much, 503 when others hold it."""
        count = int(count)
        if count <= SMALL:
            return
        if self._shares.take(self.client, count):
            self._bytes += count
            return
        if self._bytes + count > self._shares.limit / 2:
            what = f"it takes {(self._bytes + count) / 2**20:.0f} MB of memory, the limit is "
            what += f"{self._shares.limit / 2**21:.0f} MB"
            raise Refusal(413, what, where="request", remedy="send it in parts, and ask for .npz")
        raise busy("bodies and answers of other requests take the memory there is", "request")

    def keep(self, count: int) -> None:
        """Give back all but so many bytes."""
        if self._bytes > count:
            self._shares.give(self.client, self._bytes - count)
            self._bytes = count


HOLD: ContextVar[Hold] = ContextVar("HOLD")


def hold() -> Hold:
    """What the request under way holds; outside of requests, something without limits."""
    return HOLD.get(None) or Hold(Shares(math.inf), _NOBODY)


def busy(what: str, where: str) -> Refusal:
    """The refusal of what may be asked again soon."""
    return Refusal(503, what, where=where, remedy="ask again in some seconds", code="busy", retry_after=_RETRY)


@functools.lru_cache(10_000)
def client_of(address: str) -> str:
    """The client behind an address: IPv6 gives each a network of 64 bits, and so one client any number of addresses."""
    if ":" not in address:
        return address
    try:
        network = ipaddress.IPv6Network((address.partition("%")[0], 64), strict=False)
    except ValueError:
        return address
    return str(network)


def client_of_scope(scope: Any) -> str:
    """The client that an ASGI request comes from."""
    return client_of(scope["client"][0]) if scope.get("client") else _NOBODY
