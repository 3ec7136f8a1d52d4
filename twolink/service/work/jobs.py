"""Jobs: simulations, studies, sweeps and others, run by worker processes, their states kept in the store.

A job's id comes from its request. The same request is answered from the store when its job is done, joins it while it
runs, and runs again when it failed, was cancelled or was interrupted; a sweep then goes on where it was stopped. A
service that ends puts its jobs back into the queue for its next start. A job that ran when the service was killed is
interrupted, as it may be what killed it.
"""

import asyncio
import logging
import math
import sqlite3
import time
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass, field
from typing import Any

import msgspec

from twolink.service.problems import Problem, Refusal, error_from, problem_of
from twolink.service.settings import Settings
from twolink.service.store.store import ACTIVE, RESUMED, Job, KeyedLocks, Store
from twolink.service.work.metrics import Metrics
from twolink.service.work.requests import JOB_KINDS, JobRequest
from twolink.service.work.sharing import (
    HOLD,
    NO_TASK,
    RequestMemory,
    Shares,
    client_of_owner,
    hold,
    require_owner,
)
from twolink.service.work.time_shares import TimeShares, Turn
from twolink.service.work.worker_pool import Workers

View = dict[str, Any]
_PULSE = 0.1  # seconds between looks at a job's progress
_KEEP_ALIVE = 10.0  # seconds between signs of life in a stream of events
_RETRY = 2.0  # seconds between attempts to store how a job ended
_log = logging.getLogger("twolink.service")


@dataclass
class _Running:
    """A job that waits or runs. client: who asked for it, unless an earlier service has left it.

    progress: what its worker has reported last. ending: only its end is left to store.
    """

    kind: str
    client: str | None
    task: asyncio.Task[None] = field(init=False)
    created: float = field(default_factory=time.time)
    started: float | None = None
    progress: Any = None
    ending: bool = False

    @property
    def state(self) -> str:
        return ACTIVE[self.started is not None]


