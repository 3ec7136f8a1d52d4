"""Loaded robots by id."""

import functools

from twolink.dynamics import Robot
from twolink.errors import nearest
from twolink.robots.catalogue import catalogue_names
from twolink.service.keyed_locks import KeyedLocks
from twolink.service.problems import Refusal
from twolink.service.robot_cache import RobotCache
from twolink.service.robot_pickle import read_robot
from twolink.service.settings import Settings
from twolink.service.store import Store
from twolink.service.worker_pool import Workers

catalogue = functools.cache(catalogue_names)  # the names of the catalogue, which are ids too


class RobotPool:
    """The robots that small queries have asked for last, within the quota of their memory. Worker processes load them.

    folder: where the uploaded robots are.
    """

    def __init__(self, settings: Settings, store: Store, workers: Workers) -> None:
        self.folder = str(store.folder / "robots")
        self._seconds, self._store, self._workers = settings.quotas.load_seconds, store, workers
        self._robots = RobotCache(settings.quotas.robots_mb)
        self._locks = KeyedLocks()
        self.loaded = self._robots.get  # the robot of an id if it is loaded

    async def get(self, key: str) -> Robot:
        """The robot of this id. Raises Refusal (404) when there is none."""
        await self.require(key)
        async with self._locks(key):
            robot = self.loaded(key)
            if robot is None:
                pickled = await self._workers.run("load", self._seconds, key=key, robots=self.folder)
                robot = self.put(key, pickled)
        return robot

    async def require(self, key: str) -> None:
        """Raise Refusal (404) unless there is a robot of this id."""
        if key not in catalogue() and not await self._store.run(self._store.has_robot, key):
            remedy = f"{nearest(key[:80], catalogue())} (GET /v1/robots lists them and the uploaded ones)"
            raise Refusal(404, f"there is no robot {key[:80]!r}", where="path: robot", remedy=remedy)

    def put(self, key: str, pickled: bytes) -> Robot:
        """Keep a robot that a worker has loaded."""
        return self._robots.put(key, read_robot(pickled))

    def forget(self, key: str) -> None:
        """Drop a robot that was deleted."""
        self._robots.drop(key)
