"""Tasks that misbehave, for tests of worker processes."""

import contextlib
import ctypes
import mmap
import os
import sys
import time
from typing import Any, BinaryIO

from twolink.errors import RobotError

_KEPT: list[bytes] = []


def crash() -> None:
    ctypes.string_at(0)


def leave() -> None:
    os._exit(3)


def sleep(*, nap: float, report: Any) -> int:
    report(os.getpid())
    time.sleep(nap)
    return os.getpid()


def compute(*, nap: float, report: Any) -> None:
    report(os.getpid())
    end = time.monotonic() + nap
    while time.monotonic() < end:
        pass


def hoard() -> int:
    return len(bytearray(10**12))


def hoard_in_llvm() -> None:
    """As LLVM fails when there is no memory left."""
    blocks = []
    with contextlib.suppress(MemoryError):
        while True:
            blocks.append(mmap.mmap(-1, 2**26))
    raise ValueError("Could not find the symbol 'heyoka.obj_trigger'")


def grow(*, megabytes: int, nap: float = 0.0) -> int:
    """Keep so much more memory, as caches do; or take it for a while only."""
    block = b"x" * (megabytes * 2**20)
    if nap:
        time.sleep(nap)
    else:
        _KEPT.append(block)
    return os.getpid()


def chatter() -> str:
    print("noise on stdout", flush=True)
    sys.stderr.write("noise on stderr\n")
    os.write(1, b"more noise\n")
    return "heard"


def large() -> bytes:
    return bytes(20_000_000)


def reverse(*, exchange: BinaryIO) -> int:
    content = exchange.read()
    exchange.seek(0)
    exchange.truncate()
    exchange.write(content[::-1])
    return len(content)


def refuse() -> None:
    raise RobotError("it broke", where="there", remedy="mend it")


def fail() -> None:
    raise KeyError("secret detail")


_ALL = (crash, leave, sleep, compute, hoard, hoard_in_llvm, grow, chatter, large, reverse, refuse, fail)
TASKS = {f.__name__: f for f in _ALL}