class Jobs:
    """The jobs of the service. senders: the worker processes that send sweeps to a cluster, if there is one.

    may_pause: see `TimeShares`.
    """

    def __init__(
        self, settings: Settings, store: Store, workers: Workers, metrics: Metrics, senders: Workers | None = None,
        may_pause: Callable[[], bool] = lambda: True,
    ) -> None:  # fmt: skip
        self._quotas, self._store, self._workers, self._metrics = settings.quotas, store, workers, metrics
        self._senders, self._dask = senders, settings.dask  # processes that may reach the cluster
        self._disk_bytes = settings.quotas.results_mb * 2**20, settings.quotas.owner_disk_mb * 2**20
        self._running: dict[str, _Running] = {}
        self._locks = KeyedLocks()
        self._turns = TimeShares(settings.quotas.jobs, may_pause)
        self._queue = Shares(2 * (settings.quotas.queue + settings.quotas.jobs))  # of which one client may have half
        self._closing = False

    def count(self, state: str) -> int:
        """How many jobs are "queued" or "running"."""
        return sum(running.state == state for running in self._running.values())

    async def resume(self) -> None:
        """Take up the jobs that an earlier service has left."""
        for job in await self._store.run(self._store.waiting):
            HOLD.set(RequestMemory(Shares(math.inf), client_of_owner(job.owner), job.owner))
            self._start(job.id, job.kind)

    async def submit(self, kind: str, request: JobRequest) -> View:
        """Run what is asked for, or find it; wait up to request.wait seconds for its end.

        Raises Refusal (429) when too many jobs wait, and the job's failure when it fails within that time.
        """
        key = request.key
        async with self._locks(key):
            job = None if key in self._running else await self._store.run(self._store.job, key, whole=False)
            if job is not None and job.state == "done":
                await self._store.run(self._store.use, key)
            elif key not in self._running:
                await self._begin(key, kind, request.content, hold().owner)
        await self._wait(key, request.wait)
        job = await self._job(kind, key)
        if job.state == "failed":
            raise error_from(msgspec.json.decode(job.problem, type=Problem))
        return self._view(job)

    async def again(self, kind: str, key: str) -> View:
        """Run a job again that failed, was cancelled or was interrupted."""
        async with self._locks(key):
            job = await self._own(kind, key)
            if not (key in self._running or job.state == "done"):
                await self._begin(key, kind, bytes(job.request), job.owner)
        return await self.view(kind, key)

    async def _begin(self, key: str, kind: str, content: bytes, owner: str) -> None:
        client = hold().client
        if not self._queue.take(client):
            what = f"{len(self._running)} jobs wait already"
            raise Refusal(429, what, where="request", remedy="wait until some are done", retry_after=10)
        try:
            await self._store.run(self._store.new_job, key, kind, content, owner)
            self._start(key, kind, client)
        except BaseException:
            self._queue.give(client)
            raise

    def _start(self, key: str, kind: str, client: str | None = None) -> None:
        if self._closing:
            raise self._ending()
        running = self._running[key] = _Running(kind, client)
        running.task = asyncio.create_task(self._run(key, running), name=key)

    async def _run(self, key: str, running: _Running) -> None:
        """Run a job when a worker is free, and store how it ended. Its request waits in the store, not in memory."""
        end: dict[str, Any] = {}
        try:
            async with self._turns.turn() as turn:
                running.started = time.time()
                self._metrics.job_wait.observe(running.started - running.created)
                result = await self._compute(key, running, turn)
            end = {"state": "done", "ended": time.time(), "result": result, "progress": {"fraction": 1.0}}
        except asyncio.CancelledError:
            end = (
                {"state": "queued", "started": None} if self._closing else {"state": "cancelled", "ended": time.time()}
            )
        except Exception as error:
            end = {"state": "failed", "ended": time.time(), "problem": problem_of(error)}
        finally:
            running.ending = True
            await self._end(key, end)
            del self._running[key]
            if running.client is not None:
                self._queue.give(running.client)
            self._metrics.jobs.labels(running.kind, end["state"]).inc()

    async def _compute(self, key: str, running: _Running, turn: Turn) -> Any:
        folder, body = await self._store.run(self._store.begin_job, key)

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
                left = seconds if death is None else max(0.0, seconds - turn.held)
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
                await self._store.run(self._store.end_job, key, *self._disk_bytes, **end)
                return
            except (sqlite3.Error, OSError) as error:
                _log.error("the end of job %s cannot be stored (%s); it is tried again", key, error)
            if self._closing:
                return
            await asyncio.sleep(_RETRY)

    async def _wait(self, key: str, seconds: float) -> None:
        if key in self._running:
            await asyncio.wait([self._running[key].task], timeout=seconds or 0.001)
            if self._closing:
                raise self._ending()

    @staticmethod
    def _ending() -> Refusal:
        what, remedy = "the service is ending", "ask again: it takes the job up when it starts"
        return Refusal(503, what, code="ending", where="request", remedy=remedy, retry_after=5)

    async def _job(self, kind: str, key: str, *, whole: bool = True) -> Job:
        """A job of the store. Raises Refusal (404) when there is none."""
        job = await self._store.run(self._store.job, key, whole=whole)
        if job is None or job.kind != kind:
            raise self.removed(kind, key)
        return job

    async def _own(self, kind: str, key: str) -> Job:
        """A job of the store that the request under way may change. Raises Refusal (403, 404)."""
        job = await self._job(kind, key)
        require_owner(job.owner, kind)
        return job

    @staticmethod
    def removed(kind: str, key: str) -> Refusal:
        """The refusal of a job that is not there."""
        remedy = "ask for it again: results not used for long are removed"
        return Refusal(404, f"there is no {kind} {key[:80]!r}", where="path: id", remedy=remedy)

    async def require_done(self, kind: str, key: str) -> None:
        """Raise Refusal (404, 409) unless the job is done. Notes that its result is used."""
        job = await self._job(kind, key, whole=False)
        if job.state != "done":
            remedy = "wait for it" if job.active else "run it again"
            raise Refusal(409, f"the {kind} is {job.state}, there is no result", where="path: id", remedy=remedy)
        await self._store.run(self._store.use, key)

    async def request(self, kind: str, key: str) -> bytes:
        """What was asked for, as JSON. Raises Refusal (404) when there is no such job."""
        return bytes((await self._job(kind, key)).request)

    async def view(self, kind: str, key: str) -> View:
        """A job as clients see it. Raises Refusal (404) when there is none."""
        return self._view(await self._job(kind, key))

    async def all(self, kind: str, before: float, limit: int) -> list[View]:
        """The views of the owner's newest jobs asked for before that time, without results and large requests."""
        jobs = await self._store.run(self._store.jobs, kind, before, limit, hold().sees)
        return [_without(self._view(job), "result") for job in jobs]

    def _view(self, job: Job) -> View:
        running = self._running.get(job.id)
        names = ("id", "kind", "state", "owner", "created", "request", "problem", "result")
        return {name: getattr(job, name) for name in names} | {
            "seconds": None if job.started is None else round((job.ended or time.time()) - job.started, 3),
            "progress": running.progress if running else job.progress,
        }

    async def cancel(self, kind: str, key: str) -> View:
        """Cancel a job that waits or runs."""
        job = await self._own(kind, key)
        running = self._running.get(key)
        if running is not None and not running.ending:
            running.task.cancel()
        return self._view(job)

    async def remove(self, kind: str, key: str) -> None:
        """Cancel a job if it runs, and delete it with its result."""
        await self.cancel(kind, key)
        await self._wait(key, 5.0)
        await self._store.run(self._store.remove_job, key)

    async def events(self, kind: str, key: str) -> AsyncIterator[bytes]:
        """A job's views as server-sent events: `progress` whenever something is new, `end` at its end.

        A job that is deleted ends in the state "deleted". A service that ends closes the stream without an `end`.
        """
        seen, sent = None, time.monotonic()
        while (running := self._running.get(key)) is not None and not self._closing:
            if (running.state, running.progress) != seen:
                seen, sent = (running.state, running.progress), time.monotonic()
                seconds = None if running.started is None else round(time.time() - running.started, 3)
                yield _event(b"progress", {
                    "id": key, "kind": kind, "state": running.state, "created": running.created, "problem": None,
                    "seconds": seconds, "progress": running.progress,
                })  # fmt: skip
            elif time.monotonic() - sent > _KEEP_ALIVE:
                sent = time.monotonic()
                yield b": still there\n\n"
            await asyncio.sleep(_PULSE)
        job = await self._store.run(self._store.job, key)
        if job is None:
            yield _event(b"end", {"id": key, "kind": kind, "state": "deleted"})
        elif not job.active:
            yield _event(b"end", self._view(job))

    async def close(self) -> None:
        """End all jobs; they are taken up at the next start."""
        self._closing = True
        tasks = [running.task for running in self._running.values()]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


def _without(view: View, *names: str) -> View:
    return {name: value for name, value in view.items() if name not in names}


def _event(name: bytes, view: View) -> bytes:
    content = msgspec.json.encode(_without(view, "result", "request"))
    return b"event: %s\ndata: %s\n\n" % (name, content)
