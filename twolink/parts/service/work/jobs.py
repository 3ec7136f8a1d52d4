"""Jobs: simulations, studies, sweeps and others, run by worker processes, their states kept in the store.

A job's id comes from its request. The same request is answered from the store when its job is done, joins it while it
runs, and runs again when it failed, was cancelled or was interrupted; a sweep then goes on where it was stopped. A
service that ends puts its jobs back into the queue for its next start. A job that ran when the service was killed is
interrupted, as it may be what killed it.

Several services that share a database share the jobs: each says what it runs, and takes up what others have not begun.
A job belongs to the process that has claimed it, as long as this says so every second; jobs of a process that is silent
for `LEASE` go back into the queue. A process that has nothing to do claims jobs that wait elsewhere.
"""

import asyncio
import logging
import math
import sqlite3
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec

from twolink.parts.service.problems import Problem, Refusal, ending, error_from, problem_of
from twolink.parts.service.settings import Settings
from twolink.parts.service.store.accounts import today
from twolink.parts.service.store.store import RESUMED, Store
from twolink.parts.service.work.job_views import BETWEEN_COPIES, LOOK, JobViews, Running, View
from twolink.parts.service.work.metrics import Metrics
from twolink.parts.service.work.requests import JOB_KINDS, JobRequest, upgraded
from twolink.parts.service.work.sharing import (
    NO_TASK,
    REQUEST,
    Budget,
    KeyedLocks,
    RequestMemory,
    Shares,
    client_of_owner,
    this_request,
)
from twolink.parts.service.work.time_shares import TimeShares, Turn
from twolink.parts.service.work.worker_pool import Workers

_RETRY = 2.0  # seconds between attempts to store how a job ended
BEAT = 1.0  # s between signs of life
_TIDY = 60.0  # s between looks at copies of what others have deleted
_log = logging.getLogger("twolink.service")


