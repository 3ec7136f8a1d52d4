"""Worker processes as the service sees them: started when needed, used again, killed when they take too long.

Compared with libraries: concurrent.futures of Python 3.11 (by its documentation) and loky 3.7 (by running it) cannot
end a running task. pebble 5.2 (by running it) kills, limits and replaces processes as this module does, and answers
as quickly (0.18 ms a round trip, 0.16 ms here). It lacks progress reports from a running task; it unpickles results,
so that a worker which a hostile mesh has taken over would run its code in the service (here messages are plain data);
and its processes inherit the service's environment, which cannot be changed before their interpreter starts.
"""

import asyncio
import contextlib
import functools
import logging
import os
import sys
from collections.abc import Awaitable, Callable, Sequence
from pathlib import Path
from typing import Any

import msgspec

from twolink.io import cache
from twolink.parts.service.problems import Refusal, error_from
from twolink.parts.service.work.sharing import Budget, Turns, this_request
from twolink.parts.service.work.worker import LENGTH, Call, Done, Failed, Progress, packed
from twolink.parts.service.work.worker_process import Exchange, Worker, WorkerMemory, start

_log = logging.getLogger("twolink.service")
_ADDRESSES = 4800  # MB of address space that are not memory: libraries, stacks, what is reserved
_LARGEST_MESSAGE = 2**30
_START = 60.0  # seconds for a process to begin: half a second on a machine that has nothing else to do
_LAST_WORDS = 5.0  # seconds for a process whose pipe has closed to end by itself
# What workers get of the service's environment, which may hold secrets, such as the service's own tokens.
_ENVIRONMENT = (
    "HOME", "USERPROFILE", "PATH", "LANG", "LC_ALL", "LC_CTYPE", "TZ", "PYTHONPATH", "PYTHONHOME", "LD_LIBRARY_PATH",
    "DYLD_LIBRARY_PATH", "SYSTEMROOT", "TWOLINK_CACHE_MB", "TWOLINK_NATIVE",
)  # fmt: skip
Reply = Callable[[Any], Awaitable[dict[str, Any]]]  # to what a task asks
_decode: Callable[[bytes], Progress | Done | Failed] = msgspec.msgpack.Decoder(Progress | Done | Failed).decode


