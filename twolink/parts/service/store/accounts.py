"""Accounts of owners, and leases of jobs, in the database that several processes may share.

Accounts: bytes that are kept or about to be, and seconds of processors by day. Leases: who claims a job says every
second that it lives, and who has not for long has lost it.
"""

import os
import secrets
import socket
import time
from typing import Any

import msgspec

from twolink.parts.service.problems import Refusal, problem_of
from twolink.parts.service.settings import Quotas
from twolink.parts.service.store.database import Database

_FORGOTTEN = 3600.0  # s after which an upload that loads has been lost with its process
LEASE = 15.0  # s without a sign of life after which another process may run a job
TRIES = 3  # of a job: it may be what kills its processes


class Accounts:
    """The sums of a database. process: that reserves. quotas: limits of the sums."""

    def __init__(self, database: Database, process: str, quotas: Quotas) -> None:
        self._execute, self._clock, self._process = database.execute, database.clock, process
        self._quotas = quotas

    def by_owner(self, table: str) -> dict[str, int]:
        """Bytes of the robots, jobs or uploads that load."""
        rows = self._execute(f"SELECT owner, sum(bytes) FROM {table} GROUP BY owner")
        return {owner: int(size) for owner, size in rows}

    def reserve(self, key: str, owner: str, more: int) -> None:
        """Keep so many bytes more for an upload while it loads, until they are given back.

        They are counted first and looked at then, so that of several at once none can take what is not there.
        Raises Refusal (413) where that is more than uploads, or this owner, may take.
        """
        self._count(key, owner, more)
        try:
            self._require_room(owner)
        except BaseException:
            self._count(key, owner, -more)
            raise

    def _count(self, key: str, owner: str, more: int) -> None:
        add = (
            "ON CONFLICT (id, process) DO UPDATE SET bytes = loading.bytes + excluded.bytes, beat = excluded.beat, "
            "owner = excluded.owner"
        )
        self._execute(f"INSERT INTO loading (id, process, owner, bytes, beat) VALUES (?, ?, ?, ?, {self._clock}) {add}",
                      (key, self._process, owner, more))  # fmt: skip

    def _require_room(self, owner: str) -> None:
        quotas = self._quotas
        loading, robots, jobs = map(self.by_owner, ("loading", "robots", "jobs"))
        if sum(loading.values()) + sum(robots.values()) > quotas.uploads_mb * 2**20:
            what = f"the service's uploads would take more than the {quotas.uploads_mb:g} MB of its disk quota"
            raise Refusal(413, what, where="body", remedy="delete some robots")
        if owner and sum(one.get(owner, 0) for one in (loading, robots, jobs)) > quotas.owner_disk_mb * 2**20:
            what = f"what {owner} keeps would take more than {quotas.owner_disk_mb:g} MB"
            raise Refusal(413, what, where="body", remedy="delete some robots or results")

    def require_place(self, owner: str) -> None:
        """Raise Refusal (429) where an owner has so many jobs that wait or run."""
        active = "SELECT count(*) FROM jobs WHERE owner = ? AND state IN ('queued', 'running')"
        count = self._execute(active, (owner,))[0][0]
        if count >= self._quotas.queue + self._quotas.jobs:
            raise Refusal(429, f"{count} jobs of {owner} wait already", where="request",
                          remedy="wait until some are done", retry_after=10)  # fmt: skip

    def give_back(self, key: str) -> None:
        """Give back what an upload has reserved."""
        self._execute("DELETE FROM loading WHERE id = ? AND process = ?", (key, self._process))

    def forgotten(self) -> list[str]:
        """Give back what lost processes have reserved. Returns the ids of these uploads."""
        rows = self._execute(f"DELETE FROM loading WHERE beat < {self._clock} - {_FORGOTTEN} RETURNING id")
        return [row[0] for row in rows]

    def spend(self, owner: str, seconds: float) -> float:
        """Note seconds of processors that an owner has had. Returns those of today."""
        spent = "INSERT INTO spent (owner, day, seconds) VALUES (?, ?, ?)"
        add = "ON CONFLICT (owner, day) DO UPDATE SET seconds = spent.seconds + excluded.seconds RETURNING seconds"
        return float(self._execute(f"{spent} {add}", (owner, today(), seconds))[0][0])


