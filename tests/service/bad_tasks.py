"""Tasks that misbehave, for tests of worker processes."""

import ctypes
import os
import sys
import time
from typing import Any

from twolink.errors import RobotError


def crash() -> None:
    ctypes.string_at(0)


def leave() -> None:
    os._exit(3)


def sleep(*, nap: float, report: Any) -> int:
    report(os.getpid())
    time.sleep(nap)
    return os.getpid()


def hoard() -> int:
    return len(bytearray(10**12))


def chatter() -> str:
    print("noise on stdout", flush=True)
    sys.stderr.write("noise on stderr\n")
    os.write(1, b"more noise\n")
    return "heard"


def large() -> bytes:
    return bytes(20_000_000)


def refuse() -> None:
    raise RobotError("it broke", where="there", remedy="mend it")


def fail() -> None:
    raise KeyError("secret detail")


TASKS = {f.__name__: f for f in (crash, leave, sleep, hoard, chatter, large, refuse, fail)}
