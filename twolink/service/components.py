"""Service: the parts that all handlers share, started and ended together."""

import asyncio
import contextlib
import functools
import gc
import logging
import math
import time
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import msgspec
from litestar.di import NamedDependency
from litestar.params import SkipValidation

from twolink.dynamics.threads import thread_count
from twolink.errors import TwolinkError
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
_READERS, _COMPUTERS = 2, 2  # processes: for uploads, scenes and files; and for batches of states
_IN_LOOP = 32_768  # bytes of JSON that are read in the event loop, in a millisecond
_CHECK_EACH = 1.0  # seconds between checks of the store, however often somebody asks
_LAG_EACH = 0.5  # seconds between measurements of the event loop's lag


class Service:
    """Settings, store, worker processes, robots, jobs and counters of a service.

    protection: how worker processes are kept in. locks: for what must be made once, by the name of what is made.
    """

    def __init__(self, settings: Settings) -> None:
        quotas = settings.quotas
        self.settings = settings
        self.ending = False
        self._checked = -math.inf  # when the store was found well
        self.store = Store(Path(settings.data))
        self.protection = protection()
        self._require_room()
        self.metrics = Metrics()
        self.locks = KeyedLocks()
        died = self.metrics.worker_deaths.inc
        folders = [self.store.folder / part for part in PARTS]
        self._worker_memory = WorkerMemory(quotas.memory_mb)
        pool = functools.partial(Workers, memory=self._worker_memory, waiting=quotas.waiting, on_death=died)
        self._readers = pool(_READERS, writable=folders)
        threads = max(1, thread_count() // quotas.jobs)
        self._job_workers = pool(quotas.jobs, threads=threads, writable=folders)
        self._computers = pool(
            _COMPUTERS,
            threads=thread_count(),
            niceness=0,  # a client waits: beside other programs, niceness 10 takes four times as long
            tasks="twolink.service.query_tasks",
            writable=[self.store.folder / "robots"],
        )
        self.robots = RobotPool(settings, self.store, self._computers)
        self.queries = Queries(settings, self.robots, self._computers, self.metrics)
        senders = pool(quotas.jobs, tasks="twolink.service.cluster_tasks", writable=folders) if settings.dask else None
        self._pools = [self._readers, self._computers, self._job_workers, *([senders] if senders else [])]
        self.jobs = Jobs(settings, self.store, self._job_workers, self.metrics, senders)

    def _require_room(self) -> None:
        """Keep to the quota of the disk; raise TwolinkError rather than delete results without being told to."""
        quota, kept = self.settings.quotas.disk_mb, self.store.kept_bytes / 2**20
        if kept > quota and self.settings.delete_results:
            _log.warning("%d jobs were deleted, as all is to take %g MB", self.store.shrink(quota * 2**20), quota)
        elif kept > quota:
            self.store.close()
            what = f"results and robots take {kept:.0f} MB, more than disk_mb = {quota:g}"
            remedy = f"give --quota disk_mb={math.ceil(kept)}, or --delete-results for those not used for longest"
            raise TwolinkError(what, where=str(self.store.folder), code="over-quota", remedy=remedy)

    async def drain(self) -> None:
        """Begin to end: jobs go back into the queue, and who waits for one is told."""
        self.ending = True
        await self.jobs.close()

    def ending_refusal(self) -> Refusal:
        """The refusal of all that is asked of a service that ends."""
        return Refusal(503, "the service is ending", code="ending", remedy="ask again in some seconds", retry_after=5)

    async def require_ready(self) -> None:
        """Raise Refusal (503) while the service ends, or sqlite3.Error or OSError while its data folder fails."""
        if self.ending:
            raise self.ending_refusal()
        async with self.locks("ready"):
            if time.monotonic() - self._checked > _CHECK_EACH:
                await self.store.run(self.store.check, self.settings.quotas.result_mb * 2**20)
                self._checked = time.monotonic()

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

    def _show_gauges(self) -> None:
        gauge = self.metrics.gauge
        gauge("twolink_jobs_waiting", "Jobs that wait", lambda: self.jobs.count("queued"))
        gauge("twolink_jobs_running", "Jobs that run", lambda: self.jobs.count("running"))
        gauge("twolink_kept_bytes", "Bytes of results and uploaded robots", lambda: self.store.kept_bytes)
        workers = self._worker_memory.workers
        gauge("twolink_worker_bytes", "Memory of all worker processes", lambda: sum(each.memory() for each in workers))

    @contextlib.asynccontextmanager
    async def running(self, _: object = None) -> AsyncIterator[None]:
        """The service while it runs."""
        gc.collect()
        gc.freeze()  # what is loaded stays: a collection that looks at it takes 100 ms
        _log.log(logging.INFO if self.protection.complete else logging.WARNING, "%s", self.protection)
        self._show_gauges()
        await self.jobs.resume()
        watching = (self._worker_memory.watch(), _measure_lag(self.metrics))
        work = (*watching, *(workers.warm() for workers in self._pools))
        background = [asyncio.create_task(coroutine) for coroutine in work]
        try:
            yield
        finally:
            for task in background:
                task.cancel()
            await asyncio.gather(*background, return_exceptions=True)
            await self.drain()
            for workers in self._pools:
                await workers.close()
            self.store.close()


async def _measure_lag(metrics: Metrics) -> None:
    """Observe how much later than planned the event loop gets to its tasks."""
    while True:
        planned = time.perf_counter() + _LAG_EACH
        await asyncio.sleep(_LAG_EACH)
        metrics.loop_lag.observe(max(0.0, time.perf_counter() - planned))


Shared = NamedDependency[SkipValidation[Service]]  # what handlers ask for as `service`
