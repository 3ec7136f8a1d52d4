"""Starting worker processes: by a thread, because the thread that starts a process waits for it.

uvloop forks in the event loop, which takes 30 ms in a service of 400 MB, and more where processors are busy.
"""

import asyncio
import os
import socket
import subprocess
import sys
import time
from asyncio.subprocess import DEVNULL, PIPE, Process
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

_ATTEMPTS = 5

# One thread that never ends: Linux ends workers (PR_SET_PDEATHSIG) with the thread that started them.
_starter = ThreadPoolExecutor(1, "twolink-starter")


class WorkerProcess:
    """What the service uses of asyncio's Process, for one whose stdin and stdout are a socket."""

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