def today() -> str:
    """The day, in UTC."""
    return time.strftime("%Y-%m-%d", time.gmtime())


class Leases:
    """The jobs that this process has claimed, by its name in the database."""

    def __init__(self, database: Database) -> None:
        self._execute, self._clock, self._skip_locked = database.execute, database.clock, database.skip_locked
        self.process = f"{socket.gethostname()}:{os.getpid()}:{secrets.token_hex(4)}"

    def claim(self, count: int = 1, key: str | None = None, day: str = "") -> list[tuple[str, str, str]]:
        """Claim jobs that wait: that one, or the oldest of owners who had least of the processors on that day.

        Returns id, kind and owner of those that no other process has claimed.
        """
        which, values = ("", (day, count)) if key is None else ("AND id = ?", (key, day, count))
        used = "SELECT coalesce(sum(seconds), 0) FROM spent WHERE spent.owner = jobs.owner AND day = ?"
        rows = self._execute(
            f"WITH picked AS MATERIALIZED (SELECT id FROM jobs WHERE state = 'queued' {which} "
            f"ORDER BY ({used}), created LIMIT ? {self._skip_locked}) "
            f"UPDATE jobs SET state = 'running', process = ?, beat = {self._clock}, started = {self._clock}, "
            "tries = tries + 1, cancel = 0 WHERE id IN (SELECT id FROM picked) RETURNING id, kind, owner",
            (*values, self.process),
        )
        return [tuple(row) for row in rows]

    def has(self, key: str) -> bool:
        """True if this process has claimed a job last."""
        which = "SELECT 1 FROM jobs WHERE id = ? AND process = ?"
        return bool(self._execute(which, (key, self.process)))

    def beat(self, key: str, progress: Any) -> bool | None:
        """Note that a job of this process goes on, and how far it is: whether it is to end; None when it is lost."""
        rows = self._execute(
            f"UPDATE jobs SET beat = {self._clock}, progress = ? "
            "WHERE id = ? AND process = ? AND state = 'running' RETURNING cancel",
            (msgspec.json.encode(progress).decode(), key, self.process),
        )
        return bool(rows[0][0]) if rows else None

    def end(self, key: str, columns: dict[str, Any]) -> bool:
        """Set columns of a job that waits, or that this process has. False, and nothing is set, when it has it not."""
        names = ", ".join(f"{name} = ?" for name in columns)
        statement = f"UPDATE jobs SET {names} WHERE id = ? AND (state = 'queued' OR process = ?) RETURNING id"
        return bool(self._execute(statement, (*columns.values(), key, self.process)))

    def cancel(self, key: str) -> None:
        """Cancel a job that waits, and tell the process that runs it."""
        ended = f"state = 'cancelled', ended = {self._clock}"
        self._execute("UPDATE jobs SET cancel = 1 WHERE id = ?", (key,))
        self._execute(f"UPDATE jobs SET {ended} WHERE id = ? AND state = 'queued'", (key,))

    def waiting(self, keys: list[str]) -> set[str]:
        """Keys of these jobs that still wait."""
        marks = ", ".join("?" * len(keys)) or "NULL"
        rows = self._execute(f"SELECT id FROM jobs WHERE state = 'queued' AND id IN ({marks})", tuple(keys))
        return {row[0] for row in rows}

    def expire(self) -> list[tuple[str, str]]:
        """Put the jobs of lost processes back into the queue, and give up those that were tried too often.

        Returns their ids and states.
        """
        what = f"{TRIES} processes of the service ended while the job ran"
        problem = problem_of(Refusal(503, what, code="interrupted", remedy="run it again"))
        old = f"state = 'running' AND beat < {self._clock} - {LEASE}"
        given_up = self._execute(
            f"UPDATE jobs SET state = 'interrupted', ended = {self._clock}, problem = ?, process = '' "
            f"WHERE {old} AND tries >= {TRIES} RETURNING id, state",
            (msgspec.json.encode(problem).decode(),),
        )
        state = "CASE WHEN cancel = 1 THEN 'cancelled' ELSE 'queued' END"
        again = f"UPDATE jobs SET state = {state}, started = NULL, process = '' WHERE {old} RETURNING id, state"
        return [tuple(row) for row in (*given_up, *self._execute(again))]
