"""Compiled functions by name, and comparisons of them: made once, kept in the process and in the disk cache."""

import threading
import time
from collections.abc import Callable
from typing import Any

from twolink.dynamics.kernels import heyoka
from twolink.io import cache

MAX_KEPT = 256  # in this process
_kept: dict[str, Any] = {}
_lock = threading.RLock()


def is_at_hand(name: str) -> bool:
    """Whether the function of this name is in this process, or in the disk cache."""
    return name in _kept or cache.has(name)


def once(name: str, act: Callable[[], None]) -> float:
    """Act, if this was not done yet by a process with this disk cache; the seconds of it."""
    with _lock:
        if name in _kept:
            return 0.0
        start = time.perf_counter()
        if cache.load(name) is not True:
            act()
            cache.store(name, True)
        _keep(name, True)
        return time.perf_counter() - start


def _keep(name: str, content: Any) -> None:
    """Keep content for the life of the process, and not too much."""
    _kept[name] = content
    while len(_kept) > MAX_KEPT:
        del _kept[next(iter(_kept))]


def compiled_function(name: str, build: Callable[[], Any]) -> tuple[Any, float]:
    """heyoka's function of this name, and the seconds of loading or building it: 0 where it was at hand."""
    with _lock:
        compiled, seconds = _kept.get(name), 0.0
        if compiled is None:
            start = time.perf_counter()
            compiled = cache.load(name)
            if not isinstance(compiled, heyoka().cfunc_dbl):
                compiled = build()
                cache.store(name, compiled)
            _keep(name, compiled)
            seconds = time.perf_counter() - start
        return compiled, seconds
