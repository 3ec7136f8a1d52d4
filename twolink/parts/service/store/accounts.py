"""Accounts of owners: bytes that are kept or about to be, and seconds of processors by day."""

import time

from twolink.parts.service.problems import Refusal
from twolink.parts.service.settings import Quotas
from twolink.parts.service.store.database import Database

_FORGOTTEN = 3600.0  # s after which an upload that loads has been lost with its process


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
