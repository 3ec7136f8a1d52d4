"""Worker processes for the tests of them."""

import asyncio
import contextlib
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import Any

from twolink.parts.service.work.sharing import NO_LIMIT, Budget
from twolink.parts.service.work.worker_pool import Workers
from twolink.parts.service.work.worker_process import WorkerMemory


def noted(note: Callable[[Any], None]) -> Callable[[Any], Awaitable[dict[str, Any]]]:
    """The answer to reports of a task, which goes on at once."""

    async def answer(value: Any) -> dict[str, Any]:
        note(value)
        return {}

    return answer


@contextlib.asynccontextmanager
async def working(
    count: int = 1, megabytes: float = 1000, tasks: str = "tests.parts.service.bad_tasks", **more: Any
) -> AsyncIterator[Workers]:
    """Workers of some tasks, whose memory is watched. None is left at the end."""
    memory = WorkerMemory(megabytes)
    workers = Workers(count, memory, Budget(None, NO_LIMIT), tasks=tasks, **more)
    watch = asyncio.create_task(memory.watch())
    try:
        yield workers
    finally:
        watch.cancel()
        await workers.close()
        assert not memory.workers
