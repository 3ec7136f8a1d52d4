"""Resources that clients share fairly: memory in flight, turns at a scarce resource, processor time of owners.

And the threads of sweeps, in processes that may die.
"""

import asyncio
import contextlib
import functools
import hashlib
import ipaddress
import math
import threading
import time
from collections import Counter, OrderedDict, defaultdict, deque
from collections.abc import AsyncIterator, Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextvars import ContextVar
from pathlib import Path
from typing import Any
from weakref import WeakValueDictionary

import msgspec

from twolink.dynamics.threads import thread_count
from twolink.io.files import write_atomic
from twolink.parts.service.problems import Refusal, encode
from twolink.parts.service.store.store import Store

SMALL = 16 * 1024  # bytes of a body or an answer that are not counted: the number of connections limits them
_RETRY = 2.0  # seconds
OWNER = "twolink.owner"  # in the scope of a request whose token has been checked
_NOBODY = ""  # the client of what the service does by itself
NO_TASK = "no-task-under-way"
NO_LIMIT = 1e9
_EACH = 5.0  # s between notes in the database
_DAY = 86_400


class KeyedLocks:
    """`async with locks(key)` lets one task at a time work on a key. A lock lives as long as somebody uses it."""

    def __init__(self) -> None:
        self._locks: WeakValueDictionary[str, asyncio.Lock] = WeakValueDictionary()

    def __call__(self, key: str) -> asyncio.Lock:
        return self._locks.setdefault(key, asyncio.Lock())


class Shares:
    """`limit` units of something that clients take and give back.

    A client may hold at most as many as stay free, or the last one. One alone gets half of them, two get a third each,
    and a newcomer always finds some: the dynamic threshold of Choudhury and Hahne, IEEE/ACM Transactions on Networking
    6 (1998) 130.
    """

    def __init__(self, limit: float) -> None:
        self.limit, self.taken = limit, 0
        self._by_client: dict[str, int] = {}
        self._lock = threading.Lock()

    def take(self, client: str, amount: int = 1) -> bool:
        """Take some for a client. False, and nothing is taken, when that is more than its share."""
        with self._lock:
            own = self._by_client.get(client, 0) + amount
            left = self.limit - self.taken - amount
            if left < 0 or own > max(1, left):
                return False
            self._by_client[client] = own
            self.taken += amount
            return True

    def give(self, client: str, amount: int = 1) -> None:
        """Give back what was taken."""
        with self._lock:
            self.taken -= amount
            self._by_client[client] -= amount
            if not self._by_client[client]:
                del self._by_client[client]


class RequestMemory:
    """The memory of one request, in bytes: its body, what is made of it, and its answer until it is sent.

    client: who shares. owner: of the robots and jobs that it may list and end; sees: the same, None for those of all.
    """

    def __init__(self, shares: Shares, client: str, owner: str = "") -> None:
        self.client, self._shares, self._bytes = client, shares, 0
        self.owner: str = owner
        self.sees: str | None = owner

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


REQUEST: ContextVar[RequestMemory] = ContextVar("REQUEST")


def this_request() -> RequestMemory:
    """The memory of the request under way; outside of requests, one without limits."""
    return REQUEST.get(None) or RequestMemory(Shares(math.inf), _NOBODY)


def require_owner(owner: str, what: str) -> None:
    """Raise Refusal (403) unless the request under way may end or delete what this owner has."""
    if this_request().sees not in (None, owner):
        remedy = "ask its owner, or an administrator"
        raise Refusal(403, f"the {what} is not yours", where="header: Authorization", remedy=remedy)


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


def client_of_owner(owner: str) -> str:
    """The client that a named owner is, wherever from; nobody for an owner without a name."""
    return f"owner {owner}" if owner else _NOBODY


def client_of_scope(scope: Any) -> str:
    """The client that an ASGI request comes from: the owner of its token, or its address."""
    if owner := scope.get(OWNER):
        return client_of_owner(owner)
    return client_of(scope["client"][0]) if scope.get("client") else _NOBODY


