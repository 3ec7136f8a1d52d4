"""How many threads batches use: one setting for everything, TWOLINK_THREADS."""

from __future__ import annotations

import os

from twolink.errors import QueryError


def thread_count() -> int:
    """TWOLINK_THREADS when it is set, else the CPUs this process may use."""
    text = os.environ.get("TWOLINK_THREADS", "").strip()
    if not text:
        return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if not text.isdigit() or int(text) < 1:
        raise QueryError(f"{text!r} is not a number of threads", where="TWOLINK_THREADS", remedy="set it to 1 or more")
    return int(text)
