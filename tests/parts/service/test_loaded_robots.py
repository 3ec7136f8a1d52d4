"""Loaded robots: found by id, and dropped when they take too much memory."""

import asyncio
import weakref
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import twolink as tl
from tests.robots.test_bad_urdf import chain
from twolink.parts.service.http.components import RobotPool
from twolink.parts.service.problems import Refusal
from twolink.parts.service.settings import Settings
from twolink.parts.service.store.archives import RobotCache, memory_of


class IdsOnly:
    """A store that is asked for ids only: descriptions are long, and there may be many."""

    folder = Path()

    async def run(self, function: Callable[..., Any], *arguments: Any) -> Any:
        return function(*arguments)

    def has_robot(self, _: str) -> bool:
        return False


def test_an_unknown_robot_is_refused_without_a_look_at_all_descriptions() -> None:
    pool = RobotPool(Settings(data="unused"), IdsOnly(), None)
    with pytest.raises(Refusal, match="two_link") as refused:
        asyncio.run(pool.require("two_lnk"))
    assert refused.value.status == 404


def test_robots_are_dropped_by_their_memory_and_those_in_use_live_on() -> None:
    large, small = tl.load_robot(chain(40, "revolute")), tl.load_robot("two_link")
    assert memory_of(large) > 2e6 > 1e6 > memory_of(small)
    cache = RobotCache(10)
    for number in range(30):
        cache.put(f"small {number}", small.with_gravity([0, 0, -1.0]))
    used = cache.put("used", large.with_gravity([0, 0, -1.0]))
    dropped = [weakref.ref(cache.put(f"large {number}", large.with_gravity([0, 0, -1.0]))) for number in range(20)]
    kept = [robot() for robot in dropped if robot() is not None]
    assert 2 <= len(kept) <= 4
    assert cache.get("used") is None
    assert cache.get("small 0") is None
    assert np.isfinite(used.gravity_torque(used.neutral)).all()
    oldest, next_one = (f"large {20 - len(kept) + k}" for k in range(2))
    assert cache.get(oldest) is kept[0]  # and so it is used last
    cache.put("another", large)
    assert cache.get(oldest) is kept[0]
    assert cache.get(next_one) is None


def test_a_robot_above_the_limit_is_kept_alone() -> None:
    cache, robot = RobotCache(0.1), tl.load_robot("two_link")
    assert cache.put("a", robot) is cache.get("a")
    cache.put("b", robot)
    assert cache.get("a") is None
