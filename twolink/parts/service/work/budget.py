"""Seconds of processors that an owner's work may take in a day (UTC), in all processes of the service."""

import asyncio
import math
import time
from collections import defaultdict

from twolink.parts.service.problems import Refusal
from twolink.parts.service.store.store import Store

NO_LIMIT = 1e9
_EACH = 5.0  # s between notes in the database
_DAY = 86_400


class Budget:
    """The processor time that named owners may still take. seconds: of a day."""

    def __init__(self, store: Store, seconds: float) -> None:
        self._store, self._seconds = store, seconds
        self._open = defaultdict[str, float](float)  # s that are not in the database yet

    def charge(self, owner: str, seconds: float) -> None:
        """Note that work of an owner has taken this time of a processor."""
        if owner:
            self._open[owner] += seconds

    async def _spent(self, owner: str) -> float:
        seconds = self._open.pop(owner, 0.0)
        try:
            return await self._store.run(self._store.accounts.spend, owner, seconds)
        except BaseException:
            self.charge(owner, seconds)
            raise

    async def require(self, owner: str) -> float:
        """The seconds that an owner may still take today; infinite for one without a name.

        Raises Refusal (429) where none are left.
        """
        left = self._seconds - await self._spent(owner) if owner and self._seconds < NO_LIMIT else math.inf
        if left <= 0:
            wait = _DAY - time.time() % _DAY
            what = f"{owner} has had the {self._seconds:g} s of processor time of this day"
            remedy = "ask again tomorrow (UTC), or have owner_seconds raised"
            raise Refusal(429, what, code="no-time-left", where="request", remedy=remedy, retry_after=math.ceil(wait))
        return left

    async def note(self) -> None:
        """Have all in the database, until cancelled."""
        while True:
            await asyncio.sleep(_EACH)
            await self.flush()

    async def flush(self) -> None:
        """Have all in the database now, or later where it fails."""
        for owner in tuple(self._open):
            try:
                await self._spent(owner)
            except Exception:
                return
