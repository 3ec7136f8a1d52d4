"""What is kept: uploaded robots, jobs and their results, in SQLite and files under one folder.

Several processes may share the folder. Each owns the jobs it runs, and holds a lock on a file as long as it lives: a
job whose owner's lock is free was interrupted.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import sqlite3
import time
import uuid
from pathlib import Path
from typing import Any

import msgspec

from twolink.errors import TwolinkError

try:
    import fcntl
except ImportError:  # Windows: one process a folder
    fcntl = None  # type: ignore[assignment]

VERSION = 1
MOST_JOBS = 5000  # that have ended and are remembered; those that failed take no space, only a row
ACTIVE = ("queued", "running")
_SCHEMA = """
CREATE TABLE robots (id TEXT PRIMARY KEY, created REAL, used REAL, bytes INTEGER, description TEXT) WITHOUT ROWID;
CREATE TABLE jobs (
    id TEXT PRIMARY KEY, kind TEXT, request TEXT, state TEXT, owner TEXT, created REAL, started REAL, ended REAL,
    used REAL, progress TEXT, problem TEXT, result TEXT, bytes INTEGER DEFAULT 0, cancel INTEGER DEFAULT 0
) WITHOUT ROWID;
CREATE INDEX jobs_by_state ON jobs (state);
"""


class Store:
    """The folder and its database. Used from one thread at a time."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        try:
            for part in ("robots", "results", "owners", "staging"):
                (folder / part).mkdir(parents=True, exist_ok=True, mode=0o700)
            self._database = sqlite3.connect(
                folder / "twolink.sqlite", timeout=10, isolation_level=None, check_same_thread=False
            )
            self._prepare()
        except (OSError, sqlite3.Error) as error:
            raise TwolinkError(f"cannot be used: {error}", where=str(folder), remedy="give another --data") from None
        self.owner = uuid.uuid4().hex
        self._lock = _hold(folder / "owners" / self.owner)

    def _prepare(self) -> None:
        self._database.row_factory = sqlite3.Row
        self._database.execute("PRAGMA journal_mode = WAL")
        self._database.execute("PRAGMA synchronous = NORMAL")
        self._database.execute("BEGIN IMMEDIATE")  # several processes start at once
        found = self._database.execute("PRAGMA user_version").fetchone()[0]
        if found == 0:
            for statement in _SCHEMA.split(";"):
                self._database.execute(statement)
            self._database.execute(f"PRAGMA user_version = {VERSION}")
        self._database.execute("COMMIT")
        if found not in (0, VERSION):
            raise sqlite3.Error(f"it is of another version of twolink ({found}, this one has {VERSION})")

    def close(self) -> None:
        """Let go of the database and the lock."""
        self._database.close()
        if self._lock is not None:
            os.close(self._lock)
        (self.folder / "owners" / self.owner).unlink(missing_ok=True)

    # Robots

    def robot_folder(self, key: str) -> Path:
        """Where an uploaded robot's files are."""
        return self.folder / "robots" / key

    def add_robot(self, key: str, staged: Path, description: dict[str, Any]) -> None:
        """Keep an uploaded robot, whose files are moved from the staging folder."""
        target = self.robot_folder(key)
        shutil.rmtree(target, ignore_errors=True)  # left by a process that was killed just here
        staged.rename(target)
        now, size = time.time(), _bytes(target)
        self._database.execute(
            "INSERT OR REPLACE INTO robots VALUES (?, ?, ?, ?, ?)", (key, now, now, size, _json(description))
        )

    def robot(self, key: str) -> dict[str, Any] | None:
        """What is known of an uploaded robot, or None."""
        row = self._database.execute("SELECT description FROM robots WHERE id = ?", (key,)).fetchone()
        if row is None:
            return None
        description: dict[str, Any] = msgspec.json.decode(row["description"])
        return description

    def measure_robot(self, key: str) -> None:
        """Note how much an uploaded robot takes: its visuals are added on demand."""
        size = _bytes(self.robot_folder(key))
        self._database.execute("UPDATE robots SET bytes = ? WHERE id = ?", (size, key))

    def robots(self) -> list[dict[str, Any]]:
        """All uploaded robots, the newest first."""
        rows = self._database.execute("SELECT description FROM robots ORDER BY created DESC").fetchall()
        return [msgspec.json.decode(row["description"]) for row in rows]

    def remove_robot(self, key: str) -> bool:
        """Forget an uploaded robot. Returns whether there was one."""
        gone = self._database.execute("DELETE FROM robots WHERE id = ?", (key,)).rowcount > 0
        shutil.rmtree(self.robot_folder(key), ignore_errors=True)
        return gone

    # Jobs

    def job(self, key: str) -> dict[str, Any] | None:
        """A job's row, or None."""
        row = self._database.execute("SELECT * FROM jobs WHERE id = ?", (key,)).fetchone()
        return None if row is None else dict(row)

    def jobs(self, kind: str, most: int = 200) -> list[dict[str, Any]]:
        """The rows of a kind, the newest first."""
        query = "SELECT * FROM jobs WHERE kind = ? ORDER BY created DESC LIMIT ?"
        return [dict(row) for row in self._database.execute(query, (kind, most))]

    def new_job(self, key: str, kind: str, request: Any) -> None:
        """Note a job of this process, in place of an earlier try at the same."""
        shutil.rmtree(self.result_folder(key), ignore_errors=True)
        now = time.time()
        self._database.execute(
            "INSERT OR REPLACE INTO jobs (id, kind, request, state, owner, created, used) VALUES (?, ?, ?, ?, ?, ?, ?)",
            (key, kind, _json(request), "queued", self.owner, now, now),
        )

    def update_job(self, key: str, **values: Any) -> None:
        """Set columns of a job; what is not a number or text is kept as JSON."""
        plain = [v if v is None or isinstance(v, (int, float, str)) else _json(v) for v in values.values()]
        columns = ", ".join(f"{name} = ?" for name in values)
        self._database.execute(f"UPDATE jobs SET {columns} WHERE id = ?", (*plain, key))

    def active(self) -> int:
        """How many jobs wait or run, in all processes."""
        return int(self._database.execute("SELECT count(*) FROM jobs WHERE state IN (?, ?)", ACTIVE).fetchone()[0])

    def mark_interrupted(self) -> list[dict[str, Any]]:
        """Mark the jobs whose process is no more, and return them."""
        found = []
        for row in self._database.execute("SELECT * FROM jobs WHERE state IN (?, ?)", ACTIVE).fetchall():
            if row["owner"] != self.owner and not _is_held(self.folder / "owners" / row["owner"]):
                self.update_job(row["id"], state="interrupted", ended=time.time())
                found.append(dict(row))
        return found

    # Results

    def result_folder(self, key: str) -> Path:
        """Where a job's result is."""
        return self.folder / "results" / key

    def remove_job(self, key: str) -> None:
        """Forget a job and its result."""
        self._database.execute("DELETE FROM jobs WHERE id = ?", (key,))
        shutil.rmtree(self.result_folder(key), ignore_errors=True)

    def measure(self, key: str) -> None:
        """Note how much a job's result takes: playbacks and tables are added on demand."""
        self.update_job(key, bytes=_bytes(self.result_folder(key)), used=time.time())

    def used_bytes(self) -> int:
        """Bytes of all results and robots."""
        total = "SELECT (SELECT coalesce(sum(bytes), 0) FROM jobs) + (SELECT coalesce(sum(bytes), 0) FROM robots)"
        return int(self._database.execute(total).fetchone()[0])

    def shrink(self, most: float) -> list[str]:
        """Remove the results that were not used for longest until all takes at most so many bytes; return their ids."""
        gone = []
        query = "SELECT id, bytes FROM jobs WHERE state NOT IN (?, ?) AND bytes > 0 ORDER BY used"
        excess = self.used_bytes() - most
        for row in self._database.execute(query, ACTIVE).fetchall():
            if excess <= 0:
                break
            self.remove_job(row["id"])
            excess -= row["bytes"]
            gone.append(row["id"])
        ended = "SELECT id FROM jobs WHERE state NOT IN (?, ?) ORDER BY created DESC LIMIT -1 OFFSET ?"
        for row in self._database.execute(ended, (*ACTIVE, MOST_JOBS)).fetchall():
            self.remove_job(row["id"])
            gone.append(row["id"])
        return gone

    def clean(self) -> None:
        """Remove what a killed process left half done: staged uploads, and locks of processes that are no more."""
        for path in (self.folder / "staging").iterdir():
            if time.time() - path.stat().st_mtime > 3600:
                shutil.rmtree(path, ignore_errors=True)
        for path in (self.folder / "owners").iterdir():
            # A young one may be of a process that has made it and not locked it yet.
            if time.time() - path.stat().st_mtime > 3600 and not _is_held(path):
                path.unlink(missing_ok=True)


def _json(value: Any) -> str:
    return msgspec.json.encode(value).decode()


def _bytes(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def _hold(path: Path) -> int | None:
    """Create a file and hold its lock until this process ends, however it ends."""
    handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o600)
    if fcntl is not None:
        fcntl.flock(handle, fcntl.LOCK_EX)
    return handle


def _is_held(path: Path) -> bool:
    if fcntl is None:
        return False
    with contextlib.suppress(OSError):
        handle = os.open(path, os.O_RDWR)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
        finally:
            os.close(handle)
    return False