class Workers:
    """At most `count` worker processes.

    memory: the limit that they share with other pools. budget: of owners, to whom the time of their tasks is charged.
    threads: of each. niceness: how far they let the service, and other programs, run first. waiting: tasks that may
    wait, see `Turns`. tasks: the module whose TASKS they run. writable: the folders that they may write, besides that
    of their kernels. on_death: called for each process that dies during a task. idle: what a second counts, of the time
    that a task may take, in which the process gets no processor; 1: time is that of the wall. spare: one process more
    is started when the last one begins a task.
    """

    def __init__(
        self, count: int, memory: WorkerMemory, budget: Budget, *, threads: int = 1, niceness: int = 10,
        waiting: int = 1000, tasks: str = "twolink.parts.service.work.task_table", writable: Sequence[Path] = (),
        on_death: Callable[[], None] = lambda: None, idle: float = 0.02, spare: bool = False,
    ) -> None:  # fmt: skip
        addresses = str(memory.megabytes + _ADDRESSES)
        kernels = cache.location("workers")  # not the service's: who writes kernels decides what their readers run
        if kernels:
            with contextlib.suppress(OSError):  # a read-only home: every process compiles for itself
                Path(kernels).mkdir(mode=0o700, parents=True, exist_ok=True)
        folders = [*([kernels] if kernels else []), *map(str, writable)]
        self._command = (sys.executable, "-m", "twolink.parts.service.work.worker", tasks, addresses)
        self._folders, self._niceness = folders, niceness
        self._environment = {
            **{name: os.environ[name] for name in _ENVIRONMENT if name in os.environ},
            **(dict.fromkeys(("MPLCONFIGDIR", "TMPDIR"), folders[0]) if folders else {}),
            "TWOLINK_CACHE": kernels or "off",
            "TWOLINK_THREADS": str(threads),
            "OPENBLAS_NUM_THREADS": "1",
            "MUJOCO_GL": "disable",  # to look for windows it would start a process
            "OMP_WAIT_POLICY": "PASSIVE",  # threads that spin take 100 states from 0.4 to 12 ms where cores are busy
        }
        self._budget = budget
        self._on_death, self._idle_counts, self._spare = on_death, idle, spare
        self._count, self._background = count, set[asyncio.Task[None]]()
        self._turns = Turns(count, waiting)
        self._memory = memory
        self._idle: list[Worker] = []
        self._workers: set[Worker] = set()  # all that live

    async def warm(self) -> None:
        """Start one process, so that the next task does not wait for it."""
        if all(each.task for each in self._idle):
            with contextlib.suppress(Refusal):  # it is tried again with the next task
                worker = await self._start()
                worker.is_busy = False
                self._idle.append(worker)

    async def run(self, task: str, seconds: float, *, on_question: Reply | None = None, **arguments: Any) -> Any:
        """Run a task in a worker process, in at most `seconds` of processor time. Cancelling kills the process.

        Raises the task's failure; Refusal when the process is lost: 422 with code "worker-died", "too-slow" or
        "too-large", 503 where it had to make room for others, where too many tasks wait, or where no process begins.
        """
        return (await self.exchange(task, seconds, None, on_question=on_question, **arguments))[0]

    async def exchange(
        self, task: str, seconds: float, content: bytes | None, *, on_question: Reply | None = None, **arguments: Any
    ) -> tuple[Any, bytes]:
        """Run a task that finds `content` in its exchange file: its result, and what it has written there.

        on_question: what a task is told that asks or reports; it goes on then.
        """
        written, owner, budget = b"", this_request().owner, self._budget
        left = await budget.require(owner)
        async with self._turns.turn():
            worker = await self._take(task)
            try:
                charge = functools.partial(budget.charge, owner)
                async with worker.limited(min(seconds, left), self._idle_counts, charge):
                    if content is not None:
                        await worker.exchange.put(content)
                    answer = await _converse(worker, Call(task, arguments), on_question)
            except TimeoutError:
                await self._kill(worker)
                if left < seconds:
                    await budget.require(owner)
                remedy = "ask for less, or start the service with a larger quota"
                what = f"it takes more than {seconds:g} s of computing"
                raise Refusal(422, what, code="too-slow", remedy=remedy) from None
            except (asyncio.IncompleteReadError, OSError):
                with contextlib.suppress(TimeoutError):  # its exit code tells the reason
                    await asyncio.wait_for(worker.process.wait(), _LAST_WORDS)
                await self._kill(worker)
                if worker.ended_at:
                    raise self._memory.refusal(worker) from None
                self._on_death()
                raise _death(worker.process.returncode or 0) from None
            except BaseException:
                await self._kill(worker)
                raise
            try:
                if content is not None and isinstance(answer, Done):
                    written = await worker.exchange.take()
            finally:
                self._idle.append(worker)
                self._memory.released(worker)
        if isinstance(answer, Done):
            return answer.result, written
        if answer.traceback:
            _log.error("unexpected failure in a worker\n%s", answer.traceback)
        raise error_from(answer.problem)

    async def _take(self, task: str) -> Worker:
        """An idle worker that lives, at best one that did the same before or else nothing; or a new one.

        Where there is always a spare, what others have loaded and compiled is left to them.
        """
        ended = [each for each in self._idle if each.ended_at]
        self._idle[:] = [each for each in self._idle if not each.ended_at]  # before others may look, at an await
        for each in ended:
            await self._kill(each)

        def fits(each: Worker) -> bool:
            return each.task in (task, "") or not self._spare or len(self._workers) >= self._count

        while idle := [*filter(fits, reversed(self._idle))]:
            worker = max(idle, key=lambda each: (each.task == task, not each.task))
            self._idle.remove(worker)
            if worker.process.returncode is None and not worker.ended_at:
                worker.is_busy = True
                break
            await self._kill(worker)
        else:
            worker = await self._start()
        worker.task = task
        if self._spare and not self._background and len(self._workers) < self._count:
            starting = asyncio.create_task(self.warm())
            self._background.add(starting)
            starting.add_done_callback(self._background.discard)
        return worker

    async def _start(self) -> Worker:
        """Start a process, and wait until it is ready: its first task has the time that it is given for itself."""
        exchange = Exchange()
        try:
            command = (*self._command, exchange.name, *self._folders)
            process = await start(command, self._environment, exchange.inherited, self._niceness)
        except BaseException:
            exchange.close()
            raise
        worker = Worker(process, exchange)
        self._workers.add(worker)
        self._memory.workers.add(worker)
        try:
            async with asyncio.timeout(_START):
                await _converse(worker)
        except (TimeoutError, asyncio.IncompleteReadError, OSError):
            await self._kill(worker)
            what = f"no worker process was ready within {_START:g} s, or it ended (code {worker.process.returncode})"
            remedy = "ask again in some seconds; the machine may have too little memory or too much to do"
            raise Refusal(503, what, code="busy", where="request", remedy=remedy, retry_after=5) from None
        except BaseException:
            await self._kill(worker)
            raise
        return worker

    async def _kill(self, worker: Worker) -> None:
        worker.kill()
        try:
            await worker.process.wait()
        finally:
            if worker in self._workers:  # this may run twice at once
                self._workers.discard(worker)
                self._memory.workers.discard(worker)
                worker.exchange.close()

    async def close(self) -> None:
        """End all processes."""
        for starting in tuple(self._background):
            starting.cancel()
        await asyncio.gather(*self._background, return_exceptions=True)
        self._idle.clear()
        for worker in list(self._workers):
            await self._kill(worker)


async def _converse(worker: Worker, call: Call | None = None, on_question: Reply | None = None) -> Done | Failed:
    """Send a call, and wait for its end; without a call, for that of the start.

    Raises IncompleteReadError or OSError when the process dies.
    """
    answers: Any = worker.process.stdout
    calls: Any = worker.process.stdin
    while True:
        if call is not None:
            calls.write(packed(call))
            await calls.drain()
        length = int.from_bytes(await answers.readexactly(LENGTH), "big")
        if length > _LARGEST_MESSAGE:
            raise ConnectionError
        message = _decode(await answers.readexactly(length))
        if not isinstance(message, Progress):
            return message
        call = Call("", {} if on_question is None else await on_question(message.value))


def _death(code: int) -> Refusal:
    """A worker died. Signal 11 is a segmentation fault, 9 most often a lack of memory."""
    what = f"the worker process died of it (signal {-code})" if code < 0 else "the worker process died of it"
    remedy = "the service goes on; simplify what was sent, or try again"
    return Refusal(422, what, code="worker-died", remedy=remedy)
