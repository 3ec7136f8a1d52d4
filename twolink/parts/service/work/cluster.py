"""Jobs of several services that share a database: each says what it runs, and takes up what others have not begun.

A job belongs to the process that has claimed it, as long as this says so every second; jobs of a process that is silent
for `LEASE` go back into the queue. A process that has nothing to do claims jobs that wait elsewhere.
"""

import asyncio
import logging
import sqlite3
import time

from twolink.parts.service.store.accounts import today
from twolink.parts.service.store.store import RESUMED, Store
from twolink.parts.service.work.jobs import Jobs

BEAT = 1.0  # s between signs of life
_PARTS = 10.0  # s between copies of what is done of a sweep
_TIDY = 60.0  # s between looks at copies of what others have deleted
_log = logging.getLogger("twolink.service")


class Member:
    """This service among those that share its database."""

    def __init__(self, store: Store, jobs: Jobs) -> None:
        self._store, self._jobs = store, jobs
        self._kept = self._tidied = time.monotonic()
        self._keeping: asyncio.Task[None] | None = None

    async def take_part(self) -> None:
        """Do so until cancelled. What fails is tried again."""
        while True:
            await asyncio.sleep(BEAT)
            try:
                await self._beat()
                await self._take_up()
                await self._look_after_copies()
            except (OSError, sqlite3.Error) as error:
                _log.error("the other processes of the service cannot be reached: %s", error)

    async def _beat(self) -> None:
        store, leases = self._store, self._store.leases
        asked = [key for key, each in self._jobs.running.items() if not each.claimed]
        gone = set(asked) - await store.run(leases.waiting, asked)
        for key, running in list(self._jobs.running.items()):
            is_to_end: bool | None = False
            if running.claimed:  # also while its result is stored, which may take long
                is_to_end = await store.run(leases.beat, key, running.progress)
            elif key in gone:
                is_to_end = None
            if is_to_end is not False and not running.ending:
                running.lost = is_to_end is None
                running.task.cancel()

    async def _take_up(self) -> None:
        for key, state in await self._store.run(self._store.leases.expire):
            _log.warning("the process that ran job %s has ended: the job is %s", key, state)
        if count := self._jobs.free:
            for claimed in await self._store.run(self._store.leases.claim, count, day=today()):
                self._jobs.take_up(*claimed, claimed=True)

    async def _look_after_copies(self) -> None:
        now = time.monotonic()
        if now > self._kept + _PARTS and (self._keeping is None or self._keeping.done()):
            self._kept, self._keeping = now, asyncio.create_task(self._keep())
        if now > self._tidied + _TIDY:
            self._tidied = now
            await self._store.run(self._store.tidy)

    async def _keep(self) -> None:
        for key, running in list(self._jobs.running.items()):
            if running.claimed and not running.ending and running.kind in RESUMED:
                try:
                    await asyncio.to_thread(self._store.copies.keep, key)
                except OSError as error:
                    _log.error("what is done of job %s cannot be stored: %s", key, error)
