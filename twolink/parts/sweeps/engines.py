"""Engines that compute blocks: local processes, a Dask cluster, or any executor of the concurrent.futures interface."""

import multiprocessing
import os
import signal
import sys
import threading
import time
import types
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.context import SpawnContext, SpawnProcess
from typing import Any

from twolink.dynamics.arguments import whole
from twolink.dynamics.threads import thread_count
from twolink.errors import SceneError, TwolinkError, import_extra
from twolink.parts.sweeps.runs import Columns, SweepTask, compute

AT_ONCE = 64  # blocks given to an executor that does not say how many it takes
GONE_AFTER = 30.0  # s: without a scheduler
LOOK = 2.0  # s: between two looks at the number of workers


class BlockEngine:
    """An engine that computes tasks by an executor of the caller: submitit's, mpi4py's, a pool.

    submit: gives a future of a task's columns. width: how many workers there are. restart: after workers died. check:
    raises TwolinkError, code "cluster-lost", where there is nobody to wait for.
    """

    def __init__(self, executor: Any) -> None:
        self._executor = executor
        self.width = getattr(executor, "_max_workers", 0) or AT_ONCE

    def submit(self, task: SweepTask) -> "Future[Columns]":
        """Give a task to a worker."""
        return self._executor.submit(compute, task)  # type: ignore[no-any-return]

    def ready(self) -> None:
        """Wait until workers have begun, where they are ours."""

    def restart(self) -> None:
        """Make new workers where they are ours."""

    def check(self) -> None:
        """Raise where there is nobody to wait for."""

    def close(self) -> None:
        """End what is ours."""


class LocalProcesses(BlockEngine):
    """Processes of this machine, one thread each. They end with this one, however it ends."""

    def __init__(self, workers: int | None = None) -> None:
        self.width = thread_count() if workers is None else whole(workers, "workers", SceneError, "such as 4", 1)
        self._begin()

    def _begin(self) -> None:
        self._executor = ProcessPoolExecutor(self.width, _Spawn(), _prepare)
        self._begun = [self._executor.submit(os.getpid) for _ in range(self.width)]

    def ready(self) -> None:
        """Wait until the workers have begun. Raises TwolinkError, code "no-workers"."""
        try:
            for future in self._begun:
                future.result()
        except BrokenProcessPool:
            raise TwolinkError("worker processes end at once", where="sweep", code="no-workers",
                               remedy="check the memory of the machine") from None  # fmt: skip

    def restart(self) -> None:
        """Make new workers."""
        self.close()
        self._begin()
        self.ready()

    def close(self) -> None:
        """End the workers, in the middle of what they do."""
        processes = list((self._executor._processes or {}).values())
        self._executor.shutdown(wait=False, cancel_futures=True)
        for process in processes:
            process.kill()


def _prepare() -> None:
    """In a worker: Ctrl-C is for the parent, which ends its workers; they end when it is killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()

    def watch() -> None:
        if parent is not None:
            parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


class _SpawnProcess(SpawnProcess):
    """A process that does not run the user's script again: scripts need no `if __name__ == "__main__"`."""

    @staticmethod
    def _Popen(process_obj: Any) -> Any:
        own, sys.modules["__main__"] = sys.modules["__main__"], types.ModuleType("__main__")
        try:
            return SpawnProcess._Popen(process_obj)
        finally:
            sys.modules["__main__"] = own


class _Spawn(SpawnContext):
    Process = _SpawnProcess


class Dask(BlockEngine):
    """A Dask cluster. client: the caller's, or an address."""

    def __init__(self, client: Any) -> None:
        distributed = import_extra("distributed", "sweeps")
        self._own = isinstance(client, str)
        try:
            self._client = distributed.Client(client, timeout=10) if self._own else client
        except (OSError, ValueError) as error:
            raise TwolinkError(f"there is no Dask scheduler: {error}", where=str(client), argument="executor",
                               remedy="check the address", code="cluster-lost") from None  # fmt: skip
        self._executor = self._client.get_executor(pure=False)
        self._seen = time.monotonic()
        self.width = self._threads()

    def _threads(self) -> int:
        workers = self._client.scheduler_info(n_workers=-1)["workers"].values()
        return sum(int(worker["nthreads"]) for worker in workers) or 1

    def submit(self, task: SweepTask) -> "Future[Columns]":
        """Give a task to a worker."""
        try:
            return super().submit(task)
        except Exception:  # whatever a client without a scheduler raises
            raise cluster_lost() from None

    def check(self) -> None:
        """Raise where the scheduler is gone; else follow the number of workers."""
        now = time.monotonic()
        if self._client.status == "running":
            if now > self._seen + LOOK:
                self._seen, self.width = now, self._threads()
        elif self._client.status == "closed" or time.monotonic() - self._seen > GONE_AFTER:
            raise cluster_lost()

    def close(self) -> None:
        """End our client; the cluster goes on."""
        if self._own:
            self._client.close(timeout=2)


def cluster_lost() -> TwolinkError:
    """The failure where a cluster is gone."""
    return TwolinkError("the cluster is gone", where="sweep", argument="executor", code="cluster-lost",
                        remedy="start it and call again: what is done is kept")  # fmt: skip
