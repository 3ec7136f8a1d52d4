"""Working through blocks: given to an engine, written when they are done, tried again where a worker died."""

import contextlib
import sys
import time
from collections import deque
from collections.abc import Collection, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Future, wait
from dataclasses import dataclass
from typing import Any

import numpy as np

from twolink.errors import SceneError, TwolinkError
from twolink.io.progress import Report
from twolink.parts.sweeps.design import Block
from twolink.parts.sweeps.engines import BlockEngine, Dask, LocalProcesses, cluster_lost
from twolink.parts.sweeps.outputs import ABANDONED
from twolink.parts.sweeps.plan import SweepPlan
from twolink.parts.sweeps.runs import Columns, SweepTask
from twolink.parts.sweeps.slurm import SCHEME, Slurm
from twolink.parts.sweeps.store import SweepStore

TRIES = 3
AHEAD = 2  # tasks given to an engine for each worker, so that none waits
LOOK = 0.5  # s: between two looks at the engine


@dataclass(eq=False)
class _Part:
    """Runs of a block that are given to a worker: their numbers (n,) in the block, and tries in vain."""

    block: Block
    some: np.ndarray
    task: SweepTask
    tries: int = 0


class Work:
    """The pending runs of a store on their way through an engine."""

    def __init__(self, store: SweepStore, engine: BlockEngine, report: Report) -> None:
        self.store, self.engine, self.report = store, engine, report
        self.plan: SweepPlan = store.plan
        self.done = self.begun = self.plan.design.runs - sum(len(some) for _, some in store.pending())
        self.begin = time.monotonic()
        self.again: deque[_Part] = deque()  # to be tried again, one after the other
        self.under_way: dict[Any, _Part] = {}

    def all(self) -> None:
        """Compute and write all that is pending.

        Raises
        ------
        TwolinkError
            The store cannot be written, or the cluster is gone (code "cluster-lost"). What was finished is kept.
        """
        parts = self._parts()
        try:
            while self._fill(parts) or self.under_way:
                finished = _finished(self.under_way)
                self.engine.check()
                self._take(finished)
        finally:
            for future in self.under_way:
                future.cancel()

    def _parts(self) -> Iterator[_Part]:
        for block, some in self.store.pending():
            whole = self.plan.task(block)
            # A block that is partly done was searched for a run that ends workers: the search goes on.
            yield _Part(block, some, whole.part(some), TRIES - 1 if len(some) < whole.runs else 0)

    def _fill(self, parts: Iterator[_Part]) -> bool:
        """Give tasks to the engine, those that are tried again one at a time: then it is known who ends a worker."""
        if self.again:
            if not self.under_way:
                self._submit(self.again.popleft())
            return True
        while len(self.under_way) < AHEAD * self.engine.width:
            part = next(parts, None)
            if part is None:
                return False
            self._submit(part)
        return True

    def _submit(self, part: _Part) -> None:
        try:
            self.under_way[self.engine.submit(part.task)] = part
        except BrokenExecutor:  # a worker died while it had nothing to do
            self.engine.restart()
            self.under_way[self.engine.submit(part.task)] = part

    def _take(self, finished: set[Any]) -> None:
        failed = list[tuple[_Part, BaseException]]()
        waiting = list(finished)
        while waiting:
            future = waiting.pop()
            part = self.under_way.pop(future)
            try:
                self._put(part, future.result())
            except TwolinkError:  # of the store, or of all runs alike: nothing can be kept
                raise
            except ImportError as error:
                remedy = "install twolink and your own modules there"
                raise TwolinkError(f"workers cannot import what they need: {error}", where="sweep", remedy=remedy,
                                   argument="executor", code="workers-differ") from None  # fmt: skip
            except CancelledError:
                raise cluster_lost() from None
            except BrokenExecutor as error:  # a pool that broke ends all that it has
                failed.append((part, error))
                waiting += [other for other in wait(self.under_way, LOOK)[0] if other not in waiting]
            except Exception as error:  # the worker died, or has no memory
                failed.append((part, error))
        if failed:
            if any(isinstance(reason, BrokenExecutor) for _, reason in failed):
                self.engine.restart()
            for part, reason in failed:
                self._again(part, reason)

    def _again(self, part: _Part, error: BaseException) -> None:
        """Try a part again; after three tries its halves, and after those of a single run give it up."""
        part.tries += 1
        if part.tries < TRIES:
            self.again.append(part)
        elif part.task.runs > 1:
            self.again.extend(_Part(part.block, part.some[half], part.task.part(half), TRIES - 1)
                              for half in np.array_split(np.arange(part.task.runs), 2))  # fmt: skip
        else:
            text = " ".join(f"given up after {TRIES} tries: {type(error).__name__}: {error}".split())
            columns = {v.name: v.empty(1) for v in self.plan.variables}
            columns["status"][:], columns["reason"][:] = ABANDONED, text[:300]
            self._put(part, columns)

    def _put(self, part: _Part, columns: Columns) -> None:
        """Write a part's results, and tell how far it is."""
        self.store.write(part.block, part.some, columns)
        self.done += part.task.runs
        total = self.plan.design.runs
        rate = (self.done - self.begun) / max(1e-9, time.monotonic() - self.begin)
        self.report(self.done, total, f"{rate:.4g} runs/s, {(total - self.done) / rate:.0f} s left")


def _finished(futures: Collection[Any]) -> set[Any]:
    """The futures that are done, after one is or after a moment. Jobs of submitit are no futures, and are asked."""
    if all(isinstance(future, Future) for future in futures):
        return set(wait(futures, LOOK, FIRST_COMPLETED).done)
    done = {future for future in futures if future.done()}
    if not done:
        time.sleep(LOOK)
    return done


@contextlib.contextmanager
def engine_of(executor: Any, workers: int | None) -> Iterator[BlockEngine]:
    """The engine for None, a Dask client or its address, Slurm's URL, or an executor. Raises SceneError otherwise."""
    distributed = sys.modules.get("distributed")
    if executor is None:
        engine: BlockEngine = LocalProcesses(workers)
    elif isinstance(executor, str) and executor.startswith(SCHEME):
        engine = Slurm(executor)
    elif isinstance(executor, str) or (distributed and isinstance(executor, distributed.Client)):
        engine = Dask(executor)
    elif callable(getattr(executor, "submit", None)):
        engine = BlockEngine(executor)
    else:
        raise SceneError(f"expected a Dask client, an address or an executor, got {type(executor).__name__}",
                         argument="executor", remedy="leave it out for local processes")  # fmt: skip
    try:
        yield engine
    finally:
        engine.close()
