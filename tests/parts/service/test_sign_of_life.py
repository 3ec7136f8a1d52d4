"""Signs of life of a process that shares a database with others."""

import asyncio
from types import SimpleNamespace
from typing import Any

from twolink.parts.service.work.cluster import Member
from twolink.parts.service.work.job_views import Running


def test_a_job_whose_result_is_stored_is_alive() -> None:
    """Else another process takes it up after some seconds, though it is done."""
    beaten: list[str] = []

    async def run(method: Any, *arguments: Any) -> Any:
        return method(*arguments)

    leases = SimpleNamespace(waiting=lambda _: set(), beat=lambda key, _: beaten.append(key))
    running = Running("simulation", None, claimed=True, ending=True)
    jobs: Any = SimpleNamespace(running={"simulation-1": running})
    store: Any = SimpleNamespace(leases=leases, run=run)
    asyncio.run(Member(store, jobs)._beat())
    assert beaten == ["simulation-1"]
    assert not running.lost  # though the lease is: it is too late to end it
