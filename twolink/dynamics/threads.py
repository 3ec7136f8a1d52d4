"""Threads: how many (TWOLINK_THREADS), whether this process may use a thread pool at all, and sharing work."""

import contextlib
import functools
import os
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from typing import Any

from twolink.errors import QueryError

LIMIT = 1024
LOOK = 0.1  # s: between two reports of what threads work on

_own = threading.local()

_child = [False]
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=lambda: _child.__setitem__(0, True))


def is_forked_child() -> bool:
    """True if this process was forked from one that had imported twolink.

    The thread pools of OpenMP and TBB do not survive a fork: a child that waits for their threads, which exist in the
    parent only, waits for ever. A child therefore uses one thread.
    """
    return _child[0]


def thread_count() -> int:
    """TWOLINK_THREADS when it is set, else the CPUs that this process may use; 1 within shared work."""
    if is_shared():
        return 1
    text = os.environ.get("TWOLINK_THREADS", "").strip()
    if not text:
        return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    # isdigit would take "²"; the length comes first since Python refuses to read very long integers.
    number = int(text) if text.isascii() and text.isdecimal() and len(text) < 10 else 0
    if not 1 <= number <= LIMIT:
        what = f"{text[:40]!r} is not a number of threads"
        raise QueryError(what, where="TWOLINK_THREADS", remedy=f"set it to 1 or more, up to {LIMIT}")
    return number


def is_shared() -> bool:
    """True if this thread does a part of work that threads share: then what it calls shall use no more threads."""
    return getattr(_own, "sharing", False)


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Within it, this thread uses no other ones: other processes use the other cores."""
    before, _own.sharing = is_shared(), True
    try:
        yield
    finally:
        _own.sharing = before


def share(parts: Sequence[Callable[[threading.Event], None]], report: Callable[[], None]) -> None:
    """Do all parts, on as many threads as there may be, and report now and then and at the end.

    A part is called with an event; once that is set, its result is not wanted any more. An exception of a part or of
    the report ends the others and is raised.
    """
    stopped = threading.Event()
    if len(parts) == 1:
        parts[0](stopped)
        report()
        return

    def begin() -> None:
        _own.sharing = True

    with ThreadPoolExecutor(thread_count(), initializer=begin) as pool:
        futures = {pool.submit(part, stopped) for part in parts}
        try:
            while futures:
                done, futures = wait(futures, LOOK)
                for future in done:
                    future.result()
                report()
        except BaseException:
            stopped.set()
            pool.shutdown(cancel_futures=True)
            raise


def do_all(tasks: Iterable[Any], work: Callable[[Any], object], threads: int) -> None:
    """Call work(task) for each task, on this thread and threads - 1 others. The first exception is raised.

    For tasks of less than a millisecond: the threads are kept for the next call.
    """
    waiting = iter(tasks)

    def take() -> None:
        for task in waiting:  # `next` of an iterator in C is atomic
            work(task)

    helpers = [_pool(threads).submit(take) for _ in range(threads - 1)]
    try:
        take()
    finally:
        for helper in helpers:
            if not helper.cancel():  # one that has not begun has nothing left to do
                helper.result()


@functools.cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads - 1, "twolink-batch")