class Jobs(JobViews):
    """The jobs of the service. senders: the worker processes that send sweeps to a cluster, if there is one.

    may_pause: see `TimeShares`. running: those that wait or run in this process.
    """

    def __init__(
        self, settings: Settings, store: Store, workers: Workers, metrics: Metrics, budget: Budget,
        senders: Workers | None = None, may_pause: Callable[[], bool] = lambda: True,
    ) -> None:  # fmt: skip
        super().__init__(store)
        self._quotas, self._workers, self._metrics = settings.quotas, workers, metrics
        self._budget, self._senders, self._dask = budget, senders, settings.dask  # processes that may reach the cluster
        self._locks = KeyedLocks()
        self._turns = TimeShares(settings.quotas.jobs, may_pause)
        self._queue = Shares(2 * (settings.quotas.queue + settings.quotas.jobs))  # of which one client may have half

    def count(self, state: str) -> int:
        """The number of jobs in a state, "queued" or "running"."""
        return sum(running.state == state for running in self.running.values())

    async def resume(self) -> None:
        """Take up the jobs that an earlier service has left."""
        for job in await self._store.run(self._store.waiting):
            self.take_up(job.id, job.kind, job.owner)

    def take_up(self, key: str, kind: str, owner: str, *, claimed: bool = False) -> None:
        """Run a job of the store when it is its owner's turn."""
        if key in self.running:  # it has come meanwhile, and waits here
            self.running[key].claimed = claimed
            return
        REQUEST.set(RequestMemory(Shares(math.inf), client_of_owner(owner), owner))
        self._start(key, kind, claimed=claimed)

    @property
    def free(self) -> int:
        """The number of further jobs that could run here now."""
        return 0 if self.closing else self._turns.free

    async def submit(self, kind: str, request: JobRequest) -> View:
        """Run what is asked for, or find it; wait up to request.wait seconds for its end.

        Raises Refusal (429) when too many jobs wait, and the job's failure when it fails within that time.
        """
        key = request.key
        async with self._locks(key):
            job = None if key in self.running else await self._store.run(self._store.job, key, whole=False)
            if job is not None and job.state == "done":
                await self._store.run(self._store.use, key)
            elif key not in self.running and not (job is not None and job.active):
                await self._begin(key, kind, request.content, this_request().owner)
        await self._wait(key, request.wait)
        job = await self.job(kind, key)
        if job.state == "failed":
            raise error_from(msgspec.json.decode(job.problem, type=Problem))
        return self.view_of(job)

    async def again(self, kind: str, key: str) -> View:
        """Run a job again that failed, was cancelled or was interrupted."""
        async with self._locks(key):
            job = await self.own(kind, key)
            if not (key in self.running or job.active or job.state == "done"):
                await self._begin(key, kind, bytes(job.request), job.owner)
        return await self.view(kind, key)

    async def _begin(self, key: str, kind: str, content: bytes, owner: str) -> None:
        client = this_request().client
        await self._budget.require(owner)
        if not self._queue.take(client):
            what = f"{len(self.running)} jobs wait already"
            raise Refusal(429, what, where="request", remedy="wait until some are done", retry_after=10)
        try:
            await self._store.run(self._store.new_job, key, kind, content, owner)
            self._start(key, kind, client)
        except BaseException:
            self._queue.give(client)
            raise

    def _start(self, key: str, kind: str, client: str | None = None, *, claimed: bool = False) -> None:
        if self.closing:
            raise ending()
        running = self.running[key] = Running(kind, client, claimed=claimed)
        running.task = asyncio.create_task(self._run(key, running), name=key)

    async def _run(self, key: str, running: Running) -> None:
        """Run a job when a worker is free, and store how it ended. Its request waits in the store, not in memory."""
        end: dict[str, Any] = {}
        try:
            async with self._turns.turn() as turn:
                begun = await self._store.run(self._store.begin_job, key)
                running.claimed, running.lost = begun is not None, begun is None
                if begun is None:
                    return
                running.started = time.time()
                self._metrics.job_wait.observe(running.started - running.created)
                result = await self._compute(key, running, turn, *begun)
            end = {"state": "done", "ended": time.time(), "result": result, "progress": {"fraction": 1.0}}
        except asyncio.CancelledError:
            end = {"state": "queued", "started": None}
            if not self.closing:
                end = {"state": "cancelled", "ended": time.time()}
        except Exception as error:
            end = {"state": "failed", "ended": time.time(), "problem": problem_of(error)}
        finally:
            running.ending = True
            if not running.lost and (running.claimed or not self._store.shared):
                await self._end(key, end)
                self._metrics.jobs.labels(running.kind, end["state"]).inc()
            del self.running[key]
            if running.client is not None:
                self._queue.give(running.client)

    async def _compute(self, key: str, running: Running, turn: Turn, folder: Path, body: bytes) -> Any:
        if running.kind in RESUMED:
            await asyncio.to_thread(self._store.copies.bring, key, time.time())
        body = await asyncio.to_thread(upgraded, running.kind, body)  # which may import the function
        await self._store.bring_robots(body)

        async def note(progress: Any) -> View:
            running.progress = progress
            await self._turns.go_on(turn)
            return {}

        robots, seconds = str(self._store.folder / "robots"), self._quotas.job_seconds
        arguments: dict[str, Any] = {"folder": str(folder), "body": body, "robots": robots, "quotas": self._quotas}
        try:
            if running.kind == "sweep" and self._senders is None:
                return await self._sweep(seconds, turn, on_question=note, **arguments)
            workers = self._workers
            if running.kind == "sweep" and self._senders is not None:
                robot = await workers.run("pack_robot", seconds, body=body, robots=robots)
                workers, arguments = self._senders, {**arguments, "robot": robot, "cluster": self._dask}
            return await workers.run(JOB_KINDS[running.kind].task, seconds, on_question=note, **arguments)
        except Refusal as refusal:
            if refusal.code == "cluster-lost":
                _log.error("the Dask scheduler %s cannot be reached", self._dask)
            if refusal.code == "too-slow" and running.kind in RESUMED:
                what = f"it takes more than {seconds:g} s of computing"
                raise Refusal(422, what, code="too-slow", remedy="run it again: it goes on") from None
            raise

    async def _sweep(self, seconds: float, turn: Turn, **arguments: Any) -> Any:
        """Run a sweep. Where a worker dies the next one goes on, which gives up the run that three died of."""
        death = None
        while True:
            try:
                left = seconds if death is None else max(0.0, seconds - turn.ran)
                return await self._workers.run("sweep", left, died=death is not None, **arguments)
            except Refusal as refusal:
                if refusal.code == NO_TASK and death is not None:
                    raise death from None
                if refusal.code != "worker-died":
                    raise
                death = refusal

    async def _end(self, key: str, end: dict[str, Any]) -> None:
        """Store how a job ended. As long as that fails (the disk is full), the job runs, and it is tried again."""
        while True:
            try:
                if end["state"] == "done" or key.partition("-")[0] in RESUMED:
                    await asyncio.to_thread(self._store.copies.keep, key)
                if not await self._store.run(self._store.end_job, key, **end):
                    _log.warning("job %s was no longer of this process when it ended here: its end is left out", key)
                return
            except (sqlite3.Error, OSError) as error:
                _log.error("the end of job %s cannot be stored (%s); it is tried again", key, error)
            if self.closing:
                return
            await asyncio.sleep(_RETRY)

    async def _wait(self, key: str, seconds: float) -> None:
        end = time.monotonic() + seconds
        if key in self.running:
            await asyncio.wait([self.running[key].task], timeout=seconds or 0.001)
            if self.closing:
                raise ending()
        while self._store.shared and time.monotonic() < end and await self.active(key) is not None:
            await asyncio.sleep(LOOK)

    async def cancel(self, kind: str, key: str) -> View:
        """Cancel a job that waits or runs."""
        job = await self.own(kind, key)
        running = self.running.get(key)
        if self._store.shared:
            await self._store.run(self._store.leases.cancel, key)
        if running is not None and not running.ending:
            running.task.cancel()
        return self.view_of(job)

    async def remove(self, kind: str, key: str) -> None:
        """Cancel a job if it runs, and delete it with its result."""
        await self.cancel(kind, key)
        await self._wait(key, 5.0)
        await self._store.run(self._store.remove_job, key)

    async def close(self) -> None:
        """End all jobs; they are taken up at the next start."""
        self.closing = True
        tasks = [running.task for running in self.running.values()]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def take_part(store: Store, jobs: Jobs) -> None:
    """Be one of those that share a database, until cancelled. What fails is tried again."""
    kept = tidied = time.monotonic()
    keeping: asyncio.Task[None] | None = None
    while True:
        await asyncio.sleep(BEAT)
        try:
            await beat(store, jobs)
            await _take_up(store, jobs)
            now = time.monotonic()
            if now > kept + BETWEEN_COPIES and (keeping is None or keeping.done()):
                kept, keeping = now, asyncio.create_task(_keep(store, jobs))
            if now > tidied + _TIDY:
                tidied = now
                await store.run(store.tidy)
        except (OSError, sqlite3.Error) as error:
            _log.error("the other processes of the service cannot be reached: %s", error)


