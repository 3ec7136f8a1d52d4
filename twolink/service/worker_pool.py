"""Worker processes from the service's side: started when needed, used again, killed when they take too long."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import sys
from collections.abc import AsyncIterator, Callable
from typing import Any

import msgspec

from twolink.errors import TwolinkError
from twolink.service.problems import Problem, Refusal, error_from
from twolink.service.worker import LENGTH, pack

_log = logging.getLogger("twolink.service")
_MOST_TASKS = 100  # caches grow: a worker is replaced after so many
_LARGEST_MESSAGE = 2**30
_LAST_WORDS = 5.0  # seconds for a process whose pipe has closed to end


class Worker:
    """One worker process."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self._process = process
        self._tasks = 0

    @classmethod
    async def start(cls, tasks: str, megabytes: float, threads: int) -> Worker:
        """Start a process. It needs about half a second until it takes its first task."""
        environment = {**os.environ, "TWOLINK_THREADS": str(threads), "OPENBLAS_NUM_THREADS": "1"}
        process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "twolink.service.worker", tasks, str(megabytes), env=environment,
            stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C is for the service, which then ends its workers
        )  # fmt: skip
        return cls(process)

    @property
    def usable(self) -> bool:
        """Whether it may be given another task."""
        return self._process.returncode is None and self._tasks < _MOST_TASKS

    async def call(self, task: str, arguments: dict[str, Any], on_progress: Callable[[Any], None] | None) -> Any:
        """Do a task. Raises its failure; Refusal (422, "worker-died") when the process dies."""
        self._tasks += 1
        try:
            if self._process.stdin is None or self._process.stdout is None:
                raise ConnectionError
            self._process.stdin.write(pack({"task": task, "arguments": arguments}))
            await self._process.stdin.drain()
            while True:
                message = await self._read(self._process.stdout)
                if "progress" not in message:
                    return self._result(message)
                if on_progress is not None:
                    on_progress(message["progress"])
        except (asyncio.IncompleteReadError, ConnectionError, OSError):
            # It has ended, or is about to: killing it now would take the reason away.
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._process.wait(), _LAST_WORDS)
            await self.kill()
            raise _death(self._process.returncode or 0) from None

    async def _read(self, stream: asyncio.StreamReader) -> dict[str, Any]:
        length = int.from_bytes(await stream.readexactly(LENGTH), "big")
        if length > _LARGEST_MESSAGE:
            raise ConnectionError
        found: dict[str, Any] = msgspec.msgpack.decode(await stream.readexactly(length))
        return found

    def _result(self, message: dict[str, Any]) -> Any:
        if "failed" not in message:
            return message["done"]
        if message.get("traceback"):
            _log.error("unexpected failure in a worker\n%s", message["traceback"])
        raise error_from(msgspec.convert(message["failed"], Problem))

    async def kill(self) -> None:
        """End the process, whatever it does."""
        if self._process.returncode is None:
            with contextlib.suppress(ProcessLookupError):
                self._process.kill()
        await self._process.wait()


class Workers:
    """At most `most` worker processes. on_death: called for each that dies of its task."""

    def __init__(
        self,
        most: int,
        megabytes: float,
        *,
        threads: int = 1,
        tasks: str = "twolink.service.task_table",
        on_death: Callable[[], None] = lambda: None,
    ) -> None:
        self._most, self._megabytes, self._threads, self._tasks = most, megabytes, threads, tasks
        self._on_death = on_death
        self._free = asyncio.Semaphore(most)
        self._idle: list[Worker] = []
        self._busy: set[Worker] = set()

    async def warm(self) -> None:
        """Start one, so that the first task does not wait for it."""
        if not self._idle:
            self._idle.append(await self._start())

    async def run(
        self, task: str, seconds: float, *, on_progress: Callable[[Any], None] | None = None, **arguments: Any
    ) -> Any:
        """Do a task in a worker process, in at most `seconds` from when it begins.

        Raises the task's failure; Refusal (422) when the process died or was too slow. Cancelling ends the task.
        """
        async with self._worker() as worker:
            try:
                async with asyncio.timeout(seconds):
                    return await worker.call(task, arguments, on_progress)
            except TimeoutError:
                raise _too_slow(seconds) from None

    @contextlib.asynccontextmanager
    async def _worker(self) -> AsyncIterator[Worker]:
        async with self._free:
            worker = self._idle.pop() if self._idle else await self._start()
            if not worker.usable:
                await worker.kill()
                worker = await self._start()
            self._busy.add(worker)
            well = False
            try:
                yield worker
                well = True
            except TwolinkError as error:
                well = worker.usable and error.code != "too-slow"
                if not worker.usable:
                    self._on_death()
                raise
            finally:
                self._busy.discard(worker)
                if well and worker.usable:
                    self._idle.append(worker)
                else:
                    await worker.kill()

    async def _start(self) -> Worker:
        return await Worker.start(self._tasks, self._megabytes, self._threads)

    async def close(self) -> None:
        """End all processes."""
        for worker in [*self._idle, *self._busy]:
            await worker.kill()
        self._idle.clear()


def _death(code: int) -> Refusal:
    """A worker that died. Signal 11 is a segmentation fault, 9 most often a lack of memory."""
    what = f"the worker process died of it (signal {-code})" if code < 0 else "the worker process died of it"
    remedy = "the service goes on; simplify what was sent, or try again"
    return Refusal(422, what, code="worker-died", remedy=remedy)


def _too_slow(seconds: float) -> Refusal:
    remedy = "ask for less, or start the service with a larger quota"
    return Refusal(422, f"it takes more than {seconds:g} s of computing", code="too-slow", remedy=remedy)
