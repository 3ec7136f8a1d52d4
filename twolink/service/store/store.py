"""What the service keeps: uploaded robots, jobs and their results, in SQLite and files under one folder.

One service uses a folder at a time: it holds SQLite's exclusive lock, which ends with its process however that ends.
"""

import asyncio
import errno
import functools
import logging
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
from twolink.service.store.data_folder import RESULTS, ROBOTS, STAGING, VISUALS, open_folder, size_of, tidy, unusable

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
        self._database = open_folder(folder)
        self._thread = ThreadPoolExecutor(1, "twolink-store")  # one: the order of calls is the order of changes
        try:
            self._repair()
        except (OSError, sqlite3.Error) as error:
            self._database.close()
            raise unusable(folder, error) from None
        self.kept_bytes = self.used_bytes()  # as of the last change

    def _repair(self) -> None:
        """Bring folder and database to terms after a service that was killed."""
        robots, jobs = ({row[0] for row in self._execute(f"SELECT id FROM {table}")} for table in ("robots", "jobs"))
        tidy(self.folder, robots, jobs)
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
            raise OSError(
                errno.ENOSPC, f"{free / 2**20:.0f} MB are free, a result may take {free_bytes / 2**20:.0f} MB"
            )

    def close(self) -> None:
        """Let go of the database and its lock."""
        self._thread.shutdown()
        self._database.close()

    # Robots

    def robot_folder(self, key: str) -> Path:
        """Where an uploaded robot's files are."""
        return self.folder / ROBOTS / key

    def stage(self, key: str, content: bytes) -> Path:
        """A folder for the files of an upload, with its content as "body"."""
        staged = self.folder / STAGING / key
        shutil.rmtree(staged, ignore_errors=True)
        staged.mkdir(mode=0o700)
        (staged / "body").write_bytes(content)
        return staged

    def unstage(self, staged: Path) -> None:
        """Delete the staged files of an upload, unless it was kept."""
        shutil.rmtree(staged, ignore_errors=True)

    def add_robot(self, key: str, staged: Path, description: dict[str, Any], limit: float) -> None:
        """Keep an uploaded robot, whose files are moved from the staging folder, and keep to the limit of bytes."""
        target = self.robot_folder(key)
        shutil.rmtree(target, ignore_errors=True)  # left by a process that was killed just here
        staged.rename(target)
        now, content = time.time(), msgspec.json.encode(description).decode()
        self._execute("INSERT OR REPLACE INTO robots VALUES (?, ?, ?, 0, ?)", (key, now, now, content))
        self.measure_robot(key, limit)

    def robot(self, key: str) -> dict[str, Any] | None:
        """The description of an uploaded robot, or None."""
        rows = self._execute("SELECT description FROM robots WHERE id = ?", (key,))
        description: dict[str, Any] | None = msgspec.json.decode(rows[0][0]) if rows else None
        return description

    def has_robot(self, key: str) -> bool:
        """Whether a robot of this id was uploaded."""
        return bool(self._execute("SELECT 1 FROM robots WHERE id = ?", (key,)))

    def robots(self, fields: tuple[str, ...]) -> list[dict[str, Any]]:
        """These fields of the descriptions of all uploaded robots, the newest first."""
        picked = ", ".join(f"'{name}', json_extract(description, '$.{name}')" for name in fields)
        rows = self._execute(f"SELECT json_object({picked}) FROM robots ORDER BY created DESC")
        return [msgspec.json.decode(row[0]) for row in rows]

    def robot_use(self) -> tuple[int, int]:
        """The number of uploaded robots, and their bytes."""
        count, size = self._execute("SELECT count(*), coalesce(sum(bytes), 0) FROM robots")[0]
        return count, size

    def measure_robot(self, key: str, limit: float) -> None:
        """Note the size of an uploaded robot (its visuals are added on demand), and keep to the limit of bytes."""
        size = size_of(self.robot_folder(key))
        self._execute(f"UPDATE robots SET bytes = ? + {_length('description')} WHERE id = ?", (size, key))
        self.shrink(limit)

    def remove_robot(self, key: str) -> None:
        """Delete an uploaded robot."""
        self._execute("DELETE FROM robots WHERE id = ?", (key,))
        shutil.rmtree(self.robot_folder(key), ignore_errors=True)
        self._count()

    # Jobs

    def job(self, key: str, *, whole: bool = True) -> Job | None:
        """A job, or None. whole: with its request, progress, problem and result."""
        return next(iter(self._jobs("WHERE id = ?", key, texts=_JOB_TEXTS if whole else ())), None)

    def jobs(self, kind: str, before: float, limit: int) -> list[Job]:
        """The newest jobs of a kind that were asked for before that time, the newest first, without their results.

        Requests of more than 16 kB are left out.
        """
        condition = "WHERE kind = ? AND created < ? ORDER BY created DESC LIMIT ?"
        short = f"CASE WHEN length(request) <= {_LISTED_REQUEST} THEN request END AS request"
        return self._jobs(condition, kind, before, min(limit, LISTED_JOBS), texts=(short, "progress", "problem"))

    def _jobs(self, condition: str, *values: Any, texts: tuple[str, ...] = _JOB_TEXTS) -> list[Job]:
        found = [next((text for text in texts if text.endswith(name)), f"NULL AS {name}") for name in _JOB_TEXTS]
        columns = ", ".join((*Job.__struct_fields__[: -len(_JOB_TEXTS)], *found))
        rows = self._execute(f"SELECT {columns} FROM jobs {condition}", values)
        return [Job(*row[:8], *(msgspec.Raw(text or "null") for text in row[8:])) for row in rows]

    def new_job(self, key: str, kind: str, content: bytes) -> None:
        """Note a job that waits, in place of an earlier attempt at the same. content: its request, as JSON."""
        self._drop_unfinished(key)
        self._execute("DELETE FROM jobs WHERE id = ?", (key,))
        now = time.time()
        self._execute(
            "INSERT INTO jobs (id, kind, state, created, used, bytes, request) VALUES (?, ?, 'queued', ?, ?, ?, ?)",
            (key, kind, now, now, len(content), content.decode()),
        )
        self._count()

    def begin_job(self, key: str) -> tuple[Path, bytes]:
        """Note that a job runs. Returns the folder of its result, and its request."""
        folder = self.result_folder(key)
        folder.mkdir(exist_ok=True, mode=0o700)
        self.update_job(key, state="running", started=time.time())
        request: str = self._execute("SELECT request FROM jobs WHERE id = ?", (key,))[0][0]
        return folder, request.encode()

    def end_job(self, key: str, limit: float, **values: Any) -> None:
        """Note how a job ended, and keep to the limit of bytes. Files stay of what is done, or can go on from them."""
        if values["state"] != "done":
            self._drop_unfinished(key)
        self.update_job(key, **values)
        self.measure(key, limit)

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
        """Where a robot of the catalogue is drawn."""
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

    def measure(self, key: str, limit: float) -> None:
        """Note the size of a job and its files (tables and figures are added on demand), and keep to the limit."""
        self._note_size(key)
        self.shrink(limit, keep=key)

    def _note_size(self, key: str) -> None:
        texts, size = " + ".join(map(_length, _JOB_TEXTS)), size_of(self.result_folder(key))
        self._execute(f"UPDATE jobs SET bytes = ? + {texts}, used = ? WHERE id = ?", (size, time.time(), key))

    def used_bytes(self) -> int:
        """Bytes of all jobs, results, robots and drawings."""
        total = "SELECT (SELECT coalesce(sum(bytes), 0) FROM jobs) + (SELECT coalesce(sum(bytes), 0) FROM robots)"
        return int(self._execute(total)[0][0]) + size_of(self.folder / VISUALS)

    def _count(self) -> None:
        self.kept_bytes = self.used_bytes()

    def shrink(self, limit: float, keep: str = "") -> int:
        """Remove what was not used for longest until all takes at most `limit` bytes, and jobs ended long ago.

        Drawings of the catalogue's robots go first, as they can be drawn again. keep: a job that stays. Returns the
        number of jobs that were removed.
        """
        excess = self.used_bytes() - limit
        for path in sorted((self.folder / VISUALS).iterdir(), key=lambda path: path.stat().st_mtime):
            if excess > 0:
                excess -= path.stat().st_size
                path.unlink(missing_ok=True)
        ended = "FROM jobs WHERE state NOT IN (?, ?) AND id != ?"
        removed = self._execute(
            f"SELECT id {ended} ORDER BY created DESC LIMIT -1 OFFSET ?", (*ACTIVE, keep, ENDED_JOBS)
        )
        for key, size in (
            self._execute(f"SELECT id, bytes {ended} ORDER BY used", (*ACTIVE, keep)) if excess > 0 else ()
        ):
            if excess > 0:
                removed.append((key,))
                excess -= size
        for row in removed:
            self._delete_job(row[0])
        self._count()
        return len(removed)


def _length(column: str) -> str:
    """SQL: the bytes of a text."""
    return f"coalesce(length(CAST({column} AS BLOB)), 0)"