async def beat(store: Store, jobs: Jobs) -> None:
    """Say of each job here that it goes on, and end those that are to end, or that others have."""
    leases = store.leases
    asked = [key for key, each in jobs.running.items() if not each.claimed]
    gone = set(asked) - await store.run(leases.waiting, asked)
    for key, running in list(jobs.running.items()):
        is_to_end: bool | None = False
        if running.claimed:  # also while its result is stored, which may take long
            is_to_end = await store.run(leases.beat, key, running.progress)
        elif key in gone:
            is_to_end = None
        if is_to_end is not False and not running.ending:
            running.lost = is_to_end is None
            running.task.cancel()


async def _take_up(store: Store, jobs: Jobs) -> None:
    for key, state in await store.run(store.leases.expire):
        _log.warning("the process that ran job %s has ended: the job is %s", key, state)
    if count := jobs.free:
        for claimed in await store.run(store.leases.claim, count, day=today()):
            jobs.take_up(*claimed, claimed=True)


async def _keep(store: Store, jobs: Jobs) -> None:
    for key, running in list(jobs.running.items()):
        if running.claimed and not running.ending and running.kind in RESUMED:
            try:
                await asyncio.to_thread(store.copies.keep, key)
            except OSError as error:
                _log.error("what is done of job %s cannot be stored: %s", key, error)