class Turns:
    """At most `slots` tasks at once. Those that wait have their turns by client, round robin, first come first served.

    waiting: how many tasks may wait.
    """

    def __init__(self, slots: int, waiting: float) -> None:
        self._free, self._waiting = slots, Shares(waiting)
        self._queues: OrderedDict[str, deque[asyncio.Future[None]]] = OrderedDict()

    @contextlib.asynccontextmanager
    async def turn(self) -> AsyncIterator[None]:
        """Wait for a turn, and have it. Raises Refusal (503) when the client has too many tasks that wait."""
        if self._free:
            self._free -= 1
        else:
            await self._wait(this_request().client)
        try:
            yield
        finally:
            self._next()

    async def _wait(self, client: str) -> None:
        if not self._waiting.take(client):
            raise busy(f"{self._waiting.taken} requests wait already", "request")
        mine = asyncio.get_running_loop().create_future()
        queue = self._queues.setdefault(client, deque())
        queue.append(mine)
        try:
            await mine
        except asyncio.CancelledError:
            if mine.cancelled():
                queue.remove(mine)
            else:
                self._next()  # the turn had just come: another gets it
            raise
        finally:
            self._waiting.give(client)

    def _next(self) -> None:
        """Give a turn that has ended to the next client."""
        while self._queues:
            client, queue = self._queues.popitem(last=False)
            if len(queue) > 1:
                self._queues[client] = queue  # behind the others
            if queue:
                queue.popleft().set_result(None)
                return
        self._free += 1


class _Deaths(msgspec.Struct):
    """Digests of the tasks under way, and how many processes died while each was."""

    under_way: list[str] = []
    deaths: dict[str, int] = {}


class WorkerDied(Exception):
    """A process died while it computed this task."""


class SweepThreads(ThreadPoolExecutor):
    """An executor for `tl.sweep` in a process that may die.

    A task during which processes died fails as often at once. So `tl.sweep` takes up its search where it was: it
    tries the task alone, then its halves, and gives up a run after three deaths.

    folder: of the record. died: the process before this one died. Raises Refusal, code NO_TASK, if that computed none.
    """

    def __init__(self, folder: Path, *, died: bool) -> None:
        super().__init__(thread_count())
        self._file, self._lock = folder / "deaths.json", threading.Lock()
        record = msgspec.json.decode(self._file.read_bytes(), type=_Deaths) if self._file.exists() else _Deaths()
        if died and not record.under_way:
            raise Refusal(422, "the worker process died between the runs", code=NO_TASK, remedy="try again")
        self._deaths = Counter(record.deaths)
        if died:
            self._deaths.update(record.under_way)
        self._failures = Counter(self._deaths)  # to come
        self._under_way = list[str]()
        self._write()

    def submit(self, function: Callable[[Any], Any], task: Any) -> "Future[Any]":  # type: ignore[override]
        """Compute a task, or fail where processes died of it."""
        key = _digest(task)
        if self._failures[key] > 0:
            self._failures[key] -= 1
            failed = Future[Any]()
            failed.set_exception(WorkerDied("a worker process died of it"))
            return failed
        return super().submit(self._noted, key, function, task)

    def _noted(self, key: str, function: Callable[[Any], Any], task: Any) -> Any:
        with self._lock:
            self._under_way.append(key)
            self._write()
        try:
            return function(task)
        finally:
            with self._lock:
                self._under_way.remove(key)
                self._write()

    def _write(self) -> None:
        content = msgspec.json.encode(_Deaths(self._under_way, self._deaths))
        write_atomic(self._file, lambda file: file.write(content))


def _digest(task: Any) -> str:
    """A digest of runs, equal for equal ones in each process."""
    values = {name: numbers.tolist() for name, numbers in task.values.items()}
    return hashlib.sha256(encode([task.request, values])).hexdigest()[:20]


class Budget:
    """The processor time that named owners may still take. seconds: of a day."""

    def __init__(self, store: Store, seconds: float) -> None:
        self._store, self._seconds = store, seconds
        self._open = defaultdict[str, float](float)  # s that are not in the database yet

    def charge(self, owner: str, seconds: float) -> None:
        """Note that work of an owner has taken this time of a processor."""
        if owner:
            self._open[owner] += seconds

    async def _spent(self, owner: str) -> float:
        seconds = self._open.pop(owner, 0.0)
        try:
            return await self._store.run(self._store.accounts.spend, owner, seconds)
        except BaseException:
            self.charge(owner, seconds)
            raise

    async def require(self, owner: str) -> float:
        """The seconds that an owner may still take today; infinite for one without a name.

        Raises Refusal (429) where none are left.
        """
        left = self._seconds - await self._spent(owner) if owner and self._seconds < NO_LIMIT else math.inf
        if left <= 0:
            wait = _DAY - time.time() % _DAY
            what = f"{owner} has had the {self._seconds:g} s of processor time of this day"
            remedy = "ask again tomorrow (UTC), or have owner_seconds raised"
            raise Refusal(429, what, code="no-time-left", where="request", remedy=remedy, retry_after=math.ceil(wait))
        return left

    async def note(self) -> None:
        """Have all in the database, until cancelled."""
        while True:
            await asyncio.sleep(_EACH)
            await self.flush()

    async def flush(self) -> None:
        """Have all in the database now, or later where it fails."""
        for owner in tuple(self._open):
            try:
                await self._spent(owner)
            except Exception:
                return
