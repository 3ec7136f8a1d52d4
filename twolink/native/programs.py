"""Programs by name: traced once, kept in the process and, as arrays, in the disk cache."""

import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from twolink.algorithms.namespaces import Array
from twolink.algorithms.tape import collection_paused
from twolink.errors import CertificationError
from twolink.io import cache
from twolink.native.instructions import Assembled
from twolink.native.machine import Program

AGREEMENT = 1e-8  # relative
MAX_KEPT = 512  # in this process
_kept: dict[str, Any] = {}


class Spent(threading.local):
    """Seconds that a thread has spent on tracing, loading and comparing programs so far."""

    seconds = 0.0


SPENT = Spent()
_lock = threading.Lock()  # held for lookups only: tracing and comparing go on side by side


def kept(name: str) -> Any:
    """The object that this process keeps under a name; None where there is nothing."""
    return _kept.get(name)


def keep(name: str, content: Any) -> Any:
    """Keep content for the life of the process, and not too much; what another thread kept meanwhile comes first."""
    with _lock:
        found = _kept.setdefault(name, content)
        while len(_kept) > MAX_KEPT:
            del _kept[next(iter(_kept))]
        return found


def arrays_named(name: str, trace: Callable[[], Assembled]) -> Assembled:
    """The arrays of this name: at hand, loaded or traced."""
    found: Assembled | None = _kept.get(name)
    if found is not None:
        return found
    start = time.perf_counter()
    found = cache.load(name)
    if not isinstance(found, Assembled):
        with collection_paused():
            found = trace()
        cache.store(name, found)
    SPENT.seconds += time.perf_counter() - start
    return keep(name, found)  # type: ignore[no-any-return]


def program_named(name: str, trace: Callable[[], Assembled], compare: Callable[[Program], None]) -> Program:
    """The program of this name, compared before its first use by a process with this disk cache."""
    found: Program | None = _kept.get(f"{name}-program")
    if found is None:
        program = Program(arrays_named(name, trace))
        once(f"{name}-certified", lambda: compare(program))
        found = keep(f"{name}-program", program)
    return found


def once(name: str, act: Callable[[], None]) -> None:
    """Act, if this was not done yet by a process with this disk cache."""
    if name in _kept:
        return
    start = time.perf_counter()
    if cache.load(name) is not True:
        act()
        cache.store(name, True)
    keep(name, True)
    SPENT.seconds += time.perf_counter() - start


def require_agreement(what: str, ours: Array, theirs: Array) -> None:
    """Require that a program's numbers are its formula's by NumPy or Pinocchio. Raises CertificationError."""
    off = np.abs(ours - theirs).max(initial=0.0) / (1.0 + np.abs(theirs).max(initial=0.0))
    if not off <= AGREEMENT and np.isfinite(theirs).all():
        raise CertificationError(f"the program of {what} differs from its formula by {off:.1e}",
                                 remedy="report it with the robot")  # fmt: skip
