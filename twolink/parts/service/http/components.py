"""The parts of a running service: settings, store, worker processes, robots, queries, jobs and counters.

Small queries take microseconds and are answered in the event loop, so their path is plain ASGI: bytes in, msgspec,
NumPy, bytes out. All others are answered by computing processes, which also compile; the event loop never does.
"""

import asyncio
import contextlib
import functools
import gc
import hashlib
import logging
import math
import time
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Annotated, Any

import msgspec
from litestar import MediaType, Response
from litestar.di import NamedDependency
from litestar.params import QueryParameter, SkipValidation

from twolink.dynamics import Robot
from twolink.dynamics.queries import Query
from twolink.dynamics.threads import thread_count
from twolink.errors import TwolinkError, nearest
from twolink.parts.service.http.messages import UNSPECIFIED, body_limit, header, media_type, read_body, while_connected
from twolink.parts.service.problems import JSON, Refusal, encode, ending
from twolink.parts.service.settings import Quotas, Settings
from twolink.parts.service.store.archives import NPZ, RobotCache, read_robot
from twolink.parts.service.store.data_folder import PARTS
from twolink.parts.service.store.store import LISTED, Store
from twolink.parts.service.work.jobs import Jobs, take_part
from twolink.parts.service.work.metrics import Metrics
from twolink.parts.service.work.query_requests import STATES_IN_LOOP, answer_query, arguments_from_json, count_of
from twolink.parts.service.work.requests import JOB_KINDS, JobRequest, prepare
from twolink.parts.service.work.sandbox import protection
from twolink.parts.service.work.sharing import Budget, KeyedLocks, Shares, this_request
from twolink.parts.service.work.time_shares import BESIDE, PAUSED
from twolink.parts.service.work.worker_pool import Workers
from twolink.parts.service.work.worker_process import WorkerMemory
from twolink.robots.catalogue import catalogue_names

catalogue = functools.cache(catalogue_names)  # the names of the catalogue, which are ids too
PREFIX = "/v1/robots/"
_BODY_IN_LOOP = 4000  # bytes of a body that is read in the event loop
_NUMBERS_IN_LOOP = 4096  # of an answer that is computed there, in less than 3 ms
_NEWCOMERS = 20  # who wait for a live simulation to end
_HEADERS = {media: [(b"content-type", media.encode())] for media in (JSON, NPZ)}
_log = logging.getLogger("twolink.service")
_READERS, _COMPUTERS = 2, 2  # processes: for uploads, scenes and files; and for batches of states
_REQUEST_IN_LOOP = 32_768  # bytes of JSON that are read in the event loop, in a millisecond
_CHECK_EACH = 1.0  # seconds between checks of the store, however often somebody asks
_LAG_EACH = 0.5  # seconds between measurements of the event loop's lag


class RobotPool:
    """The robots that small queries have asked for last, within the quota of their memory, and POST /{id}/{query}.

    Worker processes load them, and answer to more than a few states. folder: where the uploaded robots are.
    """

    def __init__(self, quotas: Quotas, store: Store, workers: Workers, metrics: Metrics) -> None:
        self.folder = str(store.folder / "robots")
        self._quotas, self._store, self._workers, self._metrics = quotas, store, workers, metrics
        self._robots = RobotCache(quotas.robots_mb)
        self._locks = KeyedLocks()
        self.loaded, self.forget = self._robots.get, self._robots.drop  # the robot of an id if it is loaded

    async def get(self, key: str) -> Robot:
        """The robot of this id. Raises Refusal (404) when there is none."""
        await self.require(key)
        async with self._locks(key):
            robot = self.loaded(key)
            if robot is None:
                await self._store.run(self._store.use_robot, key)
                pickled = await self._workers.run("load", self._quotas.load_seconds, key=key, robots=self.folder)
                robot = self.put(key, pickled)
        return robot

    async def require(self, key: str) -> None:
        """Raise Refusal (404) unless there is a robot of this id, whose files are here then."""
        if key not in catalogue() and not await self._store.run(self._store.has_robot, key):
            remedy = f"{nearest(key[:80], catalogue())} (GET /v1/robots lists them and the uploaded ones)"
            raise Refusal(404, f"there is no robot {key[:80]!r}", where="path: robot", remedy=remedy)
        await self._store.bring_robots(key.encode())

    def put(self, key: str, pickled: bytes) -> Robot:
        """Keep a robot that a worker has loaded."""
        return self._robots.put(key, read_robot(pickled))

    async def answer(self, scope: Any, receive: Any, key: str, query: Query) -> tuple[int, list[Any], bytes]:
        """Status, headers and body. Raises Refusal or QueryError."""
        sent = media_type(header(scope, b"content-type"))
        sent = JSON if sent in UNSPECIFIED else sent
        if sent not in (JSON, NPZ, "application/zip"):
            remedy = f"send {JSON} or {NPZ}"
            raise Refusal(415, f"{sent[:80]!r} is not understood", where="header: Content-Type", remedy=remedy)
        body = await read_body(scope, receive, body_limit(sent, self._quotas))
        same, other = (JSON, NPZ) if sent == JSON else (NPZ, JSON)
        accept = header(scope, b"accept")
        reply = other if other.encode() in accept and same.encode() not in accept else same
        if sent == JSON and len(body) < _BODY_IN_LOOP:
            if self.loaded(key) is None:
                await self.get(key)
            if (answer := self.answer_now(scope, body, key, query)) is not None:
                return 200, _HEADERS[JSON], answer
        await self.require(key)
        work = self._workers.exchange(
            "query", self._quotas.query_seconds, body, key=key, what=query.name, sent=sent, reply=reply,
            robots=self.folder, quotas=self._quotas,
        )  # fmt: skip
        count, content = await while_connected(receive, work)
        self._metrics.states.inc(count)
        return 200, _HEADERS[reply], content

    def answer_now(self, scope: Any, body: bytes, key: str, query: Query) -> bytes | None:
        """The answer in JSON to a few states in JSON, if the robot is loaded, else None. Raises as `answer`."""
        robot = self.loaded(key)
        is_json = media_type(header(scope, b"content-type")) in (JSON, *UNSPECIFIED)
        if robot is None or not is_json or len(body) >= _BODY_IN_LOOP or NPZ.encode() in header(scope, b"accept"):
            return None
        arguments = arguments_from_json(query, body)
        count, numbers = count_of(robot, query, arguments)
        if count > STATES_IN_LOOP or numbers > _NUMBERS_IN_LOOP:
            return None
        self._metrics.states.inc(count)
        return encode(answer_query(robot, query, arguments, count))


