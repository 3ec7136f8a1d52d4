"""A worker process: does one task after another for the service, under limits, and may die without harm.

Messages are msgpack with their length before them (8 bytes): in on stdin, {task, arguments}; out on stdout,
{"progress": ...} any number of times, then {"done": ...} or {"failed": problem}.
"""

from __future__ import annotations

import importlib
import os
import sys
import threading
import time
import traceback
from collections.abc import Callable
from typing import Any, BinaryIO

import msgspec
import numpy as np

from twolink.service.problems import Refusal, problem_of

LENGTH = 8
Tell = Callable[[Any], None]


def pack(message: Any) -> bytes:
    """A message as it goes over the pipe; NumPy's scalars become numbers."""
    content = msgspec.msgpack.encode(message, enc_hook=np.generic.item)
    return len(content).to_bytes(LENGTH, "big") + content


def limit(megabytes: float) -> None:
    """Bound what this process may take: its address space, and no core dumps."""
    try:
        import resource
    except ImportError:  # Windows has no such limits
        return
    most = int(megabytes * 2**20)
    for what, value in ((resource.RLIMIT_AS, most), (resource.RLIMIT_CORE, 0)):
        _, hard = resource.getrlimit(what)
        bound = value if hard == resource.RLIM_INFINITY else min(value, hard)
        try:
            resource.setrlimit(what, (bound, hard))
        except (ValueError, OSError):  # macOS refuses RLIMIT_AS
            continue


def main(tasks: str, megabytes: float) -> None:
    """Answer until stdin ends. tasks: the module whose functions are the tasks."""
    limit(megabytes)
    _end_with_the_service()
    inward = sys.stdin.buffer
    outward = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what libraries print must not come between the messages
    known = importlib.import_module(tasks).TASKS

    def send(answer: dict[str, Any]) -> None:
        outward.write(pack(answer))
        outward.flush()

    def tell(value: Any) -> None:
        send({"progress": value})

    while (message := _receive(inward)) is not None:
        send(_answer(known, message, tell))


def _receive(inward: BinaryIO) -> dict[str, Any] | None:
    head = inward.read(LENGTH)
    if len(head) < LENGTH:
        return None
    found: dict[str, Any] = msgspec.msgpack.decode(inward.read(int.from_bytes(head, "big")))
    return found


def _answer(known: dict[str, Callable[..., Any]], message: dict[str, Any], tell: Tell) -> dict[str, Any]:
    try:
        return {"done": known[message["task"]](tell=tell, **message["arguments"])}
    except MemoryError:
        what = "it takes more memory than a worker process may have"
        return {"failed": problem_of(Refusal(422, what, code="too-large", remedy="send something smaller"))}
    except Exception as error:
        problem = problem_of(error)
        return {"failed": problem, "traceback": traceback.format_exc() if problem.status >= 500 else ""}


def _end_with_the_service() -> None:
    """A service that was killed cannot end its workers: they look for themselves."""
    parent = os.getppid()

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.5)
        os._exit(1)

    threading.Thread(target=watch, name="twolink-watch", daemon=True).start()


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]))
