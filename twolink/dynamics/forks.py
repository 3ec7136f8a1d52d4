"""Whether this process is a forked child. The thread pools of OpenMP and TBB do not survive a fork: waiting for their
threads, which exist in the parent only, would never end. A child therefore does without them."""

from __future__ import annotations

import os

_child = [False]


def is_forked_child() -> bool:
    """True in a process that was forked from one that had imported twolink."""
    return _child[0]


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=lambda: _child.__setitem__(0, True))
