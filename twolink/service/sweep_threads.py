"""Threads that compute the tasks of a sweep, and know which of them ended the worker processes before this one."""

import hashlib
import threading
from collections import Counter
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from twolink.dynamics.threads import thread_count
from twolink.io.atomic import write_atomic
from twolink.service.problems import Refusal

NO_TASK = "no-task-under-way"


class _Record(msgspec.Struct):
    """Digests of the tasks under way, and how many processes died while each was."""

    under_way: list[str] = []
    deaths: dict[str, int] = {}


class WorkerDied(Exception):
    """A process died while it computed this task."""


class SweepThreads(ThreadPoolExecutor):
    """An executor for `tl.sweep` in a process that may die.

    A task during which processes died fails as often at once. So `tl.sweep` takes up its search where it was: it
    tries the task alone, then its halves, and gives up a run after three deaths.

    folder: of the record. died: the process before this one died. Raises Refusal, code NO_TASK, if that computed none.
    """

    def __init__(self, folder: Path, *, died: bool) -> None:
        super().__init__(thread_count())
        self._file, self._lock = folder / "deaths.json", threading.Lock()
        record = msgspec.json.decode(self._file.read_bytes(), type=_Record) if self._file.exists() else _Record()
        if died and not record.under_way:
            raise Refusal(422, "the worker process died between the runs", code=NO_TASK, remedy="try again")
        self._deaths = Counter(record.deaths)
        if died:
            self._deaths.update(record.under_way)
        self._failures = Counter(self._deaths)  # to come
        self._under_way = list[str]()
        self._write()

    def submit(self, function: Callable[[Any], Any], task: Any) -> "Future[Any]":  # type: ignore[override]
        """Compute a task, or fail where processes died of it."""
        key = _digest(task)
        if self._failures[key] > 0:
            self._failures[key] -= 1
            failed = Future[Any]()
            failed.set_exception(WorkerDied("a worker process died of it"))
            return failed
        return super().submit(self._noted, key, function, task)

    def _noted(self, key: str, function: Callable[[Any], Any], task: Any) -> Any:
        with self._lock:
            self._under_way.append(key)
            self._write()
        try:
            return function(task)
        finally:
            with self._lock:
                self._under_way.remove(key)
                self._write()

    def _write(self) -> None:
        content = msgspec.json.encode(_Record(self._under_way, self._deaths))
        write_atomic(self._file, lambda file: file.write(content))


def _digest(task: Any) -> str:
    """The same for the same runs, in each process."""
    values = {name: numbers.tolist() for name, numbers in task.values.items()}
    content = msgspec.json.encode([task.request, values], enc_hook=np.generic.item)
    return hashlib.sha256(content).hexdigest()[:20]
