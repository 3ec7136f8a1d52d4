"""What the service keeps: uploaded robots, jobs and their results, in SQLite and files under one folder.

One service uses a folder at a time: it holds SQLite's exclusive lock, which ends with its process however that ends.
"""

import shutil
import sqlite3
import time
from pathlib import Path
from typing import Any

import msgspec

from twolink.errors import TwolinkError

VERSION = 2
ENDED_JOBS = 5000  # that are remembered; failed ones take no space but a row
LISTED_JOBS = 200
ACTIVE = ("queued", "running")


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
    """The folder and its database. To be used from one thread."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        try:
            for part in ("robots", "results", "staging"):
                (folder / part).mkdir(parents=True, exist_ok=True, mode=0o700)
            self._database = sqlite3.connect(folder / "twolink.sqlite", isolation_level=None, check_same_thread=False)
            self._prepare()
        except (OSError, sqlite3.Error) as error:
            remedy = "end the service that uses it, or give another --data"
            raise TwolinkError(f"cannot be used: {error}", where=str(folder), remedy=remedy) from None
        for left in (folder / "staging").iterdir():  # by a service that was killed
            shutil.rmtree(left, ignore_errors=True)

    def _prepare(self) -> None:
        for setting in ("locking_mode = EXCLUSIVE", "journal_mode = WAL", "synchronous = NORMAL"):
            self._database.execute(f"PRAGMA {setting}")
        version = self._database.execute("PRAGMA user_version").fetchone()[0]
        if version > VERSION:
            raise sqlite3.Error(f"it is of a newer version of twolink ({version}, this one has {VERSION})")
        if version < VERSION:
            schema = Path(__file__).with_name(f"schema_{version}_to_{VERSION}.sql").read_text(encoding="utf-8")
            self._database.executescript(f"BEGIN; {schema} COMMIT")

    def close(self) -> None:
        """Let go of the database and its lock."""
        self._database.close()

    # Robots

    def robot_folder(self, key: str) -> Path:
        """Where an uploaded robot's files are."""
        return self.folder / "robots" / key

    def add_robot(self, key: str, staged: Path, description: dict[str, Any]) -> None:
        """Keep an uploaded robot, whose files are moved from the staging folder."""
        target = self.robot_folder(key)
        shutil.rmtree(target, ignore_errors=True)  # left by a process that was killed just here
        staged.rename(target)
        now, content = time.time(), msgspec.json.encode(description).decode()
        self._database.execute("INSERT OR REPLACE INTO robots VALUES (?, ?, ?, ?, ?)",
                               (key, now, now, _bytes(target), content))  # fmt: skip

    def robot(self, key: str) -> dict[str, Any] | None:
        """The description of an uploaded robot, or None."""
        row = self._database.execute("SELECT description FROM robots WHERE id = ?", (key,)).fetchone()
        description: dict[str, Any] | None = None if row is None else msgspec.json.decode(row[0])
        return description

    def robots(self) -> list[dict[str, Any]]:
        """The descriptions of all uploaded robots, the newest first."""
        rows = self._database.execute("SELECT description FROM robots ORDER BY created DESC")
        return [msgspec.json.decode(row[0]) for row in rows]

    def measure_robot(self, key: str) -> None:
        """Note the size of an uploaded robot again: its visuals are added on demand."""
        self._database.execute("UPDATE robots SET bytes = ? WHERE id = ?", (_bytes(self.robot_folder(key)), key))

    def remove_robot(self, key: str) -> None:
        """Delete an uploaded robot."""
        self._database.execute("DELETE FROM robots WHERE id = ?", (key,))
        shutil.rmtree(self.robot_folder(key), ignore_errors=True)

    # Jobs

    def job(self, key: str) -> Job | None:
        """A job, or None."""
        return next(iter(self._jobs("WHERE id = ?", key)), None)

    def jobs(self, kind: str) -> list[Job]:
        """The newest jobs of a kind, the newest first."""
        return self._jobs("WHERE kind = ? ORDER BY created DESC LIMIT ?", kind, LISTED_JOBS)

    def _jobs(self, condition: str, *values: Any) -> list[Job]:
        rows = self._database.execute(f"SELECT {', '.join(Job.__struct_fields__)} FROM jobs {condition}", values)
        return [Job(*row[:8], *(msgspec.Raw(text or "null") for text in row[8:])) for row in rows]

    def new_job(self, key: str, kind: str, request: Any) -> None:
        """Note a job that waits, in place of an earlier attempt at the same."""
        self.remove_job(key)
        now, content = time.time(), msgspec.json.encode(request).decode()
        self._database.execute(
            "INSERT INTO jobs (id, kind, state, created, used, request) VALUES (?, ?, 'queued', ?, ?, ?)",
            (key, kind, now, now, content),
        )

    def update_job(self, key: str, **values: Any) -> None:
        """Set columns of a job; what is not a number or a text is stored as JSON."""
        plain = [v if isinstance(v, (int, float, str)) else msgspec.json.encode(v).decode() for v in values.values()]
        columns = ", ".join(f"{name} = ?" for name in values)
        self._database.execute(f"UPDATE jobs SET {columns} WHERE id = ?", (*plain, key))

    def active(self) -> int:
        """How many jobs wait or run."""
        return int(self._database.execute("SELECT count(*) FROM jobs WHERE state IN (?, ?)", ACTIVE).fetchone()[0])

    def mark_interrupted(self) -> list[Job]:
        """Mark the jobs that an earlier service has left waiting or running, and return them."""
        jobs = self._jobs("WHERE state IN (?, ?)", *ACTIVE)
        for job in jobs:
            self.update_job(job.id, state="interrupted", ended=time.time())
        return jobs

    # Results

    def result_folder(self, key: str) -> Path:
        """Where a job's result is."""
        return self.folder / "results" / key

    def remove_job(self, key: str) -> None:
        """Delete a job and its result."""
        self._database.execute("DELETE FROM jobs WHERE id = ?", (key,))
        shutil.rmtree(self.result_folder(key), ignore_errors=True)

    def measure(self, key: str) -> None:
        """Note the size of a job's result: playbacks and tables are added on demand."""
        self.update_job(key, bytes=_bytes(self.result_folder(key)), used=time.time())

    def used_bytes(self) -> int:
        """Bytes of all results and robots."""
        total = "SELECT (SELECT coalesce(sum(bytes), 0) FROM jobs) + (SELECT coalesce(sum(bytes), 0) FROM robots)"
        return int(self._database.execute(total).fetchone()[0])

    def shrink(self, limit: float) -> None:
        """Remove the results not used for longest until all takes at most `limit` bytes, and jobs ended long ago."""
        excess = self.used_bytes() - limit
        for job in self._jobs("WHERE state NOT IN (?, ?) AND bytes > 0 ORDER BY used", *ACTIVE) if excess > 0 else ():
            if excess > 0:
                self.remove_job(job.id)
                excess -= job.bytes
        for job in self._jobs("WHERE state NOT IN (?, ?) ORDER BY created DESC LIMIT -1 OFFSET ?", *ACTIVE, ENDED_JOBS):
            self.remove_job(job.id)


def _bytes(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
