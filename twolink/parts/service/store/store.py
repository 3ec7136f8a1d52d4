"""The store of the service: uploaded robots, jobs and their results, in SQLite and files under one folder.

One service uses a folder at a time: it holds SQLite's exclusive lock, which ends with its process however that ends.
Several services share a PostgreSQL database and an object store: then the folder of each has copies.
"""

import asyncio
import errno
import functools
import logging
import math
import shutil
import sqlite3
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import msgspec

from twolink.parts.service.problems import Refusal, problem_of
from twolink.parts.service.settings import Quotas
from twolink.parts.service.store import data_folder
from twolink.parts.service.store.accounts import Accounts, Leases
from twolink.parts.service.store.data_folder import RESULTS, ROBOTS, STAGING, VISUALS, Copies, size_of, to_remove
from twolink.parts.service.store.database import Database, PostgreSQL, SQLite, length, plain

P = ParamSpec("P")
T = TypeVar("T")
ENDED_JOBS = 5000  # that are remembered
LISTED = 200  # jobs or robots in an answer
ACTIVE = ("queued", "running")
RESUMED = ("sweep",)  # kinds of jobs that go on from their files when they are run again
_log = logging.getLogger("twolink.service")
_LISTED_REQUEST = 16_384  # bytes: lists leave larger requests out
_JOB_TEXTS = ("request", "progress", "problem", "result")  # JSON


class JobRow(msgspec.Struct, frozen=True):
    """A row of the jobs. Times are seconds since 1970; request, progress, problem and result are JSON."""

    id: str
    kind: str
    state: str
    created: float
    started: float | None
    ended: float | None
    used: float
    bytes: int
    owner: str
    request: msgspec.Raw
    progress: msgspec.Raw
    problem: msgspec.Raw
    result: msgspec.Raw

    @property
    def active(self) -> bool:
        """True if it waits or runs."""
        return self.state in ACTIVE


