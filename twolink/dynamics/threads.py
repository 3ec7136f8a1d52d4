"""How many threads batches use: one setting for everything, TWOLINK_THREADS."""

from __future__ import annotations

import os

from twolink.errors import QueryError

MOST = 1024


def thread_count() -> int:
    """TWOLINK_THREADS when it is set, else the CPUs this process may use."""
    text = os.environ.get("TWOLINK_THREADS", "").strip()
    if not text:
        return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    # Not isdigit, which takes "²"; and a length first, since Python refuses to read very long integers.
    number = int(text) if text.isascii() and text.isdecimal() and len(text) < 10 else 0
    if not 1 <= number <= MOST:
        what = f"{text[:40]!r} is not a number of threads"
        raise QueryError(what, where="TWOLINK_THREADS", remedy=f"set it to 1 or more, up to {MOST}")
    return number
