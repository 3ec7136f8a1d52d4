"""Jobs: simulations and studies, run by worker processes, their states kept in the store.

A job's id is the content of its request: asking again for what is done is answered from the store, asking for what runs
joins it, and what failed, was cancelled or interrupted runs again.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from collections.abc import AsyncIterator
from typing import Any

import msgspec

from twolink.service.job_requests import SimulationRequest, StudyRequest, content_id
from twolink.service.metrics import Metrics
from twolink.service.problems import Problem, Refusal, error_from, problem_of
from twolink.service.settings import Settings
from twolink.service.store import ACTIVE, Store
from twolink.service.worker_pool import Workers

Request = SimulationRequest | StudyRequest
KINDS: dict[str, tuple[str, type[Request]]] = {
    "simulation": ("simulate", SimulationRequest),
    "study": ("study", StudyRequest),
}
_log = logging.getLogger("twolink.service")
_PULSE = 0.1  # seconds between looks at a job's progress
_SAVE = 0.5  # seconds between notes of it in the store, for other processes
_SIGN_OF_LIFE = 10.0  # seconds between signs of life in a stream of events


class Jobs:
    """The jobs of this process, and a view of those of others on the same folder."""

    def __init__(self, settings: Settings, store: Store, workers: Workers, metrics: Metrics) -> None:
        self._settings, self._store, self._workers, self._metrics = settings, store, workers, metrics
        self._tasks: dict[str, asyncio.Task[None]] = {}
        self._progress: dict[str, Any] = {}
        self._free = asyncio.Semaphore(jobs_here(settings))
        self.closing = False

    async def submit(self, kind: str, request: Request) -> dict[str, Any]:
        """Run what is asked for, or find it; waits up to request.wait seconds for the end. Returns the job's view.

        Raises Refusal (429) when too many jobs wait, and the job's failure when it fails within that time.
        """
        key = content_id(kind, request)
        row = self._store.job(key)
        if row is None or row["state"] not in ("done", *ACTIVE):
            self._begin(key, kind, request)
        else:
            self._store.update_job(key, used=time.time())
        await self._wait(key, request.wait)
        view = self.view(kind, key)
        if view["state"] == "failed":
            raise error_from(msgspec.convert(view["problem"], Problem))
        return view

    def again(self, kind: str, key: str) -> dict[str, Any]:
        """Run a job again that failed, was cancelled or was interrupted."""
        row = self._row(kind, key)
        if row["state"] not in ("done", *ACTIVE):
            self._begin(key, kind, msgspec.json.decode(row["request"], type=KINDS[kind][1]))
        return self.view(kind, key)

    def _begin(self, key: str, kind: str, request: Request) -> None:
        quotas = self._settings.quotas
        if self._store.active() >= quotas.queue + quotas.jobs:
            what = f"{self._store.active()} jobs wait already"
            raise Refusal(429, what, where="request", remedy="wait until some are done", retry_after=10)
        self._store.shrink((quotas.disk_mb - quotas.result_mb) * 2**20)
        self._store.new_job(key, kind, request)
        self._tasks[key] = asyncio.create_task(self._run(key, kind, request), name=key)

    async def _run(self, key: str, kind: str, request: Request) -> None:
        """Take a job through its states to its end."""
        ended: dict[str, Any] = {"state": "interrupted"}
        began = False
        try:
            async with self._free:
                self._store.update_job(key, state="running", started=time.time())
                self._metrics.job_started()
                began = True
                folder = self._store.result_folder(key)
                folder.mkdir(exist_ok=True)
                result = await self._workers.run(
                    KINDS[kind][0], self._settings.quotas.job_seconds, on_progress=self._listener(key),
                    request=msgspec.to_builtins(request), robots=str(self._store.folder / "robots"),
                    quotas=msgspec.to_builtins(self._settings.quotas), folder=str(folder),
                )  # fmt: skip
                ended = {
                    "state": "done",
                    "result": msgspec.json.encode(result).decode(),
                    "progress": '{"fraction":1.0}',
                }
        except asyncio.CancelledError:
            ended = {"state": "interrupted" if self.closing else "cancelled"}
        except Exception as error:
            ended = {"state": "failed", "problem": problem_of(error)}
        finally:
            self._store.update_job(key, ended=time.time(), **ended)
            self._store.measure(key)
            self._store.shrink(self._settings.quotas.disk_mb * 2**20)
            if began:
                self._metrics.job_ended(kind, ended["state"])
            self._progress.pop(key, None)
            self._tasks.pop(key, None)

    def _listener(self, key: str) -> Any:
        """Notes a worker's reports of progress; now and then in the store too."""
        saved = 0.0

        def note(progress: Any) -> None:
            nonlocal saved
            self._progress[key] = progress
            if time.monotonic() - saved > _SAVE:
                saved = time.monotonic()
                self._store.update_job(key, progress=msgspec.json.encode(progress).decode())

        return note

    async def _wait(self, key: str, seconds: float) -> None:
        task = self._tasks.get(key)
        if task is not None:
            await asyncio.wait([task], timeout=seconds or 0.001)
            return
        until = time.monotonic() + seconds  # of another process, if it runs
        while time.monotonic() < until and (self._store.job(key) or {"state": ""})["state"] in ACTIVE:
            await asyncio.sleep(_PULSE)

    def view(self, kind: str, key: str) -> dict[str, Any]:
        """A job as clients see it. Raises Refusal (404) when there is none."""
        return self._view(self._row(kind, key))

    def _row(self, kind: str, key: str) -> dict[str, Any]:
        row = self._store.job(key)
        if row is None or row["kind"] != kind:
            remedy = "ask for it again: results not used for long are removed"
            raise Refusal(404, f"there is no {kind} {key[:80]!r}", where="path: id", remedy=remedy)
        return row

    def request(self, kind: str, key: str) -> Any:
        """What a job that is done was asked for. Raises Refusal unless it is done."""
        row = self._row(kind, key)
        if row["state"] != "done":
            remedy = "wait for it" if row["state"] in ACTIVE else "run it again"
            raise Refusal(409, f"the {kind} is {row['state']}, there is no result", where="path: id", remedy=remedy)
        self._store.update_job(key, used=time.time())
        return msgspec.json.decode(row["request"])

    def all(self, kind: str) -> list[dict[str, Any]]:
        """The views of the newest jobs, without their results."""
        views = [self._view(row) for row in self._store.jobs(kind)]
        return [{name: value for name, value in view.items() if name != "result"} for view in views]

    def _view(self, row: dict[str, Any]) -> dict[str, Any]:
        key, now = row["id"], time.time()
        decoded = {name: row[name] and msgspec.json.decode(row[name]) for name in ("request", "problem", "result")}
        progress = self._progress.get(key) or (row["progress"] and msgspec.json.decode(row["progress"]))
        started = row["started"]
        decoded["request"].pop("wait", None)
        return {
            "id": key,
            "kind": row["kind"],
            "state": row["state"],
            "created": row["created"],
            "seconds": None if started is None else round((row["ended"] or now) - started, 3),
            "progress": progress,
            **decoded,
        }

    def cancel(self, kind: str, key: str) -> dict[str, Any]:
        """Cancel a job that waits or runs; one of another process ends within a second."""
        row = self._row(kind, key)
        if key in self._tasks:
            self._tasks[key].cancel()
        elif row["state"] in ACTIVE:
            self._store.update_job(key, cancel=1)
        return self.view(kind, key)

    async def remove(self, kind: str, key: str) -> None:
        """Cancel a job if it runs, and forget it with its result."""
        self.cancel(kind, key)
        await self._wait(key, 5.0)
        self._store.remove_job(key)

    async def events(self, kind: str, key: str) -> AsyncIterator[bytes]:
        """A job's views as server-sent events: `progress` whenever something is new, `end` at its end."""
        last, told = None, time.monotonic()
        while True:
            view = self.view(kind, key)
            over = view["state"] not in ACTIVE
            content = {name: value for name, value in view.items() if name not in ("result", "request")}
            essence = (view["state"], msgspec.json.encode(view["progress"]))
            if over or essence != last:
                last, told = essence, time.monotonic()
                yield b"event: %s\ndata: %s\n\n" % (b"end" if over else b"progress", msgspec.json.encode(content))
            if over or self.closing:
                return
            if time.monotonic() - told > _SIGN_OF_LIFE:
                told = time.monotonic()
                yield b": still there\n\n"
            await asyncio.sleep(_PULSE)

    async def look_after(self) -> None:
        """Until cancelled: end jobs that another process was told to cancel, and mark those whose process has died."""
        while True:
            await asyncio.sleep(1.0)
            for key, task in list(self._tasks.items()):
                row = self._store.job(key)
                if row is not None and row["cancel"]:
                    task.cancel()
            for row in self._store.mark_interrupted():
                _log.warning("interrupted: %s %s", row["kind"], row["id"])

    async def close(self) -> None:
        """End all jobs; they are marked as interrupted."""
        self.closing = True
        tasks = list(self._tasks.values())
        for task in tasks:
            task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await asyncio.gather(*tasks, return_exceptions=True)


def jobs_here(settings: Settings) -> int:
    """Jobs at once in each of the service's processes."""
    return max(1, settings.quotas.jobs // settings.workers)