class Store:
    """The folder and its database. Its methods wait for the disk; an event loop calls them through `run`.

    quotas: limits of what is kept. database, objects: URLs of those that several services share; empty: all is in the
    folder.
    """

    def __init__(self, folder: Path, quotas: Quotas, database: str = "", objects: str = "") -> None:
        self.folder, self._quotas = folder, quotas
        self.most = quotas.results_mb * 2**20  # bytes of results and drawings
        self._lock = SQLite(data_folder.open_folder(folder))
        self._thread = ThreadPoolExecutor(1, "twolink-store")  # one: the order of calls is the order of changes
        try:
            self._database: Database = PostgreSQL(database) if database else self._lock
            self.copies = Copies(folder, objects)
            self.shared, self._execute = self._database.shared, self._database.execute
            self.leases = Leases(self._database)
            self.accounts = Accounts(self._database, self.leases.process, quotas)
            if self.shared:
                data_folder.tidy(folder, (), ())
            else:
                self._repair()
            self.kept_bytes = self.used_bytes()  # as of the last change
            self.secret: str = self._execute("SELECT ids FROM secrets")[0][0]  # without it no owner's id can be told
        except BaseException as error:
            self._lock.close()
            if isinstance(error, (OSError, sqlite3.Error)):
                raise data_folder.unusable(folder, error) from None
            raise

    def _repair(self) -> None:
        """Bring folder and database to terms after a service that was killed."""
        self._execute("DELETE FROM loading")
        self.tidy()
        for (key,) in self._execute("SELECT id FROM jobs WHERE state = 'done'"):
            if not self.result_folder(key).exists():
                self._delete_job(key)
        for job in self._jobs("WHERE state = 'running'", texts=()):
            what = "the service was killed while the job ran"
            problem = problem_of(Refusal(503, what, code="interrupted", remedy="run it again"))
            self._drop_unfinished(job.id)
            self.update_job(job.id, state="interrupted", ended=time.time(), problem=problem)
            self._note_size(job.id)
            _log.warning("interrupted by the end of an earlier run: %s %s; it can be run again", job.kind, job.id)

    def tidy(self) -> None:
        """Delete files here of robots and jobs that there are no more, and of uploads that were never kept."""
        for key in self.accounts.forgotten():
            if not self.has_robot(key):
                self.copies.drop(ROBOTS, key)
        robots, jobs = ({row[0] for row in self._execute(f"SELECT id FROM {table}")} for table in ("robots", "jobs"))
        data_folder.tidy(self.folder, robots, jobs, staging=not self.shared)

    async def run(self, method: Callable[P, T], *arguments: P.args, **options: P.kwargs) -> T:
        """Call a method of this store in its thread. Raises what it raises, such as sqlite3.Error and OSError."""
        call = functools.partial(method, *arguments, **options)
        return await asyncio.get_running_loop().run_in_executor(self._thread, call)

    def check(self) -> None:
        """Raise sqlite3.Error or OSError unless the database can be written and the disk has room for a result."""
        self._database.check()
        free, asked = shutil.disk_usage(self.folder).free / 2**20, self._quotas.result_mb
        if free < asked:
            raise OSError(errno.ENOSPC, f"{free:.0f} MB are free, a result may take {asked:.0f} MB")

    def close(self) -> None:
        """Let go of the database and its lock."""
        self._thread.shutdown()
        self._database.close()
        self._lock.close()

    # Robots

    def stage(self, key: str, content: bytes) -> Path:
        """A folder for the files of an upload, with its content as "body"."""
        staged = self.folder / STAGING / key
        shutil.rmtree(staged, ignore_errors=True)
        staged.mkdir(mode=0o700)
        (staged / "body").write_bytes(content)
        return staged

    def unstage(self, staged: Path) -> None:
        """Delete the staged files of an upload, unless it was kept, and give its room back."""
        self.accounts.give_back(staged.name)
        shutil.rmtree(staged, ignore_errors=True)

    def add_robot(self, key: str, staged: Path, description: dict[str, Any], owner: str) -> None:
        """Keep an uploaded robot, whose files are moved from the staging folder. Raises as `Accounts.reserve`."""
        content = msgspec.json.encode(description)
        size = size_of(staged) + len(content)
        self.accounts.give_back(key)
        self.accounts.reserve(key, owner, size)  # whatever its worker has said
        target, now = self.folder / ROBOTS / key, time.time()
        shutil.rmtree(target, ignore_errors=True)  # left by a process that was killed just here
        staged.rename(target)
        self._execute("INSERT INTO robots (id, created, used, bytes, description, owner) VALUES (?, ?, ?, ?, ?, ?) "
                      "ON CONFLICT (id) DO UPDATE SET bytes = excluded.bytes, description = excluded.description",
                      (key, now, now, size, content.decode(), owner))  # fmt: skip
        self.accounts.give_back(key)
        self._count()

    def robot(self, key: str) -> dict[str, Any] | None:
        """The description of an uploaded robot, or None."""
        rows = self._execute("SELECT description, owner FROM robots WHERE id = ?", (key,))
        return {**msgspec.json.decode(rows[0][0]), "owner": rows[0][1]} if rows else None

    async def bring_robots(self, content: bytes) -> None:
        """Have the files here of the uploaded robots whose ids are in some content. Raises Refusal (413)."""
        if named := await asyncio.to_thread(self.copies.named_robots, content):
            await asyncio.to_thread(self.copies.bring_robots, await self.run(self._known_robots, sorted(named)))

    def _known_robots(self, keys: list[str]) -> list[str]:
        marks = ", ".join("?" * len(keys))
        return [row[0] for row in self._execute(f"SELECT id FROM robots WHERE id IN ({marks})", tuple(keys))]

    def has_robot(self, key: str) -> bool:
        """True if a robot of this id was uploaded."""
        return bool(self._execute("SELECT 1 FROM robots WHERE id = ?", (key,)))

    def robots(self, before: float, limit: int, owner: str | None) -> list[tuple[str, float, str]]:
        """Owner, time and description, as JSON, of the newest robots uploaded before that time, the newest first.

        owner: whose; None: of all.
        """
        which = "WHERE created < ? AND (? IS NULL OR owner = ?) ORDER BY created DESC LIMIT ?"
        values = before, owner, owner, min(limit, LISTED)
        return [*map(tuple, self._execute(f"SELECT owner, created, description FROM robots {which}", values))]

    def robot_use(self) -> tuple[int, int]:
        """The number of uploaded robots, and their bytes."""
        count, size = self._execute("SELECT count(*), coalesce(sum(bytes), 0) FROM robots")[0]
        return count, int(size)

    def use_robot(self, key: str) -> None:
        """Note that an uploaded robot is used."""
        self._execute("UPDATE robots SET used = ? WHERE id = ?", (time.time(), key))

    def remove_robot(self, key: str) -> None:
        """Delete an uploaded robot and its drawings."""
        self.copies.drop(ROBOTS, key)
        self._execute("DELETE FROM robots WHERE id = ?", (key,))
        for path in (self.folder / VISUALS).glob(f"*-{key}.json.gz*"):
            path.unlink(missing_ok=True)
        self._count()

    # Jobs

    def job(self, key: str, *, whole: bool = True) -> JobRow | None:
        """A job, or None. whole: with its request, problem and result."""
        return next(iter(self._jobs("WHERE id = ?", key, texts=_JOB_TEXTS if whole else ("progress",))), None)

    def jobs(self, kind: str, before: float, limit: int, owner: str | None = None) -> list[JobRow]:
        """The newest jobs of a kind that were asked for before that time, the newest first, without their results.

        owner: whose; None: of all. Requests of more than 16 kB are left out.
        """
        condition = "WHERE kind = ? AND created < ? AND (? IS NULL OR owner = ?) ORDER BY created DESC LIMIT ?"
        short = f"CASE WHEN length(request) <= {_LISTED_REQUEST} THEN request END AS request"
        values = kind, before, owner, owner, min(limit, LISTED)
        return self._jobs(condition, *values, texts=(short, "progress", "problem"))

    def _jobs(self, condition: str, *values: Any, texts: tuple[str, ...] = _JOB_TEXTS) -> list[JobRow]:
        found = [next((text for text in texts if text.endswith(name)), f"NULL AS {name}") for name in _JOB_TEXTS]
        columns = ", ".join((*JobRow.__struct_fields__[: -len(_JOB_TEXTS)], *found))
        rows = self._execute(f"SELECT {columns} FROM jobs {condition}", values)
        plain = len(JobRow.__struct_fields__) - len(_JOB_TEXTS)
        return [JobRow(*row[:plain], *(msgspec.Raw(text or "null") for text in row[plain:])) for row in rows]

    def new_job(self, key: str, kind: str, content: bytes, owner: str = "") -> None:
        """Note a job that waits, in place of an earlier attempt at the same. content: its request, as JSON.

        Raises Refusal (429) where a named owner has so many jobs that wait or run.
        """
        if owner and self.shared:
            self.accounts.require_place(owner)
        cleared = ", ".join(f"{name} = NULL" for name in ("started", "ended", "progress", "problem", "result"))
        self._execute(
            "INSERT INTO jobs (id, kind, state, created, used, bytes, request, owner) VALUES (?, ?, 'queued', ?, ?, ?, "
            "?, ?) ON CONFLICT (id) DO UPDATE SET state = 'queued', created = excluded.created, used = excluded.used, "
            f"owner = excluded.owner, process = '', tries = 0, cancel = 0, {cleared} "
            "WHERE jobs.state NOT IN ('queued', 'running', 'done')",
            (key, kind, (now := time.time()), now, len(content), content.decode(), owner),
        )
        self._count()

    def begin_job(self, key: str) -> tuple[Path, bytes] | None:
        """Have a job run: the folder of its result, and its request; None where another process has claimed it."""
        if not self.leases.claim(key=key) and not self.leases.has(key):
            return None
        folder = self.result_folder(key)
        self._drop_unfinished(key)
        folder.mkdir(exist_ok=True, mode=0o700)
        request: str = self._execute("SELECT request FROM jobs WHERE id = ?", (key,))[0][0]
        return folder, request.encode()

    def end_job(self, key: str, **values: Any) -> bool:
        """Note how a job ended, and keep to the limits of bytes. Files stay of what is done, or can go on from them.

        Returns whether it was this process's to end, see `Leases`.
        """
        if values["state"] != "done":
            self._drop_unfinished(key)
        if is_ours := self.leases.end(key, plain(values)):
            self.copies.note(key, values.get("ended"))
            self.measure(key)
        return is_ours

    def update_job(self, key: str, **values: Any) -> None:
        """Set columns of a job; what is not a number, a text or None is stored as JSON."""
        columns = ", ".join(f"{name} = ?" for name in values)
        self._execute(f"UPDATE jobs SET {columns} WHERE id = ?", (*plain(values).values(), key))

    def use(self, key: str) -> None:
        """Note that a job's result is used."""
        self.update_job(key, used=time.time())

    def waiting(self) -> list[JobRow]:
        """The jobs that wait, the oldest first."""
        return self._jobs("WHERE state = 'queued' ORDER BY created", texts=())

    # Results

    def result_folder(self, key: str) -> Path:
        """The folder of a job's result."""
        return self.folder / RESULTS / key

    def visuals(self, name: str) -> Path:
        """The folder of a robot's drawing."""
        return self.folder / VISUALS / name

    def remove_job(self, key: str) -> None:
        """Delete a job and its result."""
        self._delete_job(key)
        self._count()

    def _delete_job(self, key: str) -> None:
        self.copies.drop(RESULTS, key)
        self._execute("DELETE FROM jobs WHERE id = ?", (key,))

    def _drop_unfinished(self, key: str) -> None:
        """Delete the files of a job that is not done, unless it can go on from them."""
        if key.partition("-")[0] not in RESUMED:
            shutil.rmtree(self.result_folder(key), ignore_errors=True)

    def measure(self, key: str) -> None:
        """Note the size of a job and its files (tables and figures are added on demand), and keep to the limits."""
        self._note_size(key)
        self.shrink(self.most, keep=key)

    def _note_size(self, key: str) -> None:
        texts, size = " + ".join(map(length, _JOB_TEXTS)), size_of(self.result_folder(key))
        self._execute(f"UPDATE jobs SET bytes = ? + {texts}, used = ? WHERE id = ?", (size, time.time(), key))

    def used_bytes(self) -> int:
        """Bytes of all jobs, results, robots and drawings."""
        return self.result_bytes() + self.robot_use()[1]

    def result_bytes(self) -> int:
        """Bytes of all jobs, results and drawings."""
        return sum(self.accounts.by_owner("jobs").values()) + size_of(self.folder / VISUALS)

    def _count(self) -> None:
        self.kept_bytes = self.used_bytes()

    def shrink(self, limit: float, keep: str = "") -> int:
        """Remove results until all take at most `limit` bytes and named owners their part, and jobs ended long ago.

        Drawings go first, as they can be drawn again; then what was not used for longest, of the owner who has most.
        keep: a job that stays. Returns the number of jobs that were removed.
        """
        self.drop_drawings(limit)
        ended = "FROM jobs WHERE state NOT IN (?, ?) AND id != ?"
        forgotten = f"SELECT id {ended} ORDER BY created DESC LIMIT 1000000000 OFFSET ?"
        removed = [row[0] for row in self._execute(forgotten, (*ACTIVE, keep, ENDED_JOBS))]
        rows = self._execute(f"SELECT id, owner, bytes {ended} ORDER BY used DESC", (*ACTIVE, keep))
        sizes, robots = map(self.accounts.by_owner, ("jobs", "robots"))
        own = self._quotas.owner_disk_mb * 2**20
        limits = {owner: own - robots.get(owner, 0) if owner else math.inf for owner in sizes}
        removed += to_remove(rows, sizes, limits, self.result_bytes() - limit)
        for key in removed:
            self._delete_job(key)
        self._count()
        return len(removed)

    def drop_drawings(self, limit: float) -> None:
        """Delete the oldest drawings while results and drawings take more than `limit` bytes."""
        excess = self.result_bytes() - limit
        for path in sorted((self.folder / VISUALS).iterdir(), key=lambda path: path.stat().st_mtime):
            if excess > 0:
                excess -= path.stat().st_size
                path.unlink(missing_ok=True)
        self._count()

    def shrink_robots(self, limit: float) -> int:
        """Remove robots not used for longest until uploads take at most `limit` bytes. Returns their number."""
        excess, removed = self.robot_use()[1] - limit, 0
        for key, size in self._execute("SELECT id, bytes FROM robots ORDER BY used"):
            if excess > 0:
                self.remove_robot(key)
                excess, removed = excess - size, removed + 1
        return removed
