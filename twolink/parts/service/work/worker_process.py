"""Worker processes one by one: how they are started, the file through which bodies come and go, and their memory.

A thread starts them, because the thread that starts a process waits for it: uvloop forks in the event loop, which takes
30 ms in a service of 400 MB, and more where processors are busy. The file is in memory: pipes take three times as long
for large bodies.

The memory of all of them together stays below a limit: workers are replaced by what they have taken. What a task leaves
behind (caches, compiled code) makes the next one quicker, so that a process is kept while there is room. LLVM and mesh
readers do not survive a lack of memory: they end the process, or fail with any error.
"""

import asyncio
import contextlib
import mmap
import os
import socket
import subprocess
import sys
import tempfile
import time
from asyncio.subprocess import DEVNULL, PIPE, Process
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from twolink.parts.service.problems import Refusal
from twolink.parts.service.work.sharing import this_request

_SLICE = 2**19  # bytes copied at once: the event loop waits for a millisecond, for several where cores are busy
_KEPT = 2**24  # bytes of the file that stay allocated from task to task
_ATTEMPTS = 5
# One thread that never ends: Linux ends workers (PR_SET_PDEATHSIG) with the thread that started them.
_starter = ThreadPoolExecutor(1, "twolink-starter")
_LOOK = 0.1  # seconds between looks: a process may fill some 100 MB in that time


class Exchange:
    """A channel for the content of a request to a worker, and for its answer.

    name: what the worker opens: a file descriptor, or a path. inherited: descriptors that the worker inherits.
    """

    def __init__(self) -> None:
        self.inherited: tuple[int, ...] = ()
        if hasattr(os, "memfd_create"):
            self._file = os.memfd_create("twolink")
            self.name, self.inherited = str(self._file), (self._file,)
        else:  # not Linux
            self._file, self.name = tempfile.mkstemp()

    async def put(self, content: bytes) -> None:
        """Make this the content of the file."""
        os.ftruncate(self._file, len(content))
        os.lseek(self._file, 0, os.SEEK_SET)
        view = memoryview(content)
        while view:
            view = view[os.write(self._file, view[:_SLICE]) :]
            await asyncio.sleep(0)

    async def take(self) -> bytes:
        """The content of the file. Raises Refusal when there is no room for it."""
        size, parts = os.fstat(self._file).st_size, []
        this_request().add(2 * size)  # in pieces and whole
        os.lseek(self._file, 0, os.SEEK_SET)
        while part := os.read(self._file, _SLICE):
            parts.append(part)
            await asyncio.sleep(0)
        if size > _KEPT:
            os.ftruncate(self._file, 0)
        return parts[0] if len(parts) == 1 else await asyncio.to_thread(b"".join, parts)

    def close(self) -> None:
        """Give the memory back."""
        os.close(self._file)
        if not self.inherited:
            with contextlib.suppress(OSError):
                os.unlink(self.name)


class WorkerProcess:
    """A process as the service uses asyncio's Process, for one whose stdin and stdout are a socket."""

    def __init__(self, process: "subprocess.Popen[bytes]", socket_streams: tuple[Any, Any]) -> None:
        self._process, self.pid, self.kill = process, process.pid, process.kill
        self.stdout, self.stdin = socket_streams

    @property
    def returncode(self) -> int | None:
        """None while it runs; negative: the signal that ended it."""
        return self._process.poll()

    async def wait(self) -> None:
        """Wait until it has ended."""
        await asyncio.to_thread(self._process.wait)
        self.stdin.close()


async def start(
    command: Sequence[str], environment: Mapping[str, str], inherited: Sequence[int], niceness: int
) -> WorkerProcess | Process:
    """Start a process. inherited: file descriptors that it gets as well. niceness: added to that of the service."""
    if sys.platform == "win32":  # no pairs of sockets
        return await asyncio.create_subprocess_exec(*command, stdin=PIPE, stdout=PIPE, stderr=DEVNULL, env=environment)
    mine, its = socket.socketpair()

    def spawn() -> "subprocess.Popen[bytes]":
        with its:
            process = subprocess.Popen(
                command,
                env=environment,
                stdin=its.fileno(),
                stdout=its.fileno(),
                stderr=subprocess.DEVNULL,
                pass_fds=inherited,
                start_new_session=True,  # Ctrl-C is for the service, which then ends its workers
            )
        if niceness:
            _yield_to_service(process.pid, niceness)
        return process

    spawning = asyncio.get_running_loop().run_in_executor(_starter, spawn)
    try:
        return WorkerProcess(await asyncio.shield(spawning), await asyncio.open_unix_connection(sock=mine))
    except BaseException:  # this may have been cancelled
        mine.close()
        process = await spawning
        process.kill()
        await asyncio.to_thread(process.wait)
        raise


def _yield_to_service(pid: int, niceness: int) -> None:
    """Let the process that answers requests run before this one, where processors are few."""
    os.setpriority(os.PRIO_PROCESS, pid, os.nice(0) + niceness)
    for _ in range(_ATTEMPTS):  # Linux shares processors between sessions first, whatever their processes' niceness
        try:
            Path(f"/proc/{pid}/autogroup").write_text(str(niceness))
            return
        except BlockingIOError:  # it takes one change in 0.1 s
            time.sleep(0.1)
        except OSError:
            return


@dataclass(eq=False)
class Worker:
    """A worker process. is_busy: a task runs in it. ended_at: the bytes it had when it was ended for its memory.

    task: what it has done last.
    """

    process: WorkerProcess | Process
    exchange: Exchange
    is_busy: bool = True
    ended_at: int = 0
    task: str = ""

    def memory(self) -> int:
        """Bytes that only this process has, which is what its end frees; 0 where the system does not say (no Linux)."""
        try:
            _, resident, shared = Path(f"/proc/{self.process.pid}/statm").read_bytes().split()[:3]
        except OSError:
            return 0
        return (int(resident) - int(shared)) * mmap.PAGESIZE

    def seconds(self) -> float:
        """Processor time that all threads of this process have had; where the system does not say it, time."""
        try:
            fields = Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()
        except OSError:
            return time.monotonic()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    @contextlib.asynccontextmanager
    async def limited(self, seconds: float, idle: float, charge: Callable[[float], None]) -> AsyncIterator[None]:
        """Raise TimeoutError in a task that takes more processor time; a second without processor counts `idle`.

        charge: told at last how much it took.
        """
        loop = asyncio.get_running_loop()
        begin, since, timer = self.seconds(), loop.time(), None

        def look() -> None:
            nonlocal timer
            left = seconds - max(self.seconds() - begin, idle * (loop.time() - since))
            if left > 0:
                timer = loop.call_later(max(_LOOK, left / (os.cpu_count() or 1)), look)
            else:
                limit.reschedule(loop.time())

        async with asyncio.timeout(None) as limit:
            look()
            try:
                yield
            finally:
                if timer is not None:
                    timer.cancel()
                taken, most = self.seconds() - begin, (loop.time() - since) * (os.cpu_count() or 1)
                charge(min(max(0.0, taken), most))  # of a process that has died nothing is known but this

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

    def has_room(self) -> bool:
        """True if there is memory for what the next tasks take."""
        return sum(worker.memory() for worker in self.workers) < self._limit / 2

    def look(self) -> None:
        """End idle workers while all have more than half of the limit, busy ones while all have more than the limit.

        The largest goes first. Half is left for what the next tasks take. To ask for its exit code takes a process that
        was ended off the system's list.
        """
        self.workers -= {each for each in self.workers if each.ended_at and each.process.returncode is not None}
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
