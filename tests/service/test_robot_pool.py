"""Loaded robots: found by id, and dropped when they take too much memory."""

import asyncio
from collections.abc import Callable
from typing import Any

import pytest

from twolink.service.problems import Refusal
from twolink.service.robot_pool import RobotPool
from twolink.service.settings import Settings


class IdsOnly:
    """A store that is asked for ids only: descriptions are long, and there may be many."""

    async def run(self, function: Callable[..., Any], *arguments: Any) -> Any:
        return function(*arguments)

    def has_robot(self, _: str) -> bool:
        return False


def test_an_unknown_robot_is_refused_without_a_look_at_all_descriptions() -> None:
    pool = RobotPool(Settings(data=""), IdsOnly(), None)  # type: ignore[arg-type]
    with pytest.raises(Refusal, match="two_link") as refused:
        asyncio.run(pool.require("two_lnk"))
    assert refused.value.status == 404
