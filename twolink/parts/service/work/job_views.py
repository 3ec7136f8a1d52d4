"""Jobs as clients see them: those of this process as they are, others as the store has them."""

import asyncio
import time
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from typing import Any

import msgspec

from twolink.parts.service.problems import Refusal
from twolink.parts.service.store.store import ACTIVE, JobRow, Store
from twolink.parts.service.work.requests import upgraded
from twolink.parts.service.work.sharing import require_owner, this_request

View = dict[str, Any]
LOOK = 0.5  # seconds between looks at a job of another process
_PULSE = 0.1  # seconds between looks at a job's progress
_KEEP_ALIVE = 10.0  # seconds between signs of life in a stream of events
BETWEEN_COPIES = 10.0  # s between copies of what is done of a sweep, and so between looks at those of another process


@dataclass
class Running:
    """A job that waits or runs in this process. client: who asked for it here.

    progress: what its worker has reported last. ending: only its end is left to store. claimed: it is this process
    that runs it. lost: another process does.
    """

    kind: str
    client: str | None
    task: asyncio.Task[None] = field(init=False)
    created: float = field(default_factory=time.time)
    started: float | None = None
    progress: Any = None
    ending: bool = False
    claimed: bool = False
    lost: bool = False

    @property
    def state(self) -> str:
        return ACTIVE[self.started is not None]


class JobViews:
    """Views of the jobs, for reading. running: those of this process; closing: the service ends."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self.running: dict[str, Running] = {}
        self.closing = False

    async def job(self, kind: str, key: str, *, whole: bool = True) -> JobRow:
        """A job of the store. Raises Refusal (404) when there is none."""
        job = await self._store.run(self._store.job, key, whole=whole)
        if job is None or job.kind != kind:
            raise self.removed(kind, key)
        return job

    async def own(self, kind: str, key: str) -> JobRow:
        """A job of the store that the request under way may change. Raises Refusal (403, 404)."""
        job = await self.job(kind, key)
        require_owner(job.owner, kind)
        return job

    @staticmethod
    def removed(kind: str, key: str) -> Refusal:
        """The refusal of a job that is not there."""
        remedy = "ask for it again: results not used for long are removed"
        return Refusal(404, f"there is no {kind} {key[:80]!r}", where="path: id", remedy=remedy)

    async def require_done(self, kind: str, key: str) -> None:
        """Raise Refusal (404, 409) unless the job is done. Notes that its result is used."""
        job = await self.job(kind, key, whole=False)
        if job.state != "done":
            remedy = "wait for it" if job.active else "run it again"
            raise Refusal(409, f"the {kind} is {job.state}, there is no result", where="path: id", remedy=remedy)
        if not await self.bring(job):
            await self._store.run(self._store.remove_job, key)
            raise self.removed(kind, key)
        await self._store.run(self._store.use, key)

    async def bring(self, job: JobRow) -> bool:
        """Have the files of a job here that another process has written. False where there are none."""
        state = job.ended or int(time.time() / BETWEEN_COPIES)
        return job.id in self.running or await asyncio.to_thread(self._store.copies.bring, job.id, state)

    async def request(self, kind: str, key: str) -> bytes:
        """The request of a job, as JSON. Raises Refusal (404) when there is no such job."""
        return await asyncio.to_thread(upgraded, kind, bytes((await self.job(kind, key)).request))

    async def view(self, kind: str, key: str) -> View:
        """A job as clients see it. Raises Refusal (404) when there is none."""
        return self.view_of(await self.job(kind, key))

    async def all(self, kind: str, before: float, limit: int) -> list[View]:
        """The views of the owner's newest jobs asked for before that time, without results and large requests."""
        jobs = await self._store.run(self._store.jobs, kind, before, limit, this_request().sees)
        return [without(self.view_of(job), "result") for job in jobs]

    def view_of(self, job: JobRow) -> View:
        running = self.running.get(job.id)
        names = ("id", "kind", "state", "owner", "created", "request", "problem", "result")
        return {name: getattr(job, name) for name in names} | {
            "seconds": None if job.started is None else round((job.ended or time.time()) - job.started, 3),
            "progress": running.progress if running else job.progress,
        }

    async def active(self, key: str) -> View | None:
        """A job that waits or runs, here or in another process, without its request; None for one that has ended."""
        if (running := self.running.get(key)) is not None:
            seconds = None if running.started is None else round(time.time() - running.started, 3)
            return {"id": key, "kind": running.kind, "state": running.state, "created": running.created,
                    "problem": None, "seconds": seconds, "progress": running.progress}  # fmt: skip
        job = await self._store.run(self._store.job, key, whole=False) if self._store.shared else None
        return self.view_of(job) if job is not None and job.active else None

    async def events(self, kind: str, key: str) -> AsyncIterator[bytes]:
        """A job's views as server-sent events: `progress` whenever something is new, `end` at its end.

        A job that is deleted ends in the state "deleted". A service that ends closes the stream without an `end`.
        """
        seen, sent = None, time.monotonic()
        while not self.closing and (view := await self.active(key)) is not None:
            if (view["state"], view["progress"]) != seen:
                seen, sent = (view["state"], view["progress"]), time.monotonic()
                yield _event(b"progress", view)
            elif time.monotonic() - sent > _KEEP_ALIVE:
                sent = time.monotonic()
                yield b": still there\n\n"
            await asyncio.sleep(_PULSE if key in self.running else LOOK)
        job = await self._store.run(self._store.job, key)
        if job is None:
            yield _event(b"end", {"id": key, "kind": kind, "state": "deleted"})
        elif not job.active:
            yield _event(b"end", self.view_of(job))


def without(view: View, *names: str) -> View:
    return {name: value for name, value in view.items() if name not in names}


def _event(name: bytes, view: View) -> bytes:
    content = msgspec.json.encode(without(view, "result", "request"))
    return b"event: %s\ndata: %s\n\n" % (name, content)
