"""Scheduling of jobs: the processors' time is shared between clients, and a short job does not wait for long ones.

The client whose jobs have run for least time comes first, as in start-time fair queueing (Goyal, Vin, Cheng, IEEE/ACM
Transactions on Networking 5 (1997) 690). A job that has run for its slice yields where another client waits: its
process keeps its place and waits, and goes on before its client's next job begins: the processes that live, and their
memory, follow the clients and not their jobs. Nobody is interrupted between two reports of progress.
"""

import asyncio
import contextlib
import time
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass, field

from twolink.parts.service.work.sharing import this_request

SHORT = 2.0  # s: a job that has run for more is long
BESIDE = 4  # jobs at most beside the others: those that report seldom, as they compile
SLICE = 4.0  # s: after which a job yields to others
PAUSED = 16  # jobs at most that have begun and wait
_LOOK = 0.25  # s: how soon it is seen that jobs have become long


@dataclass(eq=False)
class Turn:
    """A job that waits or runs. ran: s for which it has run; slice: of these since it went on last."""

    client: str
    ran: float = 0.0
    slice: float = 0.0
    since: float = 0.0
    ready: "asyncio.Future[None]" = field(default_factory=lambda: asyncio.get_running_loop().create_future())


class TimeShares:
    """At most `slots` jobs run at once, and a short one beside them where all of them are long.

    One that becomes long there yields at its next report, and none of its client's runs beside others until it has gone
    on; until then a short one of another client may run beside it.

    may_pause: whether there is memory for one more job that has begun and waits.
    """

    def __init__(self, slots: int, may_pause: Callable[[], bool] = lambda: True) -> None:
        self._slots, self._may_pause = slots, may_pause
        self._running: list[Turn] = []
        self._waiting: list[Turn] = []
        self._used: dict[str, float] = {}  # s, by client, until nobody is here
        self._timer: asyncio.TimerHandle | None = None

    @property
    def free(self) -> int:
        """The number of further jobs that could run now."""
        return max(0, self._slots - len(self._running) - len(self._waiting))

    @contextlib.asynccontextmanager
    async def turn(self) -> AsyncIterator[Turn]:
        """Wait for a turn, and have it."""
        turn = Turn(this_request().client)
        least = min((self._used[other.client] for other in self._running + self._waiting), default=0.0)
        self._used[turn.client] = max(self._used.get(turn.client, 0.0), least)  # idle time is no credit
        self._waiting.append(turn)
        self._next()
        await self._ready(turn)
        try:
            yield turn
        finally:
            self._stop(turn)

    async def go_on(self, turn: Turn) -> None:
        """Let others run first where it is their turn; returns when it is this one's again."""
        self._charge()
        crowded = len(self._running) > self._slots and all(each.ran > SHORT for each in self._running)
        is_others = turn.slice > SLICE and any(
            self._used[each.client] < self._used[turn.client] for each in self._waiting
        )
        paused = sum(each.ran > 0 for each in self._waiting)
        if (crowded or is_others) and paused < PAUSED and self._may_pause():
            turn.ready = asyncio.get_running_loop().create_future()
            self._waiting.append(turn)
            self._stop(turn)
            await self._ready(turn)

    async def _ready(self, turn: Turn) -> None:
        try:
            await turn.ready
        except asyncio.CancelledError:
            if turn in self._waiting:
                self._waiting.remove(turn)
            else:
                self._stop(turn)  # the turn had just come: another gets it
            raise

    def _charge(self) -> None:
        """Count the time since the last look."""
        now = time.monotonic()
        for turn in self._running:
            passed, turn.since = now - turn.since, now
            turn.ran, turn.slice = turn.ran + passed, turn.slice + passed
            self._used[turn.client] += passed

    def _stop(self, turn: Turn) -> None:
        self._charge()
        if turn in self._running:
            self._running.remove(turn)
            self._next()
        if not (self._running or self._waiting):
            self._used.clear()

    def _next(self) -> None:
        """Let all run that may, the client with the least time first, and of its jobs those that have begun."""
        self._charge()
        while fitting := [turn for turn in self._waiting if self._fits(turn)]:
            turn = min(fitting, key=lambda each: (self._used[each.client], not each.ran))
            self._waiting.remove(turn)
            self._running.append(turn)
            turn.since, turn.slice = time.monotonic(), 0.0
            turn.ready.set_result(None)
        if self._timer is not None:
            self._timer.cancel()
        self._timer = asyncio.get_running_loop().call_later(_LOOK, self._next) if self._waiting else None

    def _fits(self, turn: Turn) -> bool:
        """True if a job that waits, and has not been cancelled just now, may run."""
        count = len(self._running)
        beside = count < self._slots + BESIDE and turn.ran <= SHORT and all(each.ran > SHORT for each in self._running)
        own = any(each.ran > SHORT and each.client == turn.client for each in self._waiting)  # what it sent beside
        return not turn.ready.done() and (count < self._slots or (beside and not own))
