"""Robots by id, ready to answer: those of the catalogue are read here, uploaded ones by a worker process."""

from __future__ import annotations

import asyncio
import functools
import pickle
from collections import OrderedDict

from twolink.dynamics import Robot, load_robot
from twolink.errors import nearest
from twolink.robots.catalogue import catalogue_names
from twolink.service.problems import Refusal
from twolink.service.settings import Settings
from twolink.service.store import Store
from twolink.service.worker_pool import Workers

_MOST = 24  # a pin.Data of 100 joints takes 33 MB a thread


@functools.cache
def catalogue() -> tuple[str, ...]:
    """The names of the catalogue, which are ids too."""
    return catalogue_names()


class LoadedRobots:
    """The robots asked for of late; the one not asked for longest goes when there are too many."""

    def __init__(self, settings: Settings, store: Store, workers: Workers) -> None:
        self._settings, self._store, self._workers = settings, store, workers
        self._robots: OrderedDict[str, Robot] = OrderedDict()
        self._locks: dict[str, asyncio.Lock] = {}

    def at_hand(self, key: str) -> Robot | None:
        """The robot if it is loaded."""
        robot = self._robots.get(key)
        if robot is not None:
            self._robots.move_to_end(key)
        return robot

    async def get(self, key: str) -> Robot:
        """The robot of this id. Raises Refusal (404) when there is none."""
        found = self.at_hand(key)
        if found is not None:
            return found
        self.require(key)
        async with self._locks.setdefault(key, asyncio.Lock()):
            found = self.at_hand(key)
            if found is None:
                found = await self._load(key)
                self._robots[key] = found
                if len(self._robots) > _MOST:
                    self._robots.popitem(last=False)
        self._locks.pop(key, None)
        return found

    def require(self, key: str) -> None:
        """Raise Refusal (404) unless there is a robot of this id."""
        if key not in catalogue() and self._store.robot(key) is None:
            uploaded = [str(robot["id"]) for robot in self._store.robots()]
            remedy = f"{nearest(key, [*catalogue(), *uploaded])} (GET /v1/robots lists them)"
            raise Refusal(404, f"there is no robot {key[:80]!r}", where="path: robot", remedy=remedy)

    async def _load(self, key: str) -> Robot:
        if key in catalogue():
            return await asyncio.to_thread(load_robot, key)
        folder = str(self._store.robot_folder(key))
        quotas = self._settings.quotas
        # Our own process wrote it: only what comes from outside may not be unpickled.
        robot: Robot = pickle.loads(await self._workers.run("load", quotas.load_seconds, folder=folder))
        return robot

    def put(self, key: str, pickled: bytes) -> None:
        """Take a robot that a worker has just loaded."""
        self._robots[key] = pickle.loads(pickled)

    def forget(self, key: str) -> None:
        """Drop a robot that was deleted."""
        self._robots.pop(key, None)
