"""Leases of jobs: who claims one says every second that it lives, and who has not for long has lost it."""

import os
import secrets
import socket
from typing import Any

import msgspec

from twolink.parts.service.problems import Refusal, problem_of
from twolink.parts.service.store.database import Database

LEASE = 15.0  # s without a sign of life after which another process may run a job
TRIES = 3  # of a job: it may be what kills its processes


class Leases:
    """The jobs that this process has claimed, by its name in the database."""

    def __init__(self, database: Database) -> None:
        self._database = database
        self.process = f"{socket.gethostname()}:{os.getpid()}:{secrets.token_hex(4)}"

    def claim(self, count: int = 1, key: str | None = None, day: str = "") -> list[tuple[str, str, str]]:
        """Claim jobs that wait: that one, or the oldest of owners who had least of the processors on that day.

        Returns id, kind and owner of those that no other process has claimed.
        """
        database = self._database
        which, values = ("", (day, count)) if key is None else ("AND id = ?", (key, day, count))
        used = "SELECT coalesce(sum(seconds), 0) FROM spent WHERE spent.owner = jobs.owner AND day = ?"
        rows = database.execute(
            f"WITH picked AS MATERIALIZED (SELECT id FROM jobs WHERE state = 'queued' {which} "
            f"ORDER BY ({used}), created LIMIT ? {database.skip_locked}) "
            f"UPDATE jobs SET state = 'running', process = ?, beat = {database.clock}, started = {database.clock}, "
            "tries = tries + 1, cancel = 0 WHERE id IN (SELECT id FROM picked) RETURNING id, kind, owner",
            (*values, self.process),
        )
        return [tuple(row) for row in rows]

    def has(self, key: str) -> bool:
        """True if this process has claimed a job last."""
        which = "SELECT 1 FROM jobs WHERE id = ? AND process = ?"
        return bool(self._database.execute(which, (key, self.process)))

    def beat(self, key: str, progress: Any) -> bool | None:
        """Note that a job of this process goes on, and how far it is: whether it is to end; None when it is lost."""
        rows = self._database.execute(
            f"UPDATE jobs SET beat = {self._database.clock}, progress = ? "
            "WHERE id = ? AND process = ? AND state = 'running' RETURNING cancel",
            (msgspec.json.encode(progress).decode(), key, self.process),
        )
        return bool(rows[0][0]) if rows else None

    def end(self, key: str, columns: dict[str, Any]) -> bool:
        """Set columns of a job that waits, or that this process has. False, and nothing is set, when it has it not."""
        names = ", ".join(f"{name} = ?" for name in columns)
        statement = f"UPDATE jobs SET {names} WHERE id = ? AND (state = 'queued' OR process = ?) RETURNING id"
        return bool(self._database.execute(statement, (*columns.values(), key, self.process)))

    def cancel(self, key: str) -> None:
        """Cancel a job that waits, and tell the process that runs it."""
        ended = f"state = 'cancelled', ended = {self._database.clock}"
        self._database.execute("UPDATE jobs SET cancel = 1 WHERE id = ?", (key,))
        self._database.execute(f"UPDATE jobs SET {ended} WHERE id = ? AND state = 'queued'", (key,))

    def waiting(self, keys: list[str]) -> set[str]:
        """Keys of these jobs that still wait."""
        marks = ", ".join("?" * len(keys)) or "NULL"
        rows = self._database.execute(f"SELECT id FROM jobs WHERE state = 'queued' AND id IN ({marks})", tuple(keys))
        return {row[0] for row in rows}

    def expire(self) -> list[tuple[str, str]]:
        """Put the jobs of lost processes back into the queue, and give up those that were tried too often.

        Returns their ids and states.
        """
        what = f"{TRIES} processes of the service ended while the job ran"
        problem = problem_of(Refusal(503, what, code="interrupted", remedy="run it again"))
        old = f"state = 'running' AND beat < {self._database.clock} - {LEASE}"
        given_up = self._database.execute(
            f"UPDATE jobs SET state = 'interrupted', ended = {self._database.clock}, problem = ?, process = '' "
            f"WHERE {old} AND tries >= {TRIES} RETURNING id, state",
            (msgspec.json.encode(problem).decode(),),
        )
        state = "CASE WHEN cancel = 1 THEN 'cancelled' ELSE 'queued' END"
        again = f"UPDATE jobs SET state = {state}, started = NULL, process = '' WHERE {old} RETURNING id, state"
        return [tuple(row) for row in (*given_up, *self._database.execute(again))]
