"""Fair turns at a scarce resource: those that wait are served by client, not by who sends most."""

import asyncio
import contextlib
from collections import OrderedDict, deque
from collections.abc import AsyncIterator

from twolink.service.admission import Shares, busy, hold


class Turns:
    """At most `slots` tasks at once. Those that wait have their turns by client, round robin, first come first served.

    waiting: how many tasks may wait.
    """

    def __init__(self, slots: int, waiting: float) -> None:
        self._free, self._waiting = slots, Shares(waiting)
        self._queues: OrderedDict[str, deque[asyncio.Future[None]]] = OrderedDict()

    @property
    def waiting(self) -> int:
        """How many tasks wait."""
        return self._waiting.held

    @contextlib.asynccontextmanager
    async def turn(self) -> AsyncIterator[None]:
        """Wait for a turn, and have it. Raises Refusal (503) when the client has too many tasks that wait."""
        if self._free:
            self._free -= 1
        else:
            await self._wait(hold().client)
        try:
            yield
        finally:
            self._next()

    async def _wait(self, client: str) -> None:
        if not self._waiting.take(client):
            raise busy(f"{self._waiting.held} requests wait already", "request")
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
