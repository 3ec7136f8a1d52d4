"""A worker process: runs one task after another for the service, under limits, and may die without harm to it.

A task is a function with annotated keyword arguments: they are converted to these types. An argument `report` is a
function that sends the progress, and returns when the task may go on; `ask` is the same, and returns the arguments of
the service's answer; `exchange` is a file that the service has open too, for what is too large for a message: it holds
what the task is to read, and then what the task has written.

Messages are msgpack with their length before them (8 bytes): `Call` on stdin; on stdout any number of `Progress`, each
answered by a `Call` of no task, then `Done` or `Failed`. The first `Done` is of no call: it says that the process is
ready.
"""

import contextlib
import ctypes
import importlib
import os
import re
import signal
import sys
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, get_type_hints

import msgspec
import numpy as np

from twolink.parts.service.problems import Problem, Refusal, problem_of
from twolink.parts.service.work.sandbox import restrict

LENGTH = 8
_NEAR = 0.95  # of the limit: large pieces of memory are refused before it is reached
_PR_SET_PDEATHSIG = 1
Report = Callable[[Any], None]  # how a task reports its progress
Ask = Callable[[Any], dict[str, Any]]


class Call(msgspec.Struct):
    """A task by its name in TASKS, with its arguments."""

    task: str
    arguments: dict[str, Any]


class Progress(msgspec.Struct, tag=True):
    """The progress of a task."""

    value: Any


class Done(msgspec.Struct, tag=True):
    """The result that a task returned."""

    result: Any


class Failed(msgspec.Struct, tag=True):
    """The failure that a task raised. traceback: for the log, of unexpected failures only."""

    problem: Problem
    traceback: str = ""


_WHAT = "it takes more memory than a worker process may have"
_TOO_LARGE = Failed(problem_of(Refusal(422, _WHAT, code="too-large", remedy="send something smaller")))


def packed(message: Call | Progress | Done | Failed) -> bytes:
    """A message as it goes over the pipe. NumPy's scalars become numbers."""
    content = msgspec.msgpack.encode(message, enc_hook=np.generic.item)
    return len(content).to_bytes(LENGTH, "big") + content


def limit_memory(megabytes: float) -> None:
    """Limit this process' address space, and turn core dumps off."""
    try:
        import resource
    except ImportError:  # Windows has no such limits
        return
    for what, value in ((resource.RLIMIT_AS, int(megabytes * 2**20)), (resource.RLIMIT_CORE, 0)):
        _, hard = resource.getrlimit(what)
        bound = value if hard == resource.RLIM_INFINITY else min(value, hard)
        with contextlib.suppress(ValueError, OSError):  # macOS refuses RLIMIT_AS
            resource.setrlimit(what, (bound, hard))


def main(tasks: str, megabytes: float, file: int | str, writable: Sequence[Path]) -> None:
    """Run tasks until stdin ends.

    tasks: the module whose TASKS are the functions by name, and whose NETWORK says whether they may use the network.
    file: for the exchange. writable: see `restrict`.
    """
    limit_memory(megabytes)
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)  # a killed service cannot end its workers
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what libraries print must not come between the messages
    table = importlib.import_module(tasks)
    functions = table.TASKS
    restrict(writable, network=getattr(table, "NETWORK", False))  # before anything from outside is looked at

    def send(message: Progress | Done | Failed) -> None:
        answers.write(packed(message))
        answers.flush()

    def heard() -> Call | None:
        head = sys.stdin.buffer.read(LENGTH)
        if len(head) < LENGTH:
            return None
        return msgspec.msgpack.decode(sys.stdin.buffer.read(int.from_bytes(head, "big")), type=Call)

    def ask(value: Any) -> dict[str, Any]:
        send(Progress(value))
        said = heard()
        return sys.exit() if said is None else said.arguments

    send(Done(None))
    while (call := heard()) is not None:
        with open(file, "r+b", closefd=isinstance(file, str)) as exchange:
            exchange.seek(0)  # the service has moved it
            tools = {"report": ask, "ask": ask, "exchange": exchange}
            answer = _answer(functions[call.task], call.arguments, tools)
        if isinstance(answer, Failed) and answer.problem.status >= 500 and _has_filled(megabytes):
            answer = _TOO_LARGE
        send(answer)


def _answer(function: Callable[..., Any], arguments: dict[str, Any], tools: dict[str, Any]) -> Done | Failed:
    try:
        kinds = get_type_hints(function)
        given = {name: value for name, value in tools.items() if name in kinds}
        converted = {name: msgspec.convert(value, kinds[name]) for name, value in arguments.items() if name in kinds}
        return Done(function(**converted, **given))
    except MemoryError:
        return _TOO_LARGE
    except Exception as error:
        problem = problem_of(error)
        expected = problem.status < 500 or (isinstance(error, Refusal) and error.__cause__ is None)
        return Failed(problem, "" if expected else traceback.format_exc())


def _has_filled(megabytes: float) -> bool:
    """True if this process came near its limit: LLVM then fails with any error ("Could not find the symbol ...")."""
    try:
        peak = re.search(rb"VmPeak:\s+(\d+) kB", Path("/proc/self/status").read_bytes())
    except OSError:  # not Linux: no limit either
        return False
    return peak is not None and int(peak[1]) > _NEAR * megabytes * 1024


if __name__ == "__main__":
    _file = int(sys.argv[3]) if sys.argv[3].isdecimal() else sys.argv[3]
    main(sys.argv[1], float(sys.argv[2]), _file, [Path(folder) for folder in sys.argv[4:]])
