"""Threads of batches: how many (TWOLINK_THREADS), and whether this process may use a thread pool at all."""

import os

from twolink.errors import QueryError

LIMIT = 1024

_child = [False]
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=lambda: _child.__setitem__(0, True))


def is_forked_child() -> bool:
    """Whether this process was forked from one that had imported twolink.

    The thread pools of OpenMP and TBB do not survive a fork: a child that waits for their threads, which exist in the
    parent only, waits for ever. A child therefore uses one thread.
    """
    return _child[0]


def thread_count() -> int:
    """TWOLINK_THREADS when it is set, else the CPUs that this process may use."""
    text = os.environ.get("TWOLINK_THREADS", "").strip()
    if not text:
        return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    # isdigit would take "²"; the length comes first since Python refuses to read very long integers.
    number = int(text) if text.isascii() and text.isdecimal() and len(text) < 10 else 0
    if not 1 <= number <= LIMIT:
        what = f"{text[:40]!r} is not a number of threads"
        raise QueryError(what, where="TWOLINK_THREADS", remedy=f"set it to 1 or more, up to {LIMIT}")
    return number
