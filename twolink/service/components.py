"""Service: the parts that all handlers share, started and ended together."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import logging
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Annotated, Any

from litestar.params import Dependency

from twolink.dynamics.threads import thread_count
from twolink.service.jobs import Jobs, jobs_here
from twolink.service.metrics import Metrics
from twolink.service.queries import Queries
from twolink.service.robot_pool import LoadedRobots
from twolink.service.settings import Settings
from twolink.service.store import Store
from twolink.service.worker_pool import Workers

_log = logging.getLogger("twolink.service")
_READERS = 2


class Service:
    """Store, worker processes, robots and jobs of one process of the service."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.store = Store(Path(settings.data))
        self.metrics = Metrics()
        memory, died = settings.quotas.memory_mb, self.metrics.worker_died
        threads = max(1, thread_count() // jobs_here(settings))
        self.readers = Workers(_READERS, memory, on_death=died)
        self.job_workers = Workers(jobs_here(settings), memory, threads=threads, on_death=died)
        self.robots = LoadedRobots(settings, self.store, self.readers)
        self.queries = Queries(settings, self.robots, self.metrics)
        self.jobs = Jobs(settings, self.store, self.job_workers, self.metrics)
        self._locks: dict[str, asyncio.Lock] = {}

    async def read(self, task: str, *, patience: float = 1.0, **arguments: Any) -> Any:
        """Do a short task in a worker process, in at most `patience` times the quota's load_seconds."""
        seconds = patience * self.settings.quotas.load_seconds
        return await self.readers.run(task, seconds, robots=str(self.store.folder / "robots"), **arguments)

    @contextlib.asynccontextmanager
    async def once(self, key: str) -> AsyncIterator[None]:
        """Let one at a time make the same thing; the others find it made."""
        async with self._locks.setdefault(key, asyncio.Lock()):
            yield
        self._locks.pop(key, None)

    @contextlib.asynccontextmanager
    async def running(self, _: object = None) -> AsyncIterator[None]:
        """The service while it runs; says what an earlier run left interrupted."""
        self.store.clean()
        for row in self.store.mark_interrupted():
            _log.warning("interrupted by the end of an earlier run: %s %s; it can be run again", row["kind"], row["id"])
        gc.collect()
        gc.freeze()  # what is loaded stays: looking through it again and again takes 100 ms each time
        background = [
            asyncio.create_task(work) for work in (self.jobs.look_after(), self.readers.warm(), self.job_workers.warm())
        ]
        try:
            yield
        finally:
            for task in background:
                task.cancel()
            await asyncio.gather(*background, return_exceptions=True)
            await self.jobs.close()
            await self.readers.close()
            await self.job_workers.close()
            self.store.close()


Shared = Annotated[Service, Dependency(skip_validation=True)]  # what handlers ask for as `service`
