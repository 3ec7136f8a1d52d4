"""One lock for each key, so that what several requests ask for is made once."""

import asyncio
from weakref import WeakValueDictionary


class KeyedLocks:
    """`async with locks(key)` lets one task at a time work on a key. A lock lives as long as somebody uses it."""

    def __init__(self) -> None:
        self._locks: WeakValueDictionary[str, asyncio.Lock] = WeakValueDictionary()

    def __call__(self, key: str) -> asyncio.Lock:
        return self._locks.setdefault(key, asyncio.Lock())
