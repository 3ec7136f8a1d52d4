"""Loaded robots by id. Robots of the catalogue are read here, uploaded ones by a worker process."""

import asyncio
import functools
import pickle
from collections import OrderedDict

from twolink.dynamics import Robot, load_robot
from twolink.errors import nearest
from twolink.robots.catalogue import catalogue_names
from twolink.service.keyed_locks import KeyedLocks
from twolink.service.problems import Refusal
from twolink.service.settings import Settings
from twolink.service.store import Store
from twolink.service.worker_pool import Workers

_LOADED = 24  # robots at once: a pin.Data of 100 joints takes 33 MB a thread


catalogue = functools.cache(catalogue_names)  # the names of the catalogue, which are ids too


class RobotPool:
    """The robots asked for last; the one not asked for longest is dropped when there are too many."""

    def __init__(self, settings: Settings, store: Store, workers: Workers) -> None:
        self._seconds, self._store, self._workers = settings.quotas.load_seconds, store, workers
        self._robots: OrderedDict[str, Robot] = OrderedDict()
        self._locks = KeyedLocks()

    def loaded(self, key: str) -> Robot | None:
        """The robot if it is loaded."""
        robot = self._robots.get(key)
        if robot is not None:
            self._robots.move_to_end(key)
        return robot

    async def get(self, key: str) -> Robot:
        """The robot of this id. Raises Refusal (404) when there is none."""
        await self.require(key)
        async with self._locks(key):
            robot = self.loaded(key)
            if robot is None and key in catalogue():
                robot = self._keep(key, await asyncio.to_thread(load_robot, key))
            elif robot is None:
                robots = str(self._store.folder / "robots")
                robot = self.put(key, await self._workers.run("load", self._seconds, key=key, robots=robots))
        return robot

    async def require(self, key: str) -> None:
        """Raise Refusal (404) unless there is a robot of this id."""
        if key not in catalogue() and not await self._store.run(self._store.has_robot, key):
            remedy = f"{nearest(key[:80], catalogue())} (GET /v1/robots lists them and the uploaded ones)"
            raise Refusal(404, f"there is no robot {key[:80]!r}", where="path: robot", remedy=remedy)

    def put(self, key: str, pickled: bytes) -> Robot:
        """Keep a robot that a worker has loaded. The worker is this program: data from outside is never unpickled."""
        robot: Robot = pickle.loads(pickled)
        return self._keep(key, robot)

    def _keep(self, key: str, robot: Robot) -> Robot:
        self._robots[key] = robot
        if len(self._robots) > _LOADED:
            self._robots.popitem(last=False)
        return robot

    def forget(self, key: str) -> None:
        """Drop a robot that was deleted."""
        self._robots.pop(key, None)
