"""Jobs: simulations and studies, run by worker processes, their states kept in the store.

A job's id comes from its request. The same request is answered from the store when its job is done, joins it while it
runs, and runs again when it failed, was cancelled or was interrupted.
"""

import asyncio
import time
from collections.abc import AsyncIterator
from dataclasses import dataclass
from typing import Any

import msgspec

from twolink.service.job_requests import SimulationRequest, StudyRequest, content_id
from twolink.service.metrics import Metrics
from twolink.service.problems import Problem, Refusal, error_from, problem_of
from twolink.service.settings import Settings
from twolink.service.store import Job, Store
from twolink.service.worker_pool import Workers

Request = SimulationRequest | StudyRequest
View = dict[str, Any]
_REQUESTS: dict[str, type[Request]] = {"simulation": SimulationRequest, "study": StudyRequest}
_TASKS = {"simulation": "simulate", "study": "study"}
_PULSE = 0.1  # seconds between looks at a job's progress
_KEEP_ALIVE = 10.0  # seconds between signs of life in a stream of events


@dataclass
class _Running:
    """A job that waits or runs. progress: what its worker has reported last."""

    task: asyncio.Task[None]
    state: str = "queued"
    progress: Any = None


class Jobs:
    """The jobs of the service."""

    def __init__(self, settings: Settings, store: Store, workers: Workers, metrics: Metrics) -> None:
        self._quotas, self._store, self._workers, self._metrics = settings.quotas, store, workers, metrics
        self._running: dict[str, _Running] = {}
        self._free = asyncio.Semaphore(settings.quotas.jobs)
        self._closing = False

    async def submit(self, kind: str, request: Request) -> View:
        """Run what is asked for, or find it; wait up to request.wait seconds for its end.

        Raises Refusal (429) when too many jobs wait, and the job's failure when it fails within that time.
        """
        key = content_id(kind, request)
        job = self._store.job(key)
        if job is None or not (job.active or job.state == "done"):
            self._begin(key, kind, request)
        else:
            self._store.update_job(key, used=time.time())
        await self._wait(key, request.wait)
        job = self._job(kind, key)
        if job.state == "failed":
            raise error_from(msgspec.json.decode(job.problem, type=Problem))
        return self._view(job)

    def again(self, kind: str, key: str) -> View:
        """Run a job again that failed, was cancelled or was interrupted."""
        job = self._job(kind, key)
        if not (job.active or job.state == "done"):
            self._begin(key, kind, msgspec.json.decode(job.request, type=_REQUESTS[kind]))
        return self.view(kind, key)

    def _begin(self, key: str, kind: str, request: Request) -> None:
        quotas = self._quotas
        if len(self._running) >= quotas.queue + quotas.jobs:
            what = f"{len(self._running)} jobs wait already"
            raise Refusal(429, what, where="request", remedy="wait until some are done", retry_after=10)
        self._store.shrink((quotas.disk_mb - quotas.result_mb) * 2**20)
        self._store.new_job(key, kind, _without(msgspec.to_builtins(request), "wait"))
        self._running[key] = _Running(asyncio.create_task(self._run(key, kind, request), name=key))

    async def _run(self, key: str, kind: str, request: Request) -> None:
        """Run a job when a worker is free, and store how it ended."""
        end: dict[str, Any] = {}
        try:
            async with self._free:
                self._running[key].state = "running"
                self._store.update_job(key, state="running", started=time.time())
                with self._metrics.jobs_running.track_inprogress():
                    result = await self._compute(key, kind, request)
            end = {"state": "done", "result": result, "progress": {"fraction": 1.0}}
        except asyncio.CancelledError:
            end = {"state": "interrupted" if self._closing else "cancelled"}
        except Exception as error:
            end = {"state": "failed", "problem": problem_of(error)}
        finally:
            del self._running[key]
            self._store.update_job(key, ended=time.time(), **end)
            self._store.measure(key)
            self._store.shrink(self._quotas.disk_mb * 2**20)
            self._metrics.jobs.labels(kind, end["state"]).inc()

    async def _compute(self, key: str, kind: str, request: Request) -> Any:
        folder = self._store.result_folder(key)
        folder.mkdir(exist_ok=True)
        running = self._running[key]

        def note(progress: Any) -> None:
            running.progress = progress

        return await self._workers.run(
            _TASKS[kind], self._quotas.job_seconds, on_progress=note, folder=str(folder),
            request=request, robots=str(self._store.folder / "robots"), quotas=self._quotas,
        )  # fmt: skip

    async def _wait(self, key: str, seconds: float) -> None:
        if key in self._running:
            await asyncio.wait([self._running[key].task], timeout=seconds or 0.001)

    def _job(self, kind: str, key: str) -> Job:
        """A job of the store. Raises Refusal (404) when there is none."""
        job = self._store.job(key)
        if job is None or job.kind != kind:
            remedy = "ask for it again: results not used for long are removed"
            raise Refusal(404, f"there is no {kind} {key[:80]!r}", where="path: id", remedy=remedy)
        return job

    def require_done(self, kind: str, key: str) -> None:
        """Raise Refusal (404, 409) unless the job is done. Notes that its result is used."""
        job = self._job(kind, key)
        if job.state != "done":
            remedy = "wait for it" if job.active else "run it again"
            raise Refusal(409, f"the {kind} is {job.state}, there is no result", where="path: id", remedy=remedy)
        self._store.update_job(key, used=time.time())

    def view(self, kind: str, key: str) -> View:
        """A job as clients see it. Raises Refusal (404) when there is none."""
        return self._view(self._job(kind, key))

    def all(self, kind: str) -> list[View]:
        """The views of the newest jobs, without their results."""
        return [_without(self._view(job), "result") for job in self._store.jobs(kind)]

    def _view(self, job: Job) -> View:
        running = self._running.get(job.id)
        names = ("id", "kind", "state", "created", "request", "problem", "result")
        return {name: getattr(job, name) for name in names} | {
            "seconds": None if job.started is None else round((job.ended or time.time()) - job.started, 3),
            "progress": running.progress if running else job.progress,
        }

    def cancel(self, kind: str, key: str) -> View:
        """Cancel a job that waits or runs."""
        job = self._job(kind, key)
        if key in self._running:
            self._running[key].task.cancel()
        return self._view(job)

    async def remove(self, kind: str, key: str) -> None:
        """Cancel a job if it runs, and delete it with its result."""
        self.cancel(kind, key)
        await self._wait(key, 5.0)
        self._store.remove_job(key)

    async def events(self, kind: str, key: str) -> AsyncIterator[bytes]:
        """A job's views as server-sent events: `progress` whenever something is new, `end` at its end."""
        seen, sent = None, time.monotonic()
        while (running := self._running.get(key)) is not None and not self._closing:
            if (running.state, running.progress) != seen:
                seen, sent = (running.state, running.progress), time.monotonic()
                yield _event(b"progress", self.view(kind, key))
            elif time.monotonic() - sent > _KEEP_ALIVE:
                sent = time.monotonic()
                yield b": still there\n\n"
            await asyncio.sleep(_PULSE)
        job = self._store.job(key)
        if job is not None and not job.active:
            yield _event(b"end", self._view(job))

    async def close(self) -> None:
        """Cancel all jobs; they are marked as interrupted."""
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