class Service:
    """Settings, store, worker processes, robots, jobs and counters of a service.

    protection: how worker processes are kept in. locks: for what must be made once, by the name of what is made.
    """

    def __init__(self, settings: Settings) -> None:
        quotas = self.quotas = settings.quotas
        self.settings = settings
        self.ending = False
        self._checked = -math.inf  # when the store was found well
        self.store = Store(Path(settings.data), quotas, settings.database, settings.store)
        self.budget = Budget(self.store, quotas.owner_seconds)
        self.protection = protection()
        self._require_room()
        self.metrics = Metrics()
        self.locks = KeyedLocks()
        died = self.metrics.worker_deaths.inc
        folders = [self.store.folder / part for part in PARTS]
        self._worker_memory = WorkerMemory(quotas.memory_mb)
        pool = functools.partial(Workers, memory=self._worker_memory, budget=self.budget, waiting=quotas.waiting,
                                 on_death=died)  # fmt: skip
        self._readers = pool(_READERS, writable=folders)
        threads = max(1, thread_count() // quotas.jobs)
        places = quotas.jobs + BESIDE + PAUSED
        self._job_workers = pool(places, threads=threads, writable=folders, spare=True)
        # A client waits for a query: beside other programs, niceness 10 takes four times as long.
        self._computers = pool(_COMPUTERS, threads=thread_count(), niceness=0, writable=[self.store.folder / "robots"],
                               tasks="twolink.parts.service.work.robot_tasks")  # fmt: skip
        self.robots = RobotPool(quotas, self.store, self._computers, self.metrics)
        senders = None
        if settings.dask:  # the cluster computes while they wait
            senders = pool(places, tasks="twolink.parts.service.work.sweep_tasks", writable=folders, idle=1.0)
        self.live = pool(quotas.live, niceness=0, idle=1.0)
        self.lives, self.newcomers = Shares(quotas.live), Shares(_NEWCOMERS)
        self._pools = [*filter(None, (self._readers, self._computers, self._job_workers, senders))]
        may_pause = self._worker_memory.has_room
        self.jobs = Jobs(settings, self.store, self._job_workers, self.metrics, self.budget, senders, may_pause)
        gauge, workers = self.metrics.gauge, self._worker_memory.workers
        gauge("twolink_jobs_waiting", "Jobs that wait", lambda: self.jobs.count("queued"))
        gauge("twolink_jobs_running", "Jobs that run", lambda: self.jobs.count("running"))
        gauge("twolink_kept_bytes", "Bytes of results and uploaded robots", lambda: self.store.kept_bytes)
        gauge("twolink_worker_bytes", "Memory of all worker processes", lambda: sum(each.memory() for each in workers))

    def _require_room(self) -> None:
        """Keep to the quota of the disk; raise TwolinkError rather than delete results without being told to."""
        quota, kept = self.quotas.disk_mb, self.store.kept_bytes / 2**20
        if kept > quota and self.settings.delete_results:
            jobs = self.store.shrink(quota * 2**20 - self.store.robot_use()[1])
            robots = self.store.shrink_robots(quota * 2**20 - self.store.result_bytes())
            _log.warning("%d jobs and %d robots were deleted, as all is to take %g MB", jobs, robots, quota)
        elif kept > quota:
            self.store.close()
            what = f"results and robots take {kept:.0f} MB, more than disk_mb = {quota:g}"
            remedy = f"give --quota disk_mb={math.ceil(kept)}, or --delete-results for those not used for longest"
            raise TwolinkError(what, where=str(self.store.folder), code="over-quota", remedy=remedy)

    async def drain(self) -> None:
        """Begin to end: jobs go back into the queue, and who waits for one is told."""
        self.ending = True
        await self.jobs.close()

    async def require_ready(self) -> None:
        """Raise Refusal (503) while the service ends, or sqlite3.Error or OSError while its data folder fails."""
        if self.ending:
            raise ending()
        async with self.locks("ready"):
            if time.monotonic() - self._checked > _CHECK_EACH:
                await self.store.run(self.store.check)
                await asyncio.to_thread(self.store.copies.check)
                self._checked = time.monotonic()

    async def read(self, task: str, **arguments: Any) -> Any:
        """Run a short task in a worker process, which takes of the folder of robots and the quotas what it needs."""
        quotas, robots = self.quotas, self.robots.folder
        await self.store.bring_robots(arguments.get("body", b""))
        return await self._readers.run(task, quotas.load_seconds, robots=robots, quotas=quotas, **arguments)

    async def answer(self, task: str, **arguments: Any) -> Response[bytes]:
        """The JSON that a short task makes, as an answer."""
        return Response(await self.read(task, **arguments), media_type=MediaType.JSON)

    async def prepare(self, kind: str, body: bytes) -> JobRequest:
        """Check the body of a request for a job."""
        ids = self.ids_of(this_request().owner)
        if len(body) <= _REQUEST_IN_LOOP:
            if "request" not in vars(JOB_KINDS[kind]):  # it imports the function, which can take a second
                await asyncio.to_thread(getattr, JOB_KINDS[kind], "request")
            return prepare(kind=kind, body=body, ids=ids)
        return msgspec.convert(await self.read("prepare", kind=kind, body=body, ids=ids), JobRequest)

    def ids_of(self, owner: str) -> str:
        """Key that makes the ids of a named owner's robots and jobs its own: who knows them has them from the owner."""
        return hashlib.sha256(f"{self.store.secret} {owner}".encode()).hexdigest() if owner else ""

    async def make(self, path: Path, task: str, **arguments: Any) -> None:
        """Have a task write a file, unless it is there, whole: its digest stands beside it."""
        limit = self.quotas.answer_mb
        async with self.locks(str(path)):
            digest, draft = path.with_name(f"{path.name}.blake2"), path.with_name(f"draft-{path.name}")
            if path.exists() and digest.exists():
                if await asyncio.to_thread(lambda: _digest(path) == digest.read_bytes()):
                    return
                _log.warning("%s is damaged on the disk, and is made again", path.name)
            try:
                await self.read(task, path=str(draft), **arguments)
                if draft.stat().st_size > limit * 2**20:
                    what = f"{path.suffix[1:]} of it takes more than {limit:g} MB"
                    remedy = "ask for less, or start the service with a larger quota"
                    raise Refusal(413, what, where="path", remedy=remedy)
                await asyncio.to_thread(lambda: digest.write_bytes(_digest(draft)))
                draft.replace(path)
            finally:
                draft.unlink(missing_ok=True)

    @contextlib.asynccontextmanager
    async def running(self, _: object = None) -> AsyncIterator[None]:
        """The service while it runs."""
        gc.collect()
        gc.freeze()  # what is loaded stays: a collection that looks at it takes 100 ms
        _log.log(logging.INFO if self.protection.complete else logging.WARNING, "%s", self.protection)
        watching = [self._worker_memory.watch(), _measure_lag(self.metrics), self.budget.note()]
        if self.store.shared:
            watching.append(take_part(self.store, self.jobs))
        else:
            await self.jobs.resume()
        work = (*watching, *(workers.warm() for workers in self._pools))
        background = [asyncio.create_task(coroutine) for coroutine in work]
        try:
            yield
        finally:
            for task in background:
                task.cancel()
            await asyncio.gather(*background, return_exceptions=True)
            await self.drain()
            for workers in (*self._pools, self.live):
                await workers.close()
            await self.budget.flush()
            self.store.close()


def _digest(path: Path) -> bytes:
    """The digest of a file's content."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, hashlib.blake2b).digest()


async def _measure_lag(metrics: Metrics) -> None:
    """Observe how much later than planned the event loop gets to its tasks."""
    while True:
        planned = time.perf_counter() + _LAG_EACH
        await asyncio.sleep(_LAG_EACH)
        metrics.loop_lag.observe(max(0.0, time.perf_counter() - planned))


Limit = Annotated[int, QueryParameter(ge=1, le=LISTED)]  # of what a list shows
Shared = NamedDependency[SkipValidation[Service]]  # what handlers ask for as `service`
