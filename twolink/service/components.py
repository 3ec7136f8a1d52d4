"""Service: the parts that all handlers share, started and ended together."""

import asyncio
import contextlib
import gc
import logging
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Annotated, Any

import msgspec
from litestar.params import Dependency

from twolink.dynamics.threads import thread_count
from twolink.service.data_folder import PARTS
from twolink.service.job_requests import JobRequest, prepare
from twolink.service.jobs import Jobs
from twolink.service.keyed_locks import KeyedLocks
from twolink.service.metrics import Metrics
from twolink.service.problems import Refusal
from twolink.service.queries import Queries
from twolink.service.robot_pool import RobotPool
from twolink.service.sandbox import protection
from twolink.service.settings import Settings
from twolink.service.store import Store
from twolink.service.worker_memory import WorkerMemory
from twolink.service.worker_pool import Workers

_log = logging.getLogger("twolink.service")
_READERS = 2
_IN_LOOP = 32_768  # bytes of JSON that are read in the event loop, in a millisecond


class Service:
    """Settings, store, worker processes, robots, jobs and counters of a service.

    protection: how worker processes are kept in. locks: for what must be made once, by the name of what is made.
    """

    def __init__(self, settings: Settings) -> None:
        quotas = settings.quotas
        self.settings = settings
        self.store = Store(Path(settings.data))
        self.protection = protection()
        self.metrics = Metrics()
        self.locks = KeyedLocks()
        died = self.metrics.worker_deaths.inc
        folders = [self.store.folder / part for part in PARTS]
        self._worker_memory = WorkerMemory(quotas.memory_mb)
        self._readers = Workers(_READERS, self._worker_memory, writable=folders, on_death=died)
        threads = max(1, thread_count() // quotas.jobs)
        self._job_workers = Workers(quotas.jobs, self._worker_memory, threads=threads, writable=folders, on_death=died)
        self.robots = RobotPool(settings, self.store, self._readers)
        self.queries = Queries(settings, self.robots, self.metrics)
        self.jobs = Jobs(settings, self.store, self._job_workers, self.metrics)

    async def read(self, task: str, **arguments: Any) -> Any:
        """Run a short task in a worker process."""
        seconds, robots = self.settings.quotas.load_seconds, str(self.store.folder / "robots")
        return await self._readers.run(task, seconds, robots=robots, **arguments)

    async def prepare(self, kind: str, body: bytes) -> JobRequest:
        """Check the body of a request for a job."""
        if len(body) <= _IN_LOOP:
            return prepare(kind=kind, body=body)
        return msgspec.convert(await self.read("prepare", kind=kind, body=body), JobRequest)

    async def make(self, path: Path, task: str, **arguments: Any) -> None:
        """Have a task write a file, unless it is there."""
        limit = self.settings.quotas.answer_mb
        async with self.locks(str(path)):
            if path.exists():
                return
            draft = path.with_name(f"draft-{path.name}")
            try:
                await self.read(task, path=str(draft), **arguments)
                if draft.stat().st_size > limit * 2**20:
                    what = f"{path.suffix[1:]} of it takes more than {limit:g} MB"
                    raise Refusal(
                        413, what, where="path", remedy="ask for less, or start the service with a larger quota"
                    )
                draft.replace(path)
            finally:
                draft.unlink(missing_ok=True)

    @contextlib.asynccontextmanager
    async def running(self, _: object = None) -> AsyncIterator[None]:
        """The service while it runs."""
        gc.collect()
        gc.freeze()  # what is loaded stays: a collection that looks at it takes 100 ms
        _log.log(logging.INFO if self.protection.complete else logging.WARNING, "%s", self.protection)
        await self.jobs.resume()
        work = (self._worker_memory.watch(), self._readers.warm(), self._job_workers.warm())
        background = [asyncio.create_task(coroutine) for coroutine in work]
        try:
            yield
        finally:
            for task in background:
                task.cancel()
            await asyncio.gather(*background, return_exceptions=True)
            await self.jobs.close()
            await self._readers.close()
            await self._job_workers.close()
            self.store.close()


Shared = Annotated[Service, Dependency(skip_validation=True)]  # what handlers ask for as `service`
