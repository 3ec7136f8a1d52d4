"""The memory of all worker processes together stays below a limit: workers are replaced by what they have taken.

What a task leaves behind (caches, compiled code) makes the next one quicker, so that a process is kept while there is
room. LLVM and mesh readers do not survive a lack of memory: they end the process, or fail with any error.
"""

import asyncio
import contextlib
import mmap
from asyncio.subprocess import Process
from dataclasses import dataclass
from pathlib import Path

from twolink.service.exchange import Exchange
from twolink.service.problems import Refusal
from twolink.service.worker_process import WorkerProcess

_LOOK = 0.1  # seconds between looks: a process may fill some 100 MB in that time


@dataclass(eq=False)
class Worker:
    """A worker process. is_busy: a task runs in it. ended_at: the bytes it had when it was ended for its memory."""

    process: WorkerProcess | Process
    exchange: Exchange
    is_busy: bool = True
    ended_at: int = 0

    def memory(self) -> int:
        """Bytes that only this process has, which is what its end frees; 0 where the system does not say (no Linux)."""
        try:
            _, resident, shared = Path(f"/proc/{self.process.pid}/statm").read_bytes().split()[:3]
        except OSError:
            return 0
        return (int(resident) - int(shared)) * mmap.PAGESIZE

    def kill(self) -> None:
        """End the process at once."""
        with contextlib.suppress(ProcessLookupError):
            self.process.kill()


class WorkerMemory:
    """The worker processes of all pools, and the memory that they may have together [MB]."""

    def __init__(self, megabytes: float) -> None:
        self.megabytes, self._limit = megabytes, megabytes * 2**20
        self.workers: set[Worker] = set()

    async def watch(self) -> None:
        """Look after the workers until cancelled."""
        while True:
            await asyncio.sleep(_LOOK)
            self.look()

    def released(self, worker: Worker) -> None:
        """Note that a task has ended. What has grown much is looked at before the next task."""
        worker.is_busy = False
        if worker.memory() > self._limit / 8:
            self.look()

    def look(self) -> None:
        """End idle workers while all have more than half of the limit, busy ones while all have more than the limit.

        The largest goes first. Half is left for what the next tasks take.
        """
        sizes = {worker: worker.memory() for worker in self.workers if not worker.ended_at}
        total = sum(sizes.values())
        for worker in sorted(sizes, key=lambda worker: (worker.is_busy, -sizes[worker])):
            if total <= (self._limit if worker.is_busy else self._limit / 2):
                return
            worker.ended_at = sizes[worker]
            worker.kill()
            total -= sizes[worker]

    def refusal(self, worker: Worker) -> Refusal:
        """Why the task of a worker has ended that was killed for its memory: it is too large, or others are there."""
        if worker.ended_at > self._limit / 2:
            what = (
                f"it takes more than {worker.ended_at >> 20} MB of memory, all workers may have {self.megabytes:g} MB"
            )
            return Refusal(422, what, code="too-large", remedy="send something smaller, or raise memory_mb")
        what = "other requests take the memory there is"
        return Refusal(503, what, code="busy", where="request", remedy="ask again in some seconds", retry_after=5)
