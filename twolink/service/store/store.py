"""What the service keeps: uploaded robots, jobs and their results, in SQLite and files under one folder.

One service uses a folder at a time: it holds SQLite's exclusive lock, which ends with its process however that ends.
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
from weakref import WeakValueDictionary

import msgspec

from twolink.service.problems import Refusal, problem_of
from twolink.service.settings import Quotas
from twolink.service.store import data_folder
from twolink.service.store.data_folder import RESULTS, ROBOTS, STAGING, VISUALS, size_of, to_remove

P = ParamSpec("P")
T = TypeVar("T")
ENDED_JOBS = 5000  # that are remembered
LISTED_JOBS = 200
ACTIVE = ("queued", "running")
RESUMED = ("sweep",)  # kinds of jobs that go on from their files when they are run again
_log = logging.getLogger("twolink.service")
_LISTED_REQUEST = 16_384  # bytes: lists leave larger requests out
_JOB_TEXTS = ("request", "progress", "problem", "result")  # JSON


class KeyedLocks:
    """`async with locks(key)` lets one task at a time work on a key. A lock lives as long as somebody uses it."""

    def __init__(self) -> None:
        self._locks: WeakValueDictionary[str, asyncio.Lock] = WeakValueDictionary()

    def __call__(self, key: str) -> asyncio.Lock:
        return self._locks.setdefault(key, asyncio.Lock())


class Job(msgspec.Struct, frozen=True):
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
        """Whether it waits or runs."""
        return self.state in ACTIVE


class Store:
    """The folder and its database. Its methods wait for the disk; an event loop calls them through `run`."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._database = data_folder.open_folder(folder)
        self._thread = ThreadPoolExecutor(1, "twolink-store")  # one: the order of calls is the order of changes
        self._loading: dict[str, tuple[str, int]] = {}  # uploads that load: their owner, and the bytes they may take
        try:
            self._repair()
        except (OSError, sqlite3.Error) as error:
            self._database.close()
            raise data_folder.unusable(folder, error) from None
        self.kept_bytes = self.used_bytes()  # as of the last change
        self.secret: str = self._execute("SELECT ids FROM secrets")[0][0]  # without it no id of an owner can be told

    def _repair(self) -> None:
        """Bring folder and database to terms after a service that was killed."""
        robots, jobs = ({row[0] for row in self._execute(f"SELECT id FROM {table}")} for table in ("robots", "jobs"))
        data_folder.tidy(self.folder, robots, jobs)
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

    async def run(self, method: Callable[P, T], *arguments: P.args, **options: P.kwargs) -> T:
        """Call a method of this store in its thread. Raises what it raises, such as sqlite3.Error and OSError."""
        call = functools.partial(method, *arguments, **options)
        return await asyncio.get_running_loop().run_in_executor(self._thread, call)

    def _execute(self, statement: str, values: tuple[Any, ...] = ()) -> list[Any]:
        return self._database.execute(statement, values).fetchall()

    def check(self, free_bytes: float) -> None:
        """Raise sqlite3.Error or OSError unless the database can be written and the disk has so much room."""
        version = self._execute("PRAGMA user_version")[0][0]
        self._execute(f"PRAGMA user_version = {version}")
        free = shutil.disk_usage(self.folder).free
        if free < free_bytes:
            what = f"{free / 2**20:.0f} MB are free, a result may take {free_bytes / 2**20:.0f} MB"
            raise OSError(errno.ENOSPC, what)

    def close(self) -> None:
        """Let go of the database and its lock."""
        self._thread.shutdown()
        self._database.close()

    # Robots

    def robot_folder(self, key: str) -> Path:
        """Where an uploaded robot's files are."""
        return self.folder / ROBOTS / key

    def reserve(self, key: str, owner: str, more: int, quotas: Quotas) -> None:
        """Keep so many bytes more for an upload while it loads, until it is unstaged.

        Raises Refusal (413) where that is more than uploads, or this owner, may take.
        """
        before = self._loading.get(key, (owner, 0))[1]
        self._require_room(owner, more, quotas)
        self._loading[key] = (owner, before + more)

    def _require_room(self, owner: str, more: int, quotas: Quotas) -> None:
        all_bytes, own = self.robot_use()[1] + more, self.owned(owner) + more
        for whose, size in self._loading.values():
            all_bytes, own = all_bytes + size, own + size * (whose == owner)
        if all_bytes > quotas.uploads_mb * 2**20:
            what = f"the service's uploads would take more than the {quotas.uploads_mb:g} MB of its disk quota"
            raise Refusal(413, what, where="body", remedy="delete some robots")
        if owner and own > quotas.owner_disk_mb * 2**20:
            what = f"what {owner} keeps would take more than {quotas.owner_disk_mb:g} MB"
            raise Refusal(413, what, where="body", remedy="delete some robots or results")

    def owned(self, owner: str) -> int:
        """Bytes of the robots and jobs of an owner."""
        return sum(self._by_owner(table).get(owner, 0) for table in ("robots", "jobs"))

    def _by_owner(self, table: str) -> dict[str, int]:
        return dict(self._execute(f"SELECT owner, sum(bytes) FROM {table} GROUP BY owner"))

    def stage(self, key: str, content: bytes) -> Path:
        """A folder for the files of an upload, with its content as "body"."""
        staged = self.folder / STAGING / key
        shutil.rmtree(staged, ignore_errors=True)
        staged.mkdir(mode=0o700)
        (staged / "body").write_bytes(content)
        return staged

    def unstage(self, staged: Path) -> None:
        """Delete the staged files of an upload, unless it was kept, and give its room back."""
        self._loading.pop(staged.name, None)
        shutil.rmtree(staged, ignore_errors=True)

    def add_robot(self, key: str, staged: Path, description: dict[str, Any], owner: str, quotas: Quotas) -> None:
        """Keep an uploaded robot, whose files are moved from the staging folder. Raises as `reserve`."""
        content = msgspec.json.encode(description)
        size = size_of(staged) + len(content)
        self._loading.pop(key, None)
        self._require_room(owner, size, quotas)  # whatever its worker has said
        target, now = self.robot_folder(key), time.time()
        shutil.rmtree(target, ignore_errors=True)  # left by a process that was killed just here
        staged.rename(target)
        columns = "id, created, used, bytes, description, owner"
        self._execute(f"INSERT OR REPLACE INTO robots ({columns}) VALUES (?, ?, ?, ?, ?, ?)",
                      (key, now, now, size, content.decode(), owner))  # fmt: skip
        self._count()

    def robot(self, key: str) -> dict[str, Any] | None:
        """The description of an uploaded robot, or None."""
        rows = self._execute("SELECT description, owner FROM robots WHERE id = ?", (key,))
        return {**msgspec.json.decode(rows[0][0]), "owner": rows[0][1]} if rows else None

    def has_robot(self, key: str) -> bool:
        """Whether a robot of this id was uploaded."""
        return bool(self._execute("SELECT 1 FROM robots WHERE id = ?", (key,)))

    def robots(self, fields: tuple[str, ...], owner: str | None) -> list[dict[str, Any]]:
        """These fields of the descriptions of an owner's uploaded robots, of all for None, the newest first."""
        picked = ", ".join(f"'{name}', json_extract(description, '$.{name}')" for name in fields)
        condition = "WHERE ? IS NULL OR owner = ? ORDER BY created DESC"
        rows = self._execute(f"SELECT json_object('owner', owner, {picked}) FROM robots {condition}", (owner, owner))
        return [msgspec.json.decode(row[0]) for row in rows]

    def robot_use(self) -> tuple[int, int]:
        """The number of uploaded robots, and their bytes."""
        count, size = self._execute("SELECT count(*), coalesce(sum(bytes), 0) FROM robots")[0]
        return count, size

    def use_robot(self, key: str) -> None:
        """Note that an uploaded robot is used."""
        self._execute("UPDATE robots SET used = ? WHERE id = ?", (time.time(), key))

    def remove_robot(self, key: str) -> None:
        """Delete an uploaded robot and its drawings."""
        self._execute("DELETE FROM robots WHERE id = ?", (key,))
        shutil.rmtree(self.robot_folder(key), ignore_errors=True)
        for path in (self.folder / VISUALS).glob(f"*-{key}.json.gz"):
            path.unlink(missing_ok=True)
        self._count()

    # Jobs

    def job(self, key: str, *, whole: bool = True) -> Job | None:
        """A job, or None. whole: with its request, progress, problem and result."""
        return next(iter(self._jobs("WHERE id = ?", key, texts=_JOB_TEXTS if whole else ())), None)

    def jobs(self, kind: str, before: float, limit: int, owner: str | None = None) -> list[Job]:
        """The newest jobs of a kind that were asked for before that time, the newest first, without their results.

        owner: whose; None: of all. Requests of more than 16 kB are left out.
        """
        condition = "WHERE kind = ? AND created < ? AND (? IS NULL OR owner = ?) ORDER BY created DESC LIMIT ?"
        short = f"CASE WHEN length(request) <= {_LISTED_REQUEST} THEN request END AS request"
        values = kind, before, owner, owner, min(limit, LISTED_JOBS)
        return self._jobs(condition, *values, texts=(short, "progress", "problem"))

    def _jobs(self, condition: str, *values: Any, texts: tuple[str, ...] = _JOB_TEXTS) -> list[Job]:
        found = [next((text for text in texts if text.endswith(name)), f"NULL AS {name}") for name in _JOB_TEXTS]
        columns = ", ".join((*Job.__struct_fields__[: -len(_JOB_TEXTS)], *found))
        rows = self._execute(f"SELECT {columns} FROM jobs {condition}", values)
        plain = len(Job.__struct_fields__) - len(_JOB_TEXTS)
        return [Job(*row[:plain], *(msgspec.Raw(text or "null") for text in row[plain:])) for row in rows]

    def new_job(self, key: str, kind: str, content: bytes, owner: str = "") -> None:
        """Note a job that waits, in place of an earlier attempt at the same. content: its request, as JSON."""
        self._drop_unfinished(key)
        self._execute("DELETE FROM jobs WHERE id = ?", (key,))
        columns, now = "id, kind, state, created, used, bytes, request, owner", time.time()
        self._execute(f"INSERT INTO jobs ({columns}) VALUES (?, ?, 'queued', ?, ?, ?, ?, ?)",
                      (key, kind, now, now, len(content), content.decode(), owner))  # fmt: skip
        self._count()

    def begin_job(self, key: str) -> tuple[Path, bytes]:
        """Note that a job runs. Returns the folder of its result, and its request."""
        folder = self.result_folder(key)
        folder.mkdir(exist_ok=True, mode=0o700)
        self.update_job(key, state="running", started=time.time())
        request: str = self._execute("SELECT request FROM jobs WHERE id = ?", (key,))[0][0]
        return folder, request.encode()

    def end_job(self, key: str, limit: float, own: float = math.inf, **values: Any) -> None:
        """Note how a job ended, and keep to the limits of bytes. Files stay of what is done, or can go on from them."""
        if values["state"] != "done":
            self._drop_unfinished(key)
        self.update_job(key, **values)
        self.measure(key, limit, own)

    def update_job(self, key: str, **values: Any) -> None:
        """Set columns of a job; what is not a number, a text or None is stored as JSON."""
        plain = [
            v if isinstance(v, (int, float, str, type(None))) else msgspec.json.encode(v).decode()
            for v in values.values()
        ]
        columns = ", ".join(f"{name} = ?" for name in values)
        self._execute(f"UPDATE jobs SET {columns} WHERE id = ?", (*plain, key))

    def use(self, key: str) -> None:
        """Note that a job's result is used."""
        self.update_job(key, used=time.time())

    def waiting(self) -> list[Job]:
        """The jobs that wait, the oldest first."""
        return self._jobs("WHERE state = 'queued' ORDER BY created", texts=())

    # Results

    def result_folder(self, key: str) -> Path:
        """Where a job's result is."""
        return self.folder / RESULTS / key

    def visuals(self, name: str) -> Path:
        """Where a robot is drawn."""
        return self.folder / VISUALS / name

    def remove_job(self, key: str) -> None:
        """Delete a job and its result."""
        self._delete_job(key)
        self._count()

    def _delete_job(self, key: str) -> None:
        self._execute("DELETE FROM jobs WHERE id = ?", (key,))
        shutil.rmtree(self.result_folder(key), ignore_errors=True)

    def _drop_unfinished(self, key: str) -> None:
        """Delete the files of a job that is not done, unless it can go on from them."""
        if key.partition("-")[0] not in RESUMED:
            shutil.rmtree(self.result_folder(key), ignore_errors=True)

    def measure(self, key: str, limit: float, own: float = math.inf) -> None:
        """Note the size of a job and its files (tables and figures are added on demand), and keep to the limits."""
        self._note_size(key)
        self.shrink(limit, own, keep=key)

    def _note_size(self, key: str) -> None:
        texts, size = " + ".join(map(_length, _JOB_TEXTS)), size_of(self.result_folder(key))
        self._execute(f"UPDATE jobs SET bytes = ? + {texts}, used = ? WHERE id = ?", (size, time.time(), key))

    def used_bytes(self) -> int:
        """Bytes of all jobs, results, robots and drawings."""
        return self.result_bytes() + self.robot_use()[1]

    def result_bytes(self) -> int:
        """Bytes of all jobs, results and drawings."""
        return sum(self._by_owner("jobs").values()) + size_of(self.folder / VISUALS)

    def _count(self) -> None:
        self.kept_bytes = self.used_bytes()

    def shrink(self, limit: float, own: float = math.inf, keep: str = "") -> int:
        """Remove results until all take at most `limit` bytes and a named owner's `own`, and jobs ended long ago.

        Drawings go first, as they can be drawn again; then what was not used for longest, of the owner who has most.
        keep: a job that stays. Returns the number of jobs that were removed.
        """
        self.drop_drawings(limit)
        ended = "FROM jobs WHERE state NOT IN (?, ?) AND id != ?"
        forgotten = f"SELECT id {ended} ORDER BY created DESC LIMIT -1 OFFSET ?"
        removed = [row[0] for row in self._execute(forgotten, (*ACTIVE, keep, ENDED_JOBS))]
        rows = self._execute(f"SELECT id, owner, bytes {ended} ORDER BY used DESC", (*ACTIVE, keep))
        sizes, robots = self._by_owner("jobs"), self._by_owner("robots")
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


def _length(column: str) -> str:
    """SQL: the bytes of a text."""
    return f"coalesce(length(CAST({column} AS BLOB)), 0)"
